"""Surfaces inside surfaces: which contains which, and the boundaries of the regions between them.

A surface with inner surfaces stands for a list: number 0 is the outer surface, number i the i-th inner surface.
Region i lies inside surface i and outside all surfaces within it. A surface precedes those that it contains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cortet.errors import InputError
from cortet.geometry.closest_point import ClosestPoints, SurfaceTree, closest_points, tree_of
from cortet.geometry.remembering import once_per_object
from cortet.geometry.topology import enclosed_volume, face_normals, sides_of, summed, unit_vectors, vertex_normals
from cortet.meshes import FloatArray, IntArray, TriSurface

#: a point with a barycentric weight below this lies on the opposite edge
_ON_EDGE = 1e-9
#: frames place coordinates alike up to this, mm; files round matrices to six decimals
_SAME_SPACE = 0.1


def nested(surface: TriSurface, inner: Mapping[str, TriSurface]) -> TriSurface:
    """The surface with inner surfaces in order of enclosed volume, largest first; so each precedes what it contains."""
    for name, one in inner.items():
        _require_same_space(surface, name, one)
    volumes = {name: abs(enclosed_volume(one.points, one.faces)) for name, one in inner.items()}
    return replace(surface, inner={name: inner[name] for name in sorted(inner, key=lambda name: -volumes[name])})


def _require_same_space(surface: TriSurface, name: str, inner: TriSurface) -> None:
    """Raise InputError if equal coordinates of two surfaces whose places are known mean different points."""
    if not (surface.frame.is_placed and inner.frame.is_placed) or surface.frame == inner.frame:
        return
    finite = inner.points[np.isfinite(inner.points).all(axis=1)]
    apart = inner.frame.to_scanner - surface.frame.to_scanner
    off = float(np.linalg.norm(finite @ apart[:3, :3].T + apart[:3, 3], axis=1).max(initial=0))
    if off > _SAME_SPACE:
        raise InputError(
            f"the inner surface {name} is in a different space: the transforms of the two files differ by up to "
            f"{off:.1f} mm",
            remedy="export both in the same way, for example by mris_convert --to-scanner",
        )


def sheets(surface: TriSurface) -> list[TriSurface]:
    """The outer surface by itself, then the inner surfaces; each call returns the same objects."""
    return [_outer(surface) if surface.inner else surface, *surface.inner.values()]


@once_per_object
def _outer(surface: TriSurface) -> TriSurface:
    return replace(surface, inner={})


@once_per_object
def parents(surface: TriSurface) -> list[int]:
    """The number of the smallest surface around each surface; -1 for the outer surface.

    The majority of the vertices decides, so surfaces that touch or cross here and there still have an order.
    """
    every = sheets(surface)
    around = [-1]
    for number in range(1, len(every)):
        holding = [other for other in range(1, number) if _contains(every[other], every[number])]
        around.append(max(holding, default=0))
    return around


def region_boundary(surface: TriSurface, number: int) -> TriSurface:
    """All triangles around a region, counter-clockwise seen from outside it; those of surfaces within are turned.

    The vertices of the region's own surface come first, then those of the surfaces within, in their order.
    """
    every, around = sheets(surface), parents(surface)
    within = [every[child] for child, parent in enumerate(around) if parent == number]
    return joined([every[number], *map(turned, within)])


def turned(surface: TriSurface) -> TriSurface:
    """A surface without fields, its triangles facing the other way."""
    return TriSurface(surface.points, surface.faces[:, ::-1])


def joined(surfaces: Sequence[TriSurface]) -> TriSurface:
    """Several surfaces as one surface without fields, vertices and triangles in order; a single surface as it is."""
    if len(surfaces) == 1:
        return surfaces[0]
    first = np.cumsum([0, *(len(one.points) for one in surfaces)])
    return TriSurface(
        np.concatenate([one.points for one in surfaces]),
        np.concatenate([one.faces + number for one, number in zip(surfaces, first, strict=False)]),
    )


def depths(tree: SurfaceTree, surface: TriSurface, points: FloatArray) -> tuple[FloatArray, FloatArray, ClosestPoints]:
    """Depth of points below a closed manifold whose triangles point outward; negative outside.

    The pseudonormal of the nearest face, edge or vertex tells inside from outside. It is always right if the surface
    does not cross itself (Baerentzen and Aanaes, IEEE Transactions on Visualization and Computer Graphics 11, 2005).

    Returns
    -------
    depth (k,) mm; the unit normal at the nearest point (k, 3), interpolated between the normals of the vertices; and
    the nearest points
    """
    found = closest_points(tree, points)
    corners = _normals(surface).smooth[surface.faces[found.faces]]
    normal = unit_vectors(np.einsum("kc,kcj->kj", found.barycentric, corners))
    side = np.einsum("kj,kj->k", found.points - points, _pseudonormals(surface, found))
    return np.where(side >= 0, 1, -1) * found.distances, normal, found


class _Normals(NamedTuple):
    """Normals of a closed manifold of n vertices and m triangles."""

    #: (m, 3) unit
    faces: FloatArray
    #: (m, 3) the face behind the edge opposite each corner
    across: IntArray
    #: (n, 3) sums over the faces around each vertex, weighted by angle
    vertices: FloatArray
    #: (n, 3) unit, means over the faces around each vertex, weighted by area
    smooth: FloatArray


@once_per_object
def _normals(surface: TriSurface) -> _Normals:
    normal = unit_vectors(face_normals(surface.points, surface.faces))
    smooth = vertex_normals(surface.points, surface.faces)
    return _Normals(normal, _across_edges(surface.faces), _angle_weighted(surface, normal), smooth)


def _pseudonormals(surface: TriSurface, found: ClosestPoints) -> FloatArray:
    """Normal of the face, sum over the two faces of an edge, or angle-weighted sum at a vertex: (k, 3)."""
    normals = _normals(surface)
    off = found.barycentric < _ON_EDGE
    result = normals.faces[found.faces]
    on_edge, on_vertex = off.sum(axis=1) == 1, off.sum(axis=1) == 2
    result[on_edge] += normals.faces[normals.across[found.faces[on_edge], off[on_edge].argmax(axis=1)]]
    vertex = surface.faces[found.faces[on_vertex], found.barycentric[on_vertex].argmax(axis=1)]
    result[on_vertex] = normals.vertices[vertex]
    return result


def _across_edges(faces: IntArray) -> IntArray:
    """The face behind the edge opposite each corner of the faces of a closed manifold: (m, 3)."""
    sides, behind = sides_of(faces), np.empty(faces.size, np.int32)
    behind[sides.first], behind[sides.second] = sides.second // 3, sides.first // 3
    return behind.reshape(-1, 3)[:, [1, 2, 0]]


def _angle_weighted(surface: TriSurface, normal: FloatArray) -> FloatArray:
    """Sum, at each vertex, of the unit normals of its faces times their angles there: (n, 3)."""
    corners = surface.points[surface.faces]
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    length = np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2)
    cosine = np.einsum("mcj,mcj->mc", ahead, back) / np.maximum(length, np.finfo(float).tiny)
    angle = np.arccos(np.clip(cosine, -1, 1))
    weighted = (angle[:, :, None] * normal[:, None]).reshape(-1, 3)
    return summed(surface.faces.ravel(), weighted, len(surface.points))


def _contains(outer: TriSurface, inner: TriSurface) -> bool:
    depth, _, _ = depths(tree_of(outer), outer, inner.points)
    return bool((depth > 0).mean() > 0.5)
