"""Triangles of one edge length on a given surface, and of shorter edges where its shape requires it."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cortet.errors import StageError, place_mm
from cortet.geometry.closest_point import SurfaceTree, surface_tree
from cortet.geometry.intersection import self_intersections
from cortet.geometry.topology import compact, edges, face_areas, mean_edge
from cortet.meshers import _half_edges as half_edges
from cortet.meshers import _triangles as triangles
from cortet.meshers._half_edges import FLAT, Scratch, Work
from cortet.meshers._samples import Limits
from cortet.meshes import FloatArray, IntArray, TriSurface

#: rounds of splits, collapses, flips and smoothing; more would change little
ITERATIONS = 8
#: target edge lengths grow by at most this share of the distance between points
GROWTH = 0.3
#: edges are at most this multiple of the thickness of a blade; longer ones would fill it with flat tetrahedra
EDGE_OVER_THICKNESS = 1.5
#: the thickness of a blade is the largest one within this multiple of the largest distance; nearer to its crest, where
#: it thins out, remeshing may blunt it
CREST = 1.25
#: no target is shorter than this share of the edge length
SHORTEST = 0.35
#: RMS distance of the samples around an operation, over the largest allowed: up to `FREE` it is made at once, above
#: `MOST` refused
FREE, MOST = 0.1, 0.3
#: largest distance as a share of the width of the sulcus or blade, so that opposite sides do not meet
SHARE_OF_GAP = 0.4
#: where triangles cross, remeshing is repeated at most this often; each time, edges and distances shrink by these
#: factors, within this multiple of the target edge length
ROUNDS, TIGHTER_SIZE, TIGHTER_DISTANCE, REACH = 6, 0.8, 0.6, 1.0
#: a triangle is much too large if an edge is longer than this multiple of its target; a splinter, if it is also thinner
#: than this shape (`shapes`)
MUCH_TOO_LARGE, SPLINTER = 6, 0.16
#: triangles that are much too large may be split into this many times as many points as the targets ask for; collapses
#: follow. Up to the first they are split in any order, up to the second the longest edges first
MOST_POINTS = 3, 100
#: factor by which targets may grow back in each round
_EASE = 1.2
#: a surface with a mean edge below the first of these shares of the target edge length is coarsened to the second
_DENSE, _COARSE = 0.2, 0.25
#: largest distance of a coarsened surface from the given one, over the largest that is allowed after remeshing
_COARSE_DISTANCE = 0.1
#: rounds of collapses and flips, and tries to coarsen a surface. Where triangles cross, the next try keeps the given
#: ones, within so many coarse edges
_COARSE_ROUNDS, _COARSE_TRIES, _COARSE_REACH = 2, 4, 2.0

T = TypeVar("T", bound=np.generic)

logger = logging.getLogger(__name__)


class Wanted(NamedTuple):
    """Targets for the triangles at each of the n vertices of the given surface."""

    #: (n,) float64 mm, edge length
    size: FloatArray
    #: (n,) float64 mm, largest distance of the surface to its triangles
    distance: FloatArray


@dataclass(frozen=True)
class Remeshed:
    """Triangles on a given surface."""

    surface: TriSurface
    #: (n,) float64 mm, target edge length at each vertex
    size: FloatArray
    #: (k, 3) float64 mm, points of the given surface; (k,) distance of each to a triangle near it
    samples: FloatArray
    distances: FloatArray
    #: number of remeshings until no triangles crossed
    rounds: int = 1


def remesh(surface: TriSurface, want: Wanted) -> Remeshed:
    """The same closed surface made of nearly equilateral triangles, with all vertices on it.

    No vertex of the surface and no centre of its faces is farther from the triangles than `want` allows. All operations
    are local and keep the topology. But triangles may cross where two banks are closer than the triangles are large;
    `cortet.geometry.intersection.self_intersections` finds them.

    Parameters
    ----------
    surface : closed, oriented manifold
    want : targets at each of its vertices
    """
    points, faces, kept = compact(surface.points, surface.faces)
    size, distance = want.size[kept].copy(), want.distance[kept]
    half_edges.limit_growth(faces, points, size, GROWTH)
    tree = surface_tree(points, faces)
    tree_faces = faces[tree.faces]
    work = _begun(points, faces, tree, size, distance)
    longest, most = float(size.max()), float(distance.max())
    limits = Limits((FREE * most) ** 2, (MOST * most) ** 2)
    scratch = half_edges.scratch(len(work.samples))
    for _ in range(ITERATIONS):
        triangles.relax(work, size, tree_faces, _EASE)
        half_edges.limit_growth(work.faces[: work.used[1]], work.points, work.size, GROWTH)
        work, split = _split(work, tree, scratch, limits)
        collapsed = triangles.collapse_short(work, tree, scratch, limits, SHORTEST * longest)
        work = _with_room(work)
        half_edges.limit_growth(work.faces[: work.used[1]], work.points, work.size, GROWTH)
        flipped = triangles.flip(work, scratch, limits)
        moved = triangles.smooth(work, tree, scratch, limits)
        logger.debug("%d splits, %d collapses, %d flips, %d moves", split, collapsed, flipped, moved)
    live = work.faces[: work.used[1]]
    made = TriSurface(work.points[: work.used[0]], live)
    return Remeshed(made, work.size[: work.used[0]].copy(), work.samples, np.sqrt(work.distance2))


def coarsened(surface: TriSurface, edge_length: float, distance: float) -> TriSurface:
    """The surface, with its edges collapsed if it is much denser than its triangles will be; else as it is.

    Remeshing measures every vertex again and again. Far fewer give the same triangles, and this takes a time that is
    linear in the number of vertices. Fields are those of the nearest vertex.

    Parameters
    ----------
    edge_length, distance : mm, targets of the remeshing
    """
    if mean_edge(surface.points, surface.faces) > _DENSE * edge_length:
        return surface
    coarse, count = _COARSE * edge_length, len(surface.points)
    want = Wanted(np.full(count, coarse), np.full(count, _COARSE_DISTANCE * distance))
    for _ in range(_COARSE_TRIES):
        made = _collapsed(surface, want)
        crossing = self_intersections(made)
        if not len(crossing):
            nearest = KDTree(surface.points).query(made.points)[1]
            logger.info("%d of %d vertices are enough for these cells", len(made.points), count)
            return replace(made, point_data={name: values[nearest] for name, values in surface.point_data.items()})
        centres = made.points[made.faces[crossing]].mean(axis=1)
        want = tightened(surface, want, centres, np.full(len(centres), _COARSE_REACH * coarse), size=0.0)
    return surface


def _collapsed(surface: TriSurface, want: Wanted) -> TriSurface:
    """The surface with its edges collapsed up to a length, as far as it stays within a distance."""
    points, faces, kept = compact(surface.points, surface.faces)
    tree = surface_tree(points, faces)
    work = _begun(points, faces, tree, want.size[kept], want.distance[kept], centres=False)
    longest, most = float(want.size.max()), float(want.distance.max())
    limits = Limits((FREE * most) ** 2, (MOST * most) ** 2)
    scratch = half_edges.scratch(len(work.samples))
    for _ in range(_COARSE_ROUNDS):
        triangles.collapse_short(work, tree, scratch, limits, longest)
        work = _with_room(work)
        triangles.flip(work, scratch, limits)
    return TriSurface(work.points[: work.used[0]], work.faces[: work.used[1]])


def _split(work: Work, tree: SurfaceTree, scratch: Scratch, limits: Limits) -> tuple[Work, int]:
    """Split long edges; return the work, with more room if it needed that, and the number of splits of the last round.

    Splinters are split at their longest edges first, until no edge is too long: in any other order they would leave
    ever thinner ones. So are triangles that are much too large, if splits in the usual order come to no end.
    """
    thinnest = triangles.thinnest(work, MUCH_TOO_LARGE)
    if np.isinf(thinnest):
        return _split_until(work, tree, scratch, limits, longest=False, most=np.inf)
    wanted = triangles.points_wanted(work) + len(work.samples)
    if thinnest >= SPLINTER:
        copy = work._replace(**{name: array.copy() for name, array in work._asdict().items()})
        done, split = _split_until(copy, tree, scratch, limits, longest=False, most=MOST_POINTS[0] * wanted)
        if split >= 0:
            return done, split
    done, split = _split_until(work, tree, scratch, limits, longest=True, most=MOST_POINTS[1] * wanted)
    if split < 0:
        raise StageError(
            f"remeshing stopped at {done.used[0]:,} points, {MOST_POINTS[1]} times the number expected for the cell "
            f"size; the last point was near {place_mm(done.points[done.used[0] - 1])}",
            remedy="remesh the surface to remove long, thin triangles",
        )
    return done, split


def _split_until(
    work: Work, tree: SurfaceTree, scratch: Scratch, limits: Limits, *, longest: bool, most: float
) -> tuple[Work, int]:
    """Split long edges once, or if `longest`, until none is left; the number is -1 if that takes too many points."""
    changed = _every_block(work)
    while True:
        split = triangles.split_long(work, tree, scratch, limits, longest, changed)
        if split < 0 and work.used[0] > most:
            return work, split
        if split < 0:
            work = _with_room(work)
            changed = _every_block(work)
        elif split == 0 or not longest:
            return work, split


def _every_block(work: Work) -> NDArray[np.bool_]:
    """Whether each block of faces is to be scanned: all are; (b,)."""
    return np.ones(len(work.faces) // triangles.BLOCK + 1, np.bool_)


def unsound(surface: TriSurface) -> IntArray:
    """Triangles that cannot bound a mesh, since they cross others or are flat; (k,) int32, ascending."""
    return np.union1d(self_intersections(surface), np.flatnonzero(shapes(surface) < FLAT)).astype(np.int32)


def shapes(surface: TriSurface) -> FloatArray:
    """4 sqrt(3) area over the sum of squared edges: (m,), 1 for an equilateral triangle, 0 for a flat one."""
    corners = surface.points[surface.faces]
    squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    return 4 * np.sqrt(3) * face_areas(surface.points, surface.faces) / squares


def tightened(
    surface: TriSurface, want: Wanted, centres: FloatArray, radius: FloatArray, *, size: float = TIGHTER_SIZE
) -> Wanted:
    """`want` with shorter edges and distances at the vertices, if any, within `radius` (k,) of `centres` (k, 3), mm.

    Edges shrink by the factor `size`.
    """
    near = KDTree(surface.points).query_ball_point(centres, radius)
    around = np.unique(np.concatenate([np.asarray(ball, np.int64) for ball in near]))
    if not len(around):
        return want
    shorter, nearer = want.size.copy(), want.distance.copy()
    shorter[around] *= size
    nearer[around] *= TIGHTER_DISTANCE
    return Wanted(shorter, nearer)


def opened(surface: TriSurface, values: FloatArray, *, below: float, radius: float) -> FloatArray:
    """Replace each value (n,) that is `below` a limit by the largest one around it.

    This takes in the neighbours by an edge and the vertices within `radius` (mm).
    """
    start, end = edges(surface.faces).T
    largest = values.copy()
    np.maximum.at(largest, start, values[end])
    np.maximum.at(largest, end, values[start])
    low = np.flatnonzero(largest < below)
    near = KDTree(surface.points).query_ball_point(surface.points[low], radius)
    largest[low] = np.maximum(largest[low], [values[around].max() for around in near])
    return np.where(values < below, largest, values)


def _begun(
    points: FloatArray,
    faces: IntArray,
    tree: SurfaceTree,
    size: FloatArray,
    distance: FloatArray,
    *,
    centres: bool = True,
) -> Work:
    """The given surface itself, with every vertex and, where `centres` count, every face centre attached to it."""
    n, m = len(points), len(faces)
    leaving, opposite = np.full(n, -1, np.int32), np.full(3 * m, -1, np.int32)
    half_edges.link(faces, opposite, leaving)
    in_tree = np.empty(m, np.int32)
    in_tree[tree.faces] = np.arange(m, dtype=np.int32)
    of_vertex = leaving // 3
    of_face = np.arange(m if centres else 0)
    face = np.concatenate([of_vertex, of_face])
    first, after = _lists(face, m)
    limit = np.concatenate([distance, distance[faces[of_face]].min(axis=1)])
    samples = np.concatenate([points, points[faces[of_face]].mean(axis=1)])
    work = Work(
        points=points,
        on_triangle=in_tree[of_vertex],
        size=size.copy(),
        leaving=leaving,
        faces=faces,
        opposite=opposite,
        first=first,
        after=after,
        samples=samples,
        distance2=np.zeros(len(samples)),
        limit2=limit**2,
        used=np.array([n, m]),
    )
    return _with_room(work)


def _lists(face: NDArray[np.int64], count: int) -> tuple[IntArray, IntArray]:
    """Linked lists of the samples of `count` faces: the first sample of each face, and the one after each sample."""
    order = np.argsort(face, kind="stable").astype(np.int32)
    ordered = face[order]
    last = np.r_[ordered[1:] != ordered[:-1], True]
    after = np.full(len(face), -1, np.int32)
    after[order[:-1]] = np.where(last[:-1], -1, order[1:])
    first = np.full(count, -1, np.int32)
    starts = np.r_[True, last[:-1]]
    first[ordered[starts]] = order[starts]
    return first, after


def _with_room(work: Work) -> Work:
    """The given work without dead vertices and faces, with room for as many again."""
    live_face = np.flatnonzero(work.faces[: work.used[1], 0] >= 0)
    live_vertex = np.flatnonzero(work.leaving[: work.used[0]] >= 0)
    number = np.full(len(work.leaving), -1, np.int32)
    number[live_vertex] = np.arange(len(live_vertex), dtype=np.int32)
    faces = number[work.faces[live_face]]
    n, m = len(live_vertex), len(live_face)
    leaving, opposite = np.full(n, -1, np.int32), np.full(3 * m, -1, np.int32)
    half_edges.link(faces, opposite, leaving)
    return work._replace(
        points=_grown(work.points[live_vertex], n),
        on_triangle=_grown(work.on_triangle[live_vertex], n),
        size=_grown(work.size[live_vertex], n),
        leaving=_grown(leaving, n),
        faces=_grown(faces, m),
        opposite=_grown(opposite, 3 * m),
        first=_grown(work.first[live_face], m),
        used=np.array([n, m]),
    )


def _grown(array: NDArray[T], more: int) -> NDArray[T]:
    return np.concatenate([array, np.full((more, *array.shape[1:]), -1, array.dtype)])
