"""Steps that turn triangles into one closed manifold, using only their indices and coinciding vertices.

Each step takes and returns `Triangles`. They remember which vertex of the file each vertex was, so that fields can
follow, and whether each triangle was in the file.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cortet.geometry.topology import TRI_EDGES, compact, component_labels, face_areas, fans, linked, numbers, packed
from cortet.meshes import FloatArray, IntArray, TriSurface

#: where a triangle comes from: the file, the cap of a hole of the file, or the replacement of removed triangles
GIVEN, CAP, REPLACED = 0, 1, 2
#: a triangle is a line if its area over the square of its longest side is below this
_LINE = 1e-12


class Triangles(NamedTuple):
    """Triangles on their way to a closed surface."""

    #: (n, 3) float64 mm
    points: FloatArray
    #: (m, 3) int32
    faces: IntArray
    #: (n,) int32, the number that each vertex has in the file, -1 for a new vertex
    origin: IntArray
    #: (m,) int8, `GIVEN`, `CAP` or `REPLACED`
    made: NDArray[np.int8]


def triangles(points: FloatArray, faces: IntArray) -> Triangles:
    """Triangles as a file has them."""
    return Triangles(points, faces, np.arange(len(points), dtype=np.int32), np.zeros(len(faces), np.int8))


def chosen_faces(work: Triangles, kept: NDArray[np.bool_]) -> Triangles:
    """Only the faces that `kept` (m,) marks; vertices keep their numbers."""
    return work._replace(faces=work.faces[kept], made=work.made[kept])


def compacted(work: Triangles) -> Triangles:
    """The same triangles without unused vertices."""
    points, faces, kept = compact(work.points, work.faces)
    return work._replace(points=points, faces=faces, origin=work.origin[kept])


def finite(points: FloatArray) -> NDArray[np.bool_]:
    """Which vertices have finite coordinates, (n,)."""
    return np.isfinite(points.sum(axis=1))


def faces_at(faces: IntArray, marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which faces have a vertex that `marked` (n,) marks, (m,)."""
    a, b, c = faces.T
    return marked[a] | marked[b] | marked[c]


def edge_counts(faces: IntArray) -> NDArray[np.int64]:
    """Number of faces at each side of each face, from corner i to i + 1: (m, 3)."""
    place, count = np.unique(packed(faces[:, TRI_EDGES].reshape(-1, 2)), return_inverse=True, return_counts=True)[1:]
    return count[place].reshape(-1, 3)


def border_vertices(faces: IntArray) -> IntArray:
    """Vertices of edges that are not in exactly two faces, ascending."""
    sides = faces[:, TRI_EDGES][edge_counts(faces) != 2]
    return np.unique(sides).astype(np.int32)


def with_known_places(work: Triangles) -> tuple[Triangles, IntArray]:
    """The triangles without faces at vertices whose coordinates are not finite; returns also these vertices."""
    bad = ~finite(work.points)
    kept = chosen_faces(work, ~faces_at(work.faces, bad))
    points = np.where(bad[:, None], 0, work.points)
    return kept._replace(points=points), np.flatnonzero(bad).astype(np.int32)


def merged(work: Triangles, tolerance: float) -> tuple[Triangles, IntArray]:
    """The triangles after vertices of open or branching edges within `tolerance` mm of each other are merged.

    Other vertices may rightly coincide: where two banks touch, each bank keeps its own. The first vertex at each
    position stays; returns also the vertices that were merged into it.
    """
    rim = border_vertices(work.faces)
    return _joined(work, rim[cKDTree(work.points[rim]).query_pairs(tolerance, output_type="ndarray")])


def collapsed(work: Triangles, tolerance: float) -> tuple[Triangles, IntArray]:
    """The triangles after edges up to `tolerance` mm long are collapsed; returns also the vertices that are gone."""
    sides = work.faces[:, TRI_EDGES].reshape(-1, 2)
    short = np.linalg.norm(work.points[sides[:, 0]] - work.points[sides[:, 1]], axis=1) <= tolerance
    return _joined(work, sides[short & (sides[:, 0] != sides[:, 1])])


def _joined(work: Triangles, pairs: IntArray) -> tuple[Triangles, IntArray]:
    """The triangles after each vertex became the first of those that pairs (k, 2) join it to; and those now gone."""
    count = len(work.points)
    label = linked(pairs[:, 0], pairs[:, 1], count)
    stands_for = np.unique(label, return_index=True)[1].astype(np.int32)[label]
    return work._replace(faces=stands_for[work.faces]), np.flatnonzero(stands_for != np.arange(count)).astype(np.int32)


def without_lines(work: Triangles) -> tuple[Triangles, IntArray]:
    """The triangles without faces that name a vertex twice; returns also the numbers of these faces."""
    a, b, c = work.faces.T
    line = (a == b) | (b == c) | (c == a)
    return chosen_faces(work, ~line), np.flatnonzero(line).astype(np.int32)


