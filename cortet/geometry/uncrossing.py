"""Move apart or replace triangles that pass through each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cortet.errors import InputError, counted, place_mm
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.holes import replaced
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import Triangles, as_surface, border_vertices, compacted, faces_at, rings, within
from cortet.geometry.nesting import joined
from cortet.geometry.topology import component_labels, neighbour_means
from cortet.meshes import FloatArray, IntArray, TriSurface, single_precision

#: most rounds of smoothing around crossing triangles, and of replacing them
_SMOOTHINGS, _REPLACINGS = 12, 8
#: in the first half of the smoothing rounds, vertices move this share of the way to the middle of their neighbours
_GENTLY = 0.3


class Uncrossed(NamedTuple):
    """Triangles none of which crosses another."""

    work: Triangles
    #: (k, 3) mm, centres of the triangles that crossed before
    centres: FloatArray
    #: whether triangles had to be replaced
    replaced: bool
    #: mm, largest distance, in both directions, between the surface before and after; and its location
    displacement: float
    place: FloatArray


def uncrossed(work: Triangles, *, max_displacement: float, max_piece: float) -> Uncrossed:
    """Smooth crossing triangles apart where that moves them little; else cut them out and close the holes smoothly.

    Parameters
    ----------
    work : one closed, oriented manifold
    max_displacement : mm, largest distance that smoothing may move a vertex
    max_piece : as in `holes.replaced`
    """
    before = as_surface(work)
    first = self_intersections(before)
    if not len(first):
        return Uncrossed(work, np.zeros((0, 3)), False, 0.0, np.zeros(3))
    crossing = f"{counted(len(first), 'triangle intersects', 'triangles intersect')} others"
    centres = before.points[before.faces[first]].mean(axis=1)
    work = _smoothed_apart(work, first, max_displacement)
    rest, number = self_intersections(as_surface(work)), 0
    while len(rest) and number < _REPLACINGS:
        around = within(work, work.faces[rest].ravel(), number // 2)
        work = compacted(replaced(work, around, max_piece, crossing))
        rest = self_intersections(as_surface(work))
        number += 1
    if len(rest):
        where = place_mm(work.points[work.faces[rest[0]]].mean(axis=0))
        raise InputError(f"{crossing}; {len(rest)} still do after repair, the first at {where}")
    displacement, place = _farthest(before, as_surface(work))
    return Uncrossed(work, centres, number > 0, displacement, place)


def moved_apart(
    surface: TriSurface,
    moved: Callable[[TriSurface, NDArray[np.bool_], int], FloatArray],
    *,
    rounds: int,
    beside: TriSurface | None = None,
) -> tuple[TriSurface, IntArray]:
    """Move vertices of crossing triangles, plus one more ring around them every third round, until none cross.

    Parameters
    ----------
    surface : mm; its vertices and triangles keep their numbers, so fields stay valid
    moved : new positions of all vertices (n, 3), given the surface, the vertices chosen (n,) and the round's number
    rounds : the most rounds
    beside : another surface, which does not move; its triangles are obstacles

    Returns
    -------
    The surface, whose coordinates are rounded to float32 if it moved; and the triangles that still cross, (k,). The
    triangles of `beside` are numbered after those of the surface
    """
    for number in range(rounds + 1):
        crossing = self_intersections(surface if beside is None else joined([surface, beside]))
        own = crossing[crossing < len(surface.faces)]
        if not len(own) or number == rounds:
            break
        chosen = np.zeros(len(surface.points), np.bool_)
        chosen[surface.faces[own]] = True
        chosen = rings(surface.faces, chosen, number // 3)
        surface = single_precision(replace(surface, points=moved(surface, chosen, number)))
    return surface, crossing


def _smoothed_apart(work: Triangles, crossing: IntArray, limit: float) -> Triangles:
    """Move vertices of crossing triangles, and ever more around them, towards the middle of their neighbours.

    Where that takes more than the limit, mm, or does not help, the surface stays as it was.
    """
    used, faces = _near(work, crossing, limit)
    fixed = np.isin(np.arange(len(used)), border_vertices(faces))
    given = work.points[used]

    def towards_neighbours(surface: TriSurface, chosen: NDArray[np.bool_], number: int) -> FloatArray:
        share = _GENTLY if number < _SMOOTHINGS // 2 else 1.0
        means = neighbour_means(surface.points, faces)
        moved = surface.points + share * (means - surface.points)
        return np.where((chosen & ~fixed)[:, None], moved, surface.points)

    points = moved_apart(TriSurface(given, faces), towards_neighbours, rounds=_SMOOTHINGS)[0].points
    away = np.linalg.norm(points - given, axis=1)
    wrong = (away > limit) | np.isin(np.arange(len(points)), faces[self_intersections(TriSurface(points, faces))])
    # the whole component goes back, not just part of it
    component = np.full(len(points), -1)
    label = component_labels(faces[faces_at(faces, away > 0)])
    component[: len(label)] = label
    result = work.points.copy()
    result[used] = np.where(np.isin(component, component[wrong])[:, None], given, points)
    return work._replace(points=result)


def _near(work: Triangles, crossing: IntArray, limit: float) -> tuple[IntArray, IntArray]:
    """Vertices (k,) within reach of crossing faces while these move apart; and their faces, as indices into these."""
    corners = work.points[work.faces[crossing]]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    reach = 3 * limit + 3 * float(edge)
    distance, _ = cKDTree(corners.mean(axis=1)).query(work.points, distance_upper_bound=reach)
    used, faces = np.unique(work.faces[faces_at(work.faces, np.isfinite(distance))], return_inverse=True)
    return used.astype(np.int32), faces.reshape(-1, 3).astype(np.int32)


def _farthest(before: TriSurface, after: TriSurface) -> tuple[float, FloatArray]:
    """Largest distance, mm, from a vertex of either surface to the other surface, and that vertex."""
    there = closest_points(tree_of(after), before.points).distances
    back = closest_points(tree_of(before), after.points).distances
    if there.max() > back.max():
        return float(there.max()), before.points[there.argmax()]
    return float(back.max()), after.points[back.argmax()]
