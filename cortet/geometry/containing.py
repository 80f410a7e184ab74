"""The tetrahedron that holds a point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cortet.geometry.remembering import once_per_object
from cortet.meshes import FloatArray, IntArray, TetMesh

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: a point with no barycentric weight below this lies in a tetrahedron; rounding must not lose points of faces
_INSIDE = -1e-9
#: how many of the nearest tetrahedra are tried first; the number doubles until it must have been one of them
_FIRST = 16


def containing(mesh: TetMesh, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """The tetrahedron that holds each point, and the weights of its corners there.

    Parameters
    ----------
    points : (k, 3) mm, finite

    Returns
    -------
    (k,) int32, -1 for a point outside the mesh; and (k, 4), sum 1, zero outside
    """
    corners, centres, tree, reach = _tree_of(mesh)
    cells, weights = np.full(len(points), -1, np.int32), np.zeros((len(points), 4))
    left, tried, count = np.arange(len(points)), 0, _FIRST
    while len(left) and tried < len(centres):
        distances, near = tree.query(points[left], k=np.arange(tried + 1, min(count, len(centres)) + 1))
        found = np.zeros(len(left), bool)
        for candidates in near.T:
            at = np.flatnonzero(~found)
            own = _barycentric(corners[candidates[at]], points[left[at]])
            inside = own.min(axis=1) >= _INSIDE
            chosen = left[at[inside]]
            cells[chosen], weights[chosen] = candidates[at[inside]], own[inside]
            found[at[inside]] = True
        left, tried, count = left[~found & (distances[:, -1] <= reach)], count, 2 * count
    return cells, weights


@once_per_object
def _tree_of(mesh: TetMesh) -> tuple[FloatArray, FloatArray, cKDTree, float]:
    """Corners of tetrahedra (m, 4, 3), centres (m, 3), a tree of these, and the largest distance between both."""
    from scipy.spatial import cKDTree

    corners = mesh.points[mesh.cells]
    centres = corners.mean(axis=1)
    return corners, centres, cKDTree(centres), float(np.linalg.norm(corners - centres[:, None], axis=2).max())


def _barycentric(corners: FloatArray, points: FloatArray) -> FloatArray:
    """Weights (k, 4) of the corners (k, 4, 3) of one tetrahedron each at points (k, 3)."""
    sides = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    others = np.linalg.solve(sides, (points - corners[:, 0])[:, :, None])[:, :, 0]
    return np.column_stack([1 - others.sum(axis=1), others])
