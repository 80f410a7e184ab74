"""Holes of a triangulated surface: their rims, and smooth caps on them."""

from __future__ import annotations

import numpy as np

from cortet.errors import InputError, place_mm
from cortet.geometry.caps import cap
from cortet.geometry.mending import (
    REPLACED,
    Triangles,
    chosen_faces,
    edge_counts,
    faces_at,
    pieces,
    rings,
    split_fans,
    triangles,
)
from cortet.geometry.topology import TRI_EDGES, enclosed_volume
from cortet.meshes import FloatArray, IntArray

#: rings of triangles around a hole that its cap joins smoothly
_AROUND = 3


def rims(faces: IntArray) -> list[IntArray]:
    """Vertices of the rim of each hole, in the direction in which a cap's triangles run; longest rim first.

    Parameters
    ----------
    faces : (m, 3), consistently oriented, each vertex with one fan of faces (`mending.split_fans`)
    """
    sides = faces[:, TRI_EDGES][edge_counts(faces) == 1]
    after = {int(end): int(start) for start, end in sides}
    found = []
    while after:
        first = min(after)
        rim, vertex = [first], after.pop(first)
        while vertex != first:
            rim.append(vertex)
            vertex = after.pop(vertex)
        found.append(np.array(rim, np.int32))
    return sorted(found, key=lambda rim: (-len(rim), int(rim[0])))


def rim_length(points: FloatArray, rim: IntArray) -> float:
    """Length of a rim, mm."""
    places = points[rim]
    return float(np.linalg.norm(places - np.roll(places, -1, axis=0), axis=1).sum())


def capped(work: Triangles, rim: IntArray, made: int) -> Triangles:
    """The triangles with one hole closed by a smooth `cap`; given vertices stay where they are.

    Parameters
    ----------
    rim : one of `rims`
    made : the value of the new faces in `Triangles.made`
    """
    around, kept = _around(work, rim)
    local = {int(vertex): place for place, vertex in enumerate(kept)}
    points, faces = cap(around.points, around.faces, np.array([local[vertex] for vertex in rim.tolist()]))
    number = np.concatenate([kept, len(work.points) + np.arange(len(points), dtype=np.int32)])
    return Triangles(
        np.concatenate([work.points, points]),
        np.concatenate([work.faces, number[faces]]).astype(np.int32),
        np.concatenate([work.origin, np.full(len(points), -1, np.int32)]),
        np.concatenate([work.made, np.full(len(faces), made, np.int8)]),
    )


def replaced(work: Triangles, vertices: IntArray, max_piece: float, flaw: str) -> Triangles:
    """The triangles without the faces at some vertices; the holes are closed smoothly.

    Parameters
    ----------
    max_piece : largest share of the area of a piece that comes loose and is dropped
    flaw : what is wrong with the faces at these vertices, for messages

    Raises
    ------
    InputError
        a larger piece would come loose, nothing would be left, or a hole cannot be filled
    """
    marked = np.zeros(len(work.points), np.bool_)
    marked[vertices] = True
    rest, _ = split_fans(chosen_faces(work, ~faces_at(work.faces, marked)))
    if not len(rest.faces):
        raise InputError(f"{flaw}; cutting them out would leave nothing of the surface")
    piece, area = pieces(rest)
    if len(area) > 1 and area[1] > max_piece * area.sum():
        where = place_mm(rest.points[rest.faces[piece == 1]].mean(axis=(0, 1)))
        share = f"{area[1] / area.sum():.1%} of the area"
        raise InputError(f"{flaw}; cutting them out would also cut off {share}, around {where}")
    rest = chosen_faces(rest, piece == 0)
    for rim in rims(rest.faces):
        rest = capped(rest, rim, REPLACED)
    return rest


def _around(work: Triangles, rim: IntArray) -> tuple[Triangles, IntArray]:
    """A few rings of triangles around a hole as their own manifold, and the number in `work` of each vertex."""
    marked = np.zeros(len(work.points), np.bool_)
    marked[rim] = True
    near = rings(work.faces, marked, _AROUND - 1)
    faces = work.faces[near[work.faces].any(axis=1)]
    used, local = np.unique(faces, return_inverse=True)
    part, _ = split_fans(triangles(work.points[used], local.reshape(-1, 3).astype(np.int32)))
    return part, used[part.origin].astype(np.int32)


def closed_volume(work: Triangles) -> float:
    """Signed volume, mm3, inside the triangles; fans from the middles of the rims close the holes."""
    points, faces = [work.points], [work.faces]
    count = len(work.points)
    for rim in rims(work.faces):
        points.append(work.points[rim].mean(axis=0)[None])
        faces.append(np.stack([rim, np.roll(rim, -1), np.full(len(rim), count, np.int32)], axis=1))
        count += 1
    return enclosed_volume(np.concatenate(points), np.concatenate(faces))
