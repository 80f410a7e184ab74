"""Weights that carry positions, fields and labels from the vertices of one sphere to those of another.

The rules are those of Connectome Workbench (SurfaceResamplingHelper; https://www.humanconnectome.org/software/workbench-command):
`BARYCENTRIC` for positions, `ADAP_BARY_AREA` for what is measured on the surface.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from scipy import sparse

from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.topology import enclosed_volume, face_areas, surface_topology
from cortet.meshes import FloatArray, TriSurface

#: mm, the radius to which spheres are scaled, as in Workbench
RADIUS = 100.0
#: least over largest distance of a sphere's vertices from its centre; bounds of its volume over that of a ball
_ROUND, _FULL = 0.9, (0.5, 1.01)

#: (new vertices, old vertices), rows of sum 1
Weights: TypeAlias = sparse.csr_matrix


def of_one_radius(sphere: TriSurface) -> TriSurface:
    """The sphere with all vertices at `RADIUS` from the origin."""
    length = np.linalg.norm(sphere.points, axis=1, keepdims=True)
    return TriSurface(RADIUS * sphere.points / length, sphere.faces)


def flaws(sphere: TriSurface) -> list[str]:
    """Why a surface is not a sphere around the origin, in words; empty for a sphere."""
    found = surface_topology(sphere.faces).problems()
    length = np.linalg.norm(sphere.points, axis=1)
    if not length.min() > _ROUND * length.max():
        return [*found, f"its vertices are {length.min():.3g} to {length.max():.3g} from the origin"]
    ball = 4 / 3 * np.pi * RADIUS**3
    share = abs(enclosed_volume(of_one_radius(sphere).points, sphere.faces)) / ball
    if not _FULL[0] < share < _FULL[1]:
        found.append(f"its triangles cover the sphere {share:.2f} times")
    return found


def same_triangles(one: TriSurface, other: TriSurface) -> bool:
    """Whether two surfaces number their vertices alike: they have the same triangles, in either orientation."""
    same_size = len(one.points) == len(other.points) and one.faces.shape == other.faces.shape
    return same_size and bool((np.sort(one.faces, axis=1) == np.sort(other.faces, axis=1)).all())


def barycentric(old: TriSurface, new: TriSurface) -> Weights:
    """Weights of the corners of the nearest triangle of `old` to each vertex of `new`; both have the same radius."""
    found = closest_points(surface_tree(old.points, old.faces), new.points)
    rows = np.repeat(np.arange(len(new.points)), 3)
    weights = (found.barycentric.ravel(), (rows, old.faces[found.faces].ravel()))
    made = sparse.csr_matrix(weights, shape=(len(new.points), len(old.points)))
    made.eliminate_zeros()
    return made


def area_corrected(old: TriSurface, new: TriSurface, old_areas: FloatArray, new_areas: FloatArray) -> Weights:
    """Weights with which every vertex of `old` counts in proportion to its area.

    A vertex of `new` gathers from the triangle of `old` in which it lies. If that would leave out vertices of `old` in
    the triangles around it, it gathers from these vertices instead.

    Parameters
    ----------
    old, new : spheres of the same radius
    old_areas, new_areas : (n,) and (k,), vertex areas of the surfaces that belong to the spheres
    """
    forward = barycentric(old, new)
    back = barycentric(new, old).T.tocsr()
    left_out = (back != 0).astype(np.int32) - (back != 0).multiply(forward != 0).astype(np.int32)
    finer = np.asarray(left_out.sum(axis=1)).ravel() > 0
    gathered = sparse.diags((~finer).astype(float)) @ forward + sparse.diags(finer.astype(float)) @ back
    gathered = sparse.diags(new_areas) @ gathered
    given = np.asarray(gathered.sum(axis=0)).ravel()
    shared = gathered @ sparse.diags(np.divide(old_areas, given, out=np.zeros_like(given), where=given > 0))
    total = np.asarray(shared.sum(axis=1)).ravel()
    return sparse.csr_matrix(sparse.diags(1 / total) @ shared)


def vertex_areas(surface: TriSurface) -> FloatArray:
    """Area of each vertex, a third of that of the triangles around it: (n,) mm2."""
    areas: FloatArray = np.repeat(face_areas(surface.points, surface.faces) / 3, 3)
    return np.bincount(surface.faces.ravel(), areas, minlength=len(surface.points)).astype(np.float64)
