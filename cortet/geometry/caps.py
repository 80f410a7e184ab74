"""Smooth caps on holes of a surface (Liepa, Filling holes in meshes, SGP 2003).

The rim of a hole is triangulated. Triangles are split until they are as large as those around the hole, their edges are
flipped, and new vertices are placed where the surface bends least. CGAL does the same, but it works through sets of
addresses in memory, so its triangles differ from run to run.
"""

from __future__ import annotations

from collections.abc import Iterable

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags, identity
from scipy.sparse.linalg import splu

from cortet.geometry.topology import edges
from cortet.meshes import FloatArray, IntArray

#: corners of a triangle, or numbers of two vertices, the smaller one first
_Face = tuple[int, int, int]
_Edge = tuple[int, int]
#: sum of the two angles opposite an edge above which it is flipped, radians; rounding must not flip it back
_FLAT = np.pi + 1e-6
#: most rounds of splitting: each divides a triangle by three
_ROUNDS = 20


def cap(points: FloatArray, faces: IntArray, rim: IntArray) -> tuple[FloatArray, IntArray]:
    """New vertices (k, 3), numbered after the given ones, and triangles (m, 3) that close a hole.

    Parameters
    ----------
    points, faces : a few rings of triangles around the hole, a manifold
    rim : vertices of the hole's rim, in the direction in which the triangles of the cap run
    """
    refined, made = _refined(points, faces, _triangulated(points, faces, rim))
    triangles = np.array(made, np.int32)
    free = np.arange(len(points), len(refined))
    return faired(refined, np.concatenate([faces, triangles]), free), triangles


def faired(points: FloatArray, faces: IntArray, free: NDArray[np.int64]) -> FloatArray:
    """Positions of the `free` vertices (f,) at which the surface bends least, without a kink at their rim: (f, 3) mm.

    The Laplacian of the Laplacian is zero at these positions; its weights are the inverse edge lengths (Liepa 2003).

    Parameters
    ----------
    points, faces : at least two rings of given triangles surround the free vertices
    """
    if not len(free):
        return np.zeros((0, 3))
    start, end = edges(faces).T
    weights = 1 / np.maximum(np.linalg.norm(points[start] - points[end], axis=1), np.finfo(np.float32).tiny)
    both = np.concatenate([start, end]), np.concatenate([end, start])
    link = coo_matrix((np.tile(weights, 2), both), shape=(len(points),) * 2).tocsr()
    total = np.asarray(link.sum(axis=1)).ravel()
    laplacian = (diags(1 / total) @ link - identity(len(points))).tocsr()
    rows = (laplacian[free] @ laplacian).tocsc()
    known = np.setdiff1d(np.arange(len(points)), free)
    solve = splu(rows[:, free])
    return np.ascontiguousarray(solve.solve(-(rows[:, known] @ points[known])))


def _triangulated(points: FloatArray, faces: IntArray, rim: IntArray) -> list[_Face]:
    """The triangles between the vertices of a rim that bend least, then with the least area (Liepa 2003)."""
    beyond = {(a, b): c for face in faces.tolist() for a, b, c in _turns(face)}
    sides = zip(rim.tolist(), np.roll(rim, -1).tolist(), strict=True)
    thirds = [beyond[end, start] for start, end in sides]
    middle = _middles(points[rim], points[thirds])
    found: list[_Face] = []
    parts = [(0, len(rim) - 1)]
    while parts:
        first, last = parts.pop()
        if last > first + 1:
            between = int(middle[first, last])
            found.append((int(rim[first]), int(rim[between]), int(rim[last])))
            parts += [(first, between), (between, last)]
    return found


@numba.njit(cache=True, error_model="numpy")
def _middles(rim: FloatArray, beyond: FloatArray) -> NDArray[np.int64]:
    """For the part of a rim between two of its points, the third corner of the triangle on its chord: (n, n).

    Parameters
    ----------
    rim : (n, 3)
    beyond : (n, 3), third corner of the triangle outside, at the side from each point to the next
    """
    n = len(rim)
    middle = np.zeros((n, n), np.int64)
    bend, area = np.zeros((n, n)), np.zeros((n, n))
    for width in range(2, n):
        for first in range(n - width):
            last = first + width
            least, smallest = np.inf, np.inf
            for between in range(first + 1, last):
                most = max(bend[first, between], bend[between, last])
                if most > least:
                    continue
                a, b, c = rim[first], rim[between], rim[last]
                before = beyond[first] if between == first + 1 else rim[middle[first, between]]
                after = beyond[between] if last == between + 1 else rim[middle[between, last]]
                most = max(most, _bend(a, b, c, before), _bend(b, c, a, after))
                if width == n - 1:
                    most = max(most, _bend(c, a, b, beyond[last]))
                normal = _normal(a, b, c)
                total = area[first, between] + area[between, last] + np.sqrt(_dot(normal, normal)) / 2
                if most < least or (most == least and total < smallest):
                    least, smallest = most, total
                    middle[first, last] = between
            bend[first, last], area[first, last] = least, smallest
    return middle


