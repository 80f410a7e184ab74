"""Gaps between the banks of a mesh's boundary, measured outside the mesh and compared with those of its surface.

The banks of a slit one element deep can almost touch although all nodes lie on the surface and the topology is right.
So this module measures the gap in front of each boundary face: the diameter of the largest ball outside that touches
the boundary at the centre of the face. It compares a narrow gap with the gap of the surface at the nearest point. A
node or an edge may nearly touch the other bank although no such ball is small, so the distance of faces that face each
other counts as well, where it is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cortet.geometry.closest_point import closer_than, closest_points, tree_of
from cortet.geometry.facing import facing
from cortet.geometry.thickness import gaps
from cortet.geometry.topology import face_normals, mean_edge, unit_vectors
from cortet.meshes import FloatArray, IntArray, TriSurface

#: distances of faces that face each other count up to this share of the mean edge; balls measure wider gaps
_CLOSE = 0.25
#: a ball reaches into the body if its radius exceeds the distance to the nearest point by this share
_TOUCHES = 1e-6


@dataclass(frozen=True)
class Banks:
    """The smallest gap between banks of the boundary, relative to the gap of the surface."""

    #: gap of the boundary over the gap of the surface at this location; wider gaps count as `widest_mm`
    least_share: float
    #: gap of the boundary there, mm
    gap_mm: float
    surface_gap_mm: float
    place_mm: tuple[float, float, float]
    #: mm, the mean edge of the boundary
    widest_mm: float


def banks(boundary: TriSurface, surface: TriSurface) -> Banks:
    """Compare the gaps in front of the faces of a boundary with the gaps of its surface at the nearest points."""
    widest = mean_edge(boundary.points, boundary.faces)
    centres, normals = _fronts(boundary)
    _, distances, middles, given_there = _near(boundary, surface, _CLOSE * widest, widest)
    own = gaps(tree_of(boundary), centres, normals, widest)
    narrow = np.flatnonzero(own < widest)
    own = np.r_[own[narrow], distances]
    if not len(own):
        x, y, z = centres[0].tolist()
        return Banks(1.0, widest, widest, (x, y, z), widest)
    places = np.concatenate([centres[narrow], middles])
    given = np.r_[_given(surface, centres[narrow], widest), given_there]
    share = own / given
    worst = int(share.argmin())
    x, y, z = places[worst].tolist()
    return Banks(
        least_share=min(float(share[worst]), 1.0),
        gap_mm=float(own[worst]),
        surface_gap_mm=float(given[worst]),
        place_mm=(x, y, z),
        widest_mm=widest,
    )


def slits(boundary: TriSurface, surface: TriSurface, least_share: float) -> IntArray:
    """Faces of a boundary with a gap in front of them below a share of that of its surface: (k,) int32, ascending."""
    widest = mean_edge(boundary.points, boundary.faces)
    centres, normals = _fronts(boundary)
    radius = least_share * widest / 2  # of a ball that fits in front of every face that is not a slit
    touched = closer_than(tree_of(boundary), centres + radius * normals, (1 - _TOUCHES) * radius)
    close = np.flatnonzero(touched).astype(np.int32)
    own = gaps(tree_of(boundary), centres[close], normals[close], widest)
    close = close[own < least_share * _given(surface, centres[close], widest)]
    near, distances, _, given = _near(boundary, surface, least_share * widest, widest)
    return np.union1d(close, near[distances < least_share * given]).astype(np.int32)


def _near(
    boundary: TriSurface, surface: TriSurface, reach: float, widest: float
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Faces (k,) within `reach` mm of one that they face, its distance, the middle, and the gap of the surface there.

    At the rim of a bank the gap of the surface depends on which side of the rim is nearest, so the least of three
    counts: at the middle, and at the centres of both faces.
    """
    found = facing(boundary, reach)
    near = np.flatnonzero(found.others >= 0).astype(np.int32)
    centres, middles = boundary.points[boundary.faces].mean(axis=1), found.middles[near]
    places = (middles, centres[near], centres[found.others[near]])
    return near, found.distances[near], middles, np.min([_given(surface, at, widest) for at in places], axis=0)


def _fronts(surface: TriSurface) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 3) of the faces, mm, and their outward unit normals (m, 3)."""
    return surface.points[surface.faces].mean(axis=1), unit_vectors(face_normals(surface.points, surface.faces))


def _given(surface: TriSurface, places: FloatArray, widest: float) -> FloatArray:
    """Gaps of the surface at the points of it that are nearest to places (k, 3) mm, at most `widest`: (k,) mm."""
    found = closest_points(tree_of(surface), places)
    normals = unit_vectors(face_normals(surface.points, surface.faces[found.faces]))
    return np.maximum(gaps(tree_of(surface), found.points, normals, widest), np.finfo(float).tiny)
