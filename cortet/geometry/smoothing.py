"""Filters of PyMeshLab that smooth a surface: positions change, triangles stay."""

from __future__ import annotations

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from cortet.meshes import FloatArray, TriSurface

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
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.points, surface.faces, v_scalar_array=chosen.astype(float)))
    meshes.compute_selection_by_condition_per_vertex(condselect="(q > 0.5)")
    meshes.apply_coord_laplacian_smoothing(stepsmoothnum=1, cotangentweight=False, selected=True)
    return np.asarray(meshes.current_mesh().vertex_matrix())


def curvatures(surface: TriSurface) -> tuple[FloatArray, FloatArray]:
    """Discrete mean (1/mm) and Gaussian (1/mm2) curvature at each vertex, (n,) (Meyer et al. 2003)."""
    meshes = _loaded(surface)
    found = []
    for kind in ("Mean Curvature", "Gaussian Curvature"):
        meshes.compute_scalar_by_discrete_curvature_per_vertex(curvaturetype=kind)
        found.append(np.array(meshes.current_mesh().vertex_scalar_array()))
    return found[0], found[1]


def _loaded(surface: TriSurface) -> pymeshlab.MeshSet:
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.points, surface.faces))
    return meshes
