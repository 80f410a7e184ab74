"""Triangles that pass through each other, moved apart or replaced."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from cortet.errors import InputError
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.holes import replaced
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import Triangles, as_surface, border_vertices, compacted, faces_at, rings, within
from cortet.geometry.topology import component_labels, neighbour_means
from cortet.mesh import FloatArray, IntArray, TriSurface

#: rounds of smoothing around crossing triangles, and of replacing them
_SMOOTHINGS, _REPLACINGS = 12, 8
#: share of the way to the middle of their neighbours that vertices go in the first half of the rounds of smoothing
_GENTLY = 0.3


class Uncrossed(NamedTuple):
    """Triangles none of which crosses another."""

    work: Triangles
    #: (k, 3) mm, centres of those that did
    centres: FloatArray
    #: whether some had to be replaced
    replaced: bool
    #: mm, farthest that the surface before is from the one after, or the one after from the one before; and where
    displacement: float
    place: FloatArray


def uncrossed(work: Triangles, *, max_displacement: float, max_piece: float) -> Uncrossed:
    """Smoothed apart where that moves little, else cut out and closed smoothly.

    Parameters
    ----------
    work : one closed, oriented manifold
    max_displacement : mm, farthest that a vertex may be moved by smoothing
    max_piece : as of `holes.replaced`

    Raises
    ------
    InputError
        some still cross others afterwards
    """
    before = as_surface(work)
    first = self_intersections(before)
    if not len(first):
        return Uncrossed(work, np.zeros((0, 3)), False, 0.0, np.zeros(3))
    centres = before.points[before.faces[first]].mean(axis=1)
    work = _smoothed_apart(work, first, max_displacement)
    rest, number = self_intersections(as_surface(work)), 0
    while len(rest) and number < _REPLACINGS:
        work = compacted(replaced(work, within(work, work.faces[rest].ravel(), number // 2), max_piece))
        rest = self_intersections(as_surface(work))
        number += 1
    if len(rest):
        x, y, z = work.points[work.faces[rest[0]]].mean(axis=0).round(2).tolist()
        raise InputError(
            f"{len(first)} triangles cross others; {len(rest)} still do after repair, the first at ({x}, {y}, {z}) mm"
        )
    displacement, place = _farthest(before, as_surface(work))
    return Uncrossed(work, centres, number > 0, displacement, place)


def _smoothed_apart(work: Triangles, crossing: IntArray, limit: float) -> Triangles:
    """Vertices of crossing triangles, and of ever more around them, moved towards the middle of their neighbours.

    Where that takes more than the limit, mm, or is not enough, the surface stays as it was.
    """
    used, faces = _near(work, crossing, limit)
    fixed = np.isin(np.arange(len(used)), border_vertices(faces))
    given = points = work.points[used]
    for number in range(_SMOOTHINGS):
        rest = self_intersections(TriSurface(points, faces))
        if not len(rest):
            break
        marked = np.isin(np.arange(len(points)), faces[rest])
        chosen = rings(faces, marked, number // 3) & ~fixed
        share = _GENTLY if number < _SMOOTHINGS // 2 else 1.0
        moved = points + share * (neighbour_means(points, faces) - points)
        points = np.where(chosen[:, None], moved, points).astype(np.float32).astype(np.float64)
    away = np.linalg.norm(points - given, axis=1)
    wrong = (away > limit) | np.isin(np.arange(len(points)), faces[self_intersections(TriSurface(points, faces))])
    # the whole place goes back, not a part of it
    place = np.full(len(points), -1)
    label = component_labels(faces[faces_at(faces, away > 0)])
    place[: len(label)] = label
    result = work.points.copy()
    result[used] = np.where(np.isin(place, place[wrong])[:, None], given, points)
    return work._replace(points=result)


def _near(work: Triangles, crossing: IntArray, limit: float) -> tuple[IntArray, IntArray]:
    """Vertices (k,) and faces, in their numbers, that come near crossing faces while these are moved apart."""
    corners = work.points[work.faces[crossing]]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    reach = 3 * limit + 3 * float(edge)
    distance, _ = cKDTree(corners.mean(axis=1)).query(work.points, distance_upper_bound=reach)
    used, faces = np.unique(work.faces[faces_at(work.faces, np.isfinite(distance))], return_inverse=True)
    return used.astype(np.int32), faces.reshape(-1, 3).astype(np.int32)


def _farthest(before: TriSurface, after: TriSurface) -> tuple[float, FloatArray]:
    """Largest distance of the vertices of each of two surfaces to the other, mm, and that vertex."""
    there = closest_points(tree_of(after), before.points).distances
    back = closest_points(tree_of(before), after.points).distances
    if there.max() > back.max():
        return float(there.max()), before.points[there.argmax()]
    return float(back.max()), after.points[back.argmax()]
