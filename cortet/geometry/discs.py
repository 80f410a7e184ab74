"""Discs on a triangulated surface, and the load of each vertex when a uniform current flows through one.

A disc is the part of the surface around a point whose orthogonal projection onto the tangent plane there lies inside a
circle. The circle cuts faces anywhere, and needs no edges along it: the integrals over the part of each face inside it
are exact, since by Green's theorem they are sums over the sides of the face, inside the circle along the side, outside
along the arc.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.remembering import once_per_object
from cortet.geometry.topology import face_normals, linked, sides_of, unit_vectors, vertex_normals
from cortet.meshes import FloatArray, IntArray, TriSurface

#: cosine of 60 degrees: faces that are steeper against the disc belong to the bank of a sulcus, not to the disc
STEEPEST = 0.5
#: a face with less than this share of its area in the circle is not touched: so much is rounding
_TOUCHED = 1e-12


class Disc(NamedTuple):
    """A disc on a surface."""

    #: (k,) int32, vertices of its faces, ascending
    vertices: IntArray
    #: (k,) integral of the hat function of each over the disc, divided by the disc's area; sum 1
    loads: FloatArray
    #: (f,) int32, faces that have a part in it, ascending
    faces: IntArray
    #: mm2, along the surface
    area: float


def disc(surface: TriSurface, face: int, weights: FloatArray, radius: float) -> Disc:
    """The disc around a point of a surface.

    Faces count if they are connected with that of the centre through others of the disc, and turned from the normal by
    at most 60 degrees; so the opposite bank of a sulcus, or a surface below, never belongs to it.

    Parameters
    ----------
    surface : triangles counter-clockwise seen from outside
    face, weights : where the centre lies: the number of its face, and the weights of that face's corners, (3,)
    radius : mm
    """
    points, faces = surface.points, surface.faces
    centre, normal = weights @ points[faces[face]], _normal(surface, face, weights)
    corners = points[faces]
    # a chain of faces that are not steep is at most 1 / cos as long as its projection
    reach = radius / STEEPEST + np.linalg.norm(corners - corners[:, :1], axis=2).max(axis=1)
    near = np.linalg.norm(corners[:, 0] - centre, axis=1) <= reach
    near[face] = True
    chosen = np.flatnonzero(near)
    corners = corners[chosen] - centre
    cosine = unit_vectors(face_normals(points, faces[chosen])) @ normal
    flat = corners @ _plane(normal)
    sides = flat[:, [1, 2, 0]] - flat
    whole = np.abs(_cross(sides[:, 0], sides[:, 1])) / 2
    area, moment = circle_integrals(flat, radius)
    touched = (cosine >= STEEPEST) & (area > _TOUCHED * whole)
    touched[touched] = _connected(faces[chosen[touched]], int(np.searchsorted(chosen[touched], face)))
    chosen, flat, area, moment = chosen[touched], flat[touched], area[touched], moment[touched]
    of_corners = _hat_integrals(flat, area, moment) / cosine[touched, None]
    vertices, inverse = np.unique(faces[chosen], return_inverse=True)
    loads = np.bincount(inverse.ravel(), of_corners.ravel())
    total = float(loads.sum())
    return Disc(vertices.astype(np.int32), loads / total, chosen.astype(np.int32), total)


def circle_integrals(triangles: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Area and first moments of the part of plane triangles inside a circle around the origin, exact.

    Parameters
    ----------
    triangles : (k, 3, 2), counter-clockwise; the integrals of clockwise ones are negative

    Returns
    -------
    (k,) integrals of 1, and (k, 2) of the coordinates
    """
    start, end = triangles, np.roll(triangles, -1, axis=1)
    way = end - start
    # where a side enters and leaves the circle, as fractions of its length; 0 and 0 if it stays outside
    a = (way**2).sum(axis=2)
    b = (start * way).sum(axis=2)
    inside = b**2 - a * ((start**2).sum(axis=2) - radius**2)
    meets = (inside > 0) & (a > 0)
    root, length = np.sqrt(np.where(meets, inside, 0)), np.where(a > 0, a, 1)
    first = np.where(meets, np.clip((-b - root) / length, 0, 1), 0)[..., None]
    last = np.where(meets, np.clip((-b + root) / length, 0, 1), 0)[..., None]
    entry, leaving = start + first * way, start + last * way
    chord = _cross(entry, leaving) / 2
    area = chord + _sector(start, entry, first > 0, radius)[0] + _sector(leaving, end, last < 1, radius)[0]
    moment = chord[..., None] * (entry + leaving) / 3
    moment += _sector(start, entry, first > 0, radius)[1] + _sector(leaving, end, last < 1, radius)[1]
    return area.sum(axis=1), moment.sum(axis=1)


def _sector(
    start: FloatArray, end: FloatArray, counts: NDArray[np.bool_], radius: float
) -> tuple[FloatArray, FloatArray]:
    """Area and moments of the sectors between the directions of two points outside the circle, (k, 3, 2); else zero."""
    angle = np.arctan2(_cross(start, end), (start * end).sum(axis=2))
    first, last = (unit_vectors(ends.reshape(-1, 2)).reshape(ends.shape) for ends in (start, end))
    moment = np.stack([last[..., 1] - first[..., 1], first[..., 0] - last[..., 0]], axis=2)
    return np.where(counts[..., 0], angle, 0) * radius**2 / 2, np.where(counts, moment, 0) * radius**3 / 3


def _hat_integrals(triangles: FloatArray, area: FloatArray, moment: FloatArray) -> FloatArray:
    """Integrals of the hat functions of the corners, (k, 3): a hat function is linear, with its value at the centroid.

    Parameters
    ----------
    triangles : (k, 3, 2)
    area, moment : of the part that counts, (k,) and (k, 2)
    """
    middle = triangles.mean(axis=1)
    opposite = np.roll(triangles, -2, axis=1) - np.roll(triangles, -1, axis=1)
    twice = _cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    gradient = np.stack([-opposite[..., 1], opposite[..., 0]], axis=2) / twice[:, None, None]
    off = moment - area[:, None] * middle
    return area[:, None] / 3 + np.einsum("kcj,kj->kc", gradient, off)


@once_per_object
def _vertex_normals(surface: TriSurface) -> FloatArray:
    return vertex_normals(surface.points, surface.faces)


def _normal(surface: TriSurface, face: int, weights: FloatArray) -> FloatArray:
    """The unit normal at a point, between those of its face's corners; that of the face where they differ too much."""
    corners = surface.faces[face]
    flat, round_one = unit_vectors(
        np.stack([face_normals(surface.points, corners[None])[0], weights @ _vertex_normals(surface)[corners]])
    )
    chosen: FloatArray = round_one if round_one @ flat >= STEEPEST else flat
    return chosen


def _plane(normal: FloatArray) -> FloatArray:
    """Two axes that span the plane with this unit normal, (3, 2), right-handed with it."""
    least = np.eye(3)[np.abs(normal).argmin()]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first)])


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    found: FloatArray = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return found


def _connected(faces: IntArray, start: int) -> NDArray[np.bool_]:
    """Which faces are connected by edges with one of them: (m,)."""
    sides = sides_of(faces)
    label = linked(sides.first // 3, sides.second // 3, len(faces))
    return np.asarray(label == label[start])