def without_duplicates(work: Triangles) -> tuple[Triangles, IntArray]:
    """The triangles with at most one face on the same three vertices; returns also the numbers of removed faces.

    Two faces in opposite directions separate two bodies, and both go; if all faces are such pairs, the surface was
    written with two sides, and one stays. If more faces point one way, the first of them stays.
    """
    key = packed(work.faces)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.r_[True, key[order][1:] != key[order][:-1]])
    count = np.diff(np.r_[starts, len(order)])
    group = np.empty(len(order), np.int64)
    group[order] = np.repeat(np.arange(len(starts)), count)
    first_of = order[starts][group]
    same_side = _follows(work.faces) == _follows(work.faces)[first_of]
    balance = np.bincount(group, np.where(same_side, 1, -1))
    balance = balance if balance.any() else np.ones_like(balance)
    # the first face of the direction that has more; none in a tie
    wanted = np.flatnonzero(np.where(balance[group] > 0, same_side, ~same_side) & (balance[group] != 0))
    stays = np.zeros(len(order), np.bool_)
    stays[wanted[np.unique(group[wanted], return_index=True)[1]]] = True
    return chosen_faces(work, stays), np.flatnonzero(~stays).astype(np.int32)


def _follows(faces: IntArray) -> NDArray[np.bool_]:
    """Orientation of each face, (m,): whether the vertex of middle number follows the vertex of smallest number."""
    smallest = faces.argmin(axis=1)
    rows = np.arange(len(faces))
    return faces[rows, (smallest + 1) % 3] < faces[rows, (smallest + 2) % 3]


def split_fans(work: Triangles) -> tuple[Triangles, IntArray]:
    """The triangles after each fan of faces gets a vertex of its own; returns also the vertices that were split.

    Edges of exactly two faces hold a fan together, so this also separates surfaces that touch along an edge.
    """
    faces = work.faces
    fan, vertex = fans(faces)
    order = np.argsort(vertex, kind="stable")
    further = order[1:][vertex[order][1:] == vertex[order][:-1]]  # the first fan keeps the vertex
    if not len(further):
        return work, np.zeros(0, np.int32)
    number = vertex.copy()
    number[further] = len(work.points) + np.arange(len(further))
    split = vertex[further]
    return (
        work._replace(
            points=np.concatenate([work.points, work.points[split]]),
            faces=number[fan].reshape(-1, 3).astype(np.int32),
            origin=np.concatenate([work.origin, work.origin[split]]),
        ),
        np.unique(split).astype(np.int32),
    )


def without_branches(work: Triangles) -> tuple[Triangles, FloatArray, IntArray]:
    """The triangles without edges in more than two faces: touching surfaces are separated, faces at a slit removed.

    Returns also the centres (k, 3) of the edges that were in more than two faces, and the vertices of the removed faces
    by their number in the file.
    """
    counts = edge_counts(work.faces)
    sides = work.faces[:, TRI_EDGES]
    centres: FloatArray = np.unique(work.points[sides[counts > 2]].mean(axis=1), axis=0)
    branching = (counts > 2).any(axis=1)
    if not branching.any():
        return work, centres, np.zeros(0, np.int32)
    parted, _ = split_fans(work)
    # edges that still branch, and edges of slits: they were in more faces and now are in one
    after = edge_counts(parted.faces)
    torn = (after > 2).any(axis=1) | ((after == 1) & (counts > 2)).any(axis=1)
    return chosen_faces(parted, ~torn), centres, np.unique(parted.origin[parted.faces[torn]])


def pieces(work: Triangles) -> tuple[IntArray, FloatArray]:
    """The connected piece of each face (m,), 0 for the largest, and the area of each piece, mm2."""
    label = np.unique(component_labels(work.faces)[work.faces[:, 0]], return_inverse=True)[1]
    area = np.bincount(label, face_areas(work.points, work.faces)).astype(np.float64)
    order = np.argsort(-area, kind="stable")
    piece: IntArray = numbers(order, len(area))[label]
    return piece, area[order]


def rings(faces: IntArray, marked: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Which vertices (n,) are `marked`, or within `count` edges of a marked vertex."""
    marked = marked.copy()
    for _ in range(count):
        marked[faces[faces_at(faces, marked)]] = True
    return marked


def measurable(surface: TriSurface) -> TriSurface:
    """A surface's triangles of finite coordinates and nonzero area, without fields; vertices keep their numbers.

    A vertex without finite coordinates is moved to 0 and is in no triangle.
    """
    points = np.where(finite(surface.points)[:, None], surface.points, 0)
    kept = ~faces_at(surface.faces, ~finite(surface.points))
    corners = points[surface.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return TriSurface(points, surface.faces[kept & (face_areas(points, surface.faces) > _LINE * longest**2)])


def within(work: Triangles, vertices: IntArray, count: int) -> IntArray:
    """The given vertices and all within `count` edges of them, ascending."""
    marked = np.zeros(len(work.points), np.bool_)
    marked[vertices] = True
    return np.flatnonzero(rings(work.faces, marked, count)).astype(np.int32)


def as_surface(work: Triangles) -> TriSurface:
    """The triangles as a surface, without fields."""
    return TriSurface(work.points, work.faces)


def defective_vertices(faces: IntArray) -> NDArray[np.int64]:
    """Vertices of edges that are not in exactly two faces, and vertices with more than one fan of faces; ascending."""
    several = np.bincount(fans(faces)[1]) > 1
    return np.union1d(border_vertices(faces), np.flatnonzero(several))


def flat_faces(points: FloatArray, faces: IntArray) -> IntArray:
    """Faces whose area is zero within the rounding of coordinates to float32; (k,) int32, ascending."""
    points = points.astype(np.float32).astype(np.float64)
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = face_areas(points, faces) <= np.finfo(np.float32).eps * longest**2
    return np.flatnonzero(flat).astype(np.int32)
