"""Values inside a mesh from those on its boundary: the discrete harmonic function.

Linear finite elements reproduce linear functions exactly, and the solution converges to the harmonic function as
elements shrink. On tetrahedra with obtuse dihedral angles, which every mesh of this size has, the discrete solution can
leave the range of the boundary values slightly. It is clipped to that range, which enforces the maximum principle and
does not increase the error (C. Kreuzer, Numerical Methods for Partial Differential Equations 30, 2014, 994-1002).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix, diags
from scipy.sparse.linalg import cg
from threadpoolctl import threadpool_limits

from cortet.errors import StageError
from cortet.geometry.topology import TET_EDGES, TET_FACES, face_normals
from cortet.measure.quality import signed_volumes
from cortet.meshes import FloatArray, IntArray, TetMesh

#: relative residual of the linear system
_TOLERANCE = 1e-11
_ITERATIONS = 20_000


def harmonic(mesh: TetMesh, nodes: IntArray, values: FloatArray, guess: FloatArray) -> FloatArray:
    """Extend values from some nodes to all.

    Parameters
    ----------
    nodes : (b,) indices of the nodes that have a value, including the whole boundary
    values : (b, k) their values
    guess : (n, k) initial values

    Returns
    -------
    (n, k) values of all nodes, none outside the range of its column of `values`
    """
    matrix_of_all = stiffness(mesh)
    inner = np.ones(len(mesh.points), bool)
    inner[nodes] = False
    result = guess.astype(np.float64)
    result[nodes] = values
    rows = matrix_of_all[inner]
    matrix, coupling = rows[:, inner], rows[:, nodes]
    preconditioner = diags(1 / matrix.diagonal())
    with threadpool_limits(1):  # long dot products differ in their last bits with the number of threads
        for column in range(values.shape[1]):
            right, start = -(coupling @ values[:, column]), result[inner, column]
            result[inner, column], failed = cg(
                matrix, right, start, rtol=_TOLERANCE, maxiter=_ITERATIONS, M=preconditioner
            )
            if failed:
                raise StageError(
                    f"harmonic interpolation did not converge in {_ITERATIONS} iterations",
                    remedy="set transfer.interior to nearest",
                )
    return np.clip(result, values.min(axis=0), values.max(axis=0))


def stiffness(mesh: TetMesh) -> csr_matrix:
    """The matrix of the integrals of products of gradients, (n, n), mm.

    The gradient of a corner's hat function is -s / 3V, with s the outward area vector of the opposite face.
    """
    areas = np.stack([face_normals(mesh.points, mesh.cells[:, face]) / 2 for face in TET_FACES], axis=1)
    nine_volumes = 9 * signed_volumes(mesh.points, mesh.cells)
    first, second = TET_EDGES.T
    weights: NDArray[np.float64] = np.einsum("mek,mek->me", areas[:, first], areas[:, second]) / nine_volumes[:, None]
    ends = mesh.cells[:, first].ravel(), mesh.cells[:, second].ravel()
    upper = coo_matrix((weights.ravel(), ends), shape=(len(mesh.points),) * 2).tocsr()
    off_diagonal = upper + upper.T
    return (off_diagonal - diags(np.asarray(off_diagonal.sum(axis=1)).ravel())).tocsr()