@numba.njit(cache=True, error_model="numpy")
def _bend(start: FloatArray, end: FloatArray, inner: FloatArray, outer: FloatArray) -> float:
    """Angle between the normals of two triangles at an edge, from 0, flat, to pi, folded; 0 for one without area."""
    return _between(_normal(start, end, inner), _normal(start, outer, end))


@numba.njit(cache=True, error_model="numpy")
def _between(u, v):  # type: ignore[no-untyped-def]
    """The angle between two vectors."""
    across = _cross(u, v)
    return np.arctan2(np.sqrt(_dot(across, across)), _dot(u, v))


@numba.njit(cache=True, error_model="numpy")
def _normal(a, b, c):  # type: ignore[no-untyped-def]
    """The normal of a triangle, twice as long as its area; numbers alone, since arrays would take ten times as long."""
    return _cross((b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]))


@numba.njit(cache=True, error_model="numpy")
def _cross(u, v):  # type: ignore[no-untyped-def]
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@numba.njit(cache=True, error_model="numpy")
def _dot(u, v):  # type: ignore[no-untyped-def]
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _refined(points: FloatArray, around: IntArray, faces: list[_Face]) -> tuple[FloatArray, list[_Face]]:
    """Split the triangles of a cap until they are as large as those around it; all points, and the triangles."""
    ends = edges(around)
    length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    count = np.bincount(ends.ravel(), minlength=len(points))
    size = np.bincount(ends.ravel(), np.repeat(length, 2), minlength=len(points)) / np.maximum(count, 1)
    taken = {tuple(sorted(edge)) for edge in ends.tolist()}
    for _ in range(_ROUNDS):
        faces = _flipped(points, faces, taken)
        corners = np.array(faces, np.int32)
        centres, sizes = points[corners].mean(axis=1), size[corners].mean(axis=1)
        away = np.sqrt(2) * np.linalg.norm(points[corners] - centres[:, None], axis=2)
        large = (away > np.maximum(sizes[:, None], size[corners])).all(axis=1)
        if not large.any():
            break
        new = len(points) + np.arange(large.sum())
        points, size = np.concatenate([points, centres[large]]), np.concatenate([size, sizes[large]])
        kept = [face for face, split in zip(faces, large, strict=True) if not split]
        parts = zip(corners[large].tolist(), new.tolist(), strict=True)
        faces = kept + [(a, b, vertex) for face, vertex in parts for a, b, _ in _turns(face)]
    return points, faces


def _flipped(points: FloatArray, faces: list[_Face], taken: set[_Edge]) -> list[_Face]:
    """Flip edges between triangles of a cap until the angles opposite each of them are small enough (Delaunay).

    Parameters
    ----------
    taken : edges of the triangles around, which the cap must not have again
    """
    faces = list(faces)
    owner = {(a, b): number for number, face in enumerate(faces) for a, b, _ in _turns(face)}
    waiting = sorted((a, b) for a, b in owner if a < b and (b, a) in owner)
    for _ in range(20 * len(faces)):
        if not waiting:
            break
        a, b = waiting.pop()
        if (a, b) not in owner or (b, a) not in owner:
            continue
        one, other = owner[a, b], owner[b, a]
        (c,), (d,) = ({*faces[number]} - {a, b} for number in (one, other))
        is_there = (c, d) in owner or (d, c) in owner or (min(c, d), max(c, d)) in taken
        twice = (min(a, b), max(a, b)) in taken
        if is_there or not (twice or _angle(points, a, c, b) + _angle(points, a, d, b) > _FLAT):
            continue
        del owner[a, b], owner[b, a]
        faces[one], faces[other] = (a, d, c), (d, b, c)
        owner |= {edge[:2]: number for number in (one, other) for edge in _turns(faces[number])}
        waiting += [(a, d), (d, b), (b, c), (c, a)]
    return faces


@numba.njit(cache=True, error_model="numpy")
def _angle(points: FloatArray, start: int, at: int, end: int) -> float:
    """The angle of a triangle at one of its corners."""
    a, b, c = points[start], points[at], points[end]
    return _between((a[0] - b[0], a[1] - b[1], a[2] - b[2]), (c[0] - b[0], c[1] - b[1], c[2] - b[2]))


def _turns(face: Iterable[int]) -> list[_Face]:
    """The corners of a triangle from each of them on."""
    a, b, c = face
    return [(a, b, c), (b, c, a), (c, a, b)]
