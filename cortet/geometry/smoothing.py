"""Filters of PyMeshLab that smooth a surface: positions change, triangles stay.

PyMeshLab loads when it is used: most surfaces are smooth enough.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cortet.meshes import FloatArray, TriSurface

if TYPE_CHECKING:
    import pymeshlab

#: angle (degrees) of the surface-preserving Laplacian, as published; above about 20 it makes no difference
_ANGLE = 60.0


def taubin(surface: TriSurface, *, steps: int, lambda_: float, mu: float) -> FloatArray:
    """Vertices (n, 3), mm, after `steps` of the filter of Taubin (1995), which smooths without shrinking."""
    meshes = _loaded(surface)
    meshes.apply_coord_taubin_smoothing(lambda_=lambda_, mu=mu, stepsmoothnum=steps)
    return np.asarray(meshes.current_mesh().vertex_matrix())


def surface_preserving(surface: TriSurface, *, iterations: int) -> FloatArray:
    """Vertices (n, 3), mm, after the surface-preserving Laplacian that the CORTET paper uses."""
    meshes = _loaded(surface)
    meshes.apply_coord_laplacian_smoothing_surface_preserving(angledeg=_ANGLE, iterations=iterations)
    return np.asarray(meshes.current_mesh().vertex_matrix())


def laplacian(surface: TriSurface, chosen: NDArray[np.bool_]) -> FloatArray:
    """Vertices (n, 3), mm, after one Laplacian step of the `chosen` ones, (n,)."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.points, surface.faces, v_scalar_array=chosen.astype(float)))
    meshes.compute_selection_by_condition_per_vertex(condselect="(q > 0.5)")
    meshes.apply_coord_laplacian_smoothing(stepsmoothnum=1, cotangentweight=False, selected=True)
    return np.asarray(meshes.current_mesh().vertex_matrix())


def _loaded(surface: TriSurface) -> pymeshlab.MeshSet:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.points, surface.faces))
    return meshes
