"""A triangulated surface as half-edges, and measures of it, which all operations of `_triangles` share.

Half-edge 3 f + i runs from corner i of face f to corner i + 1. A dead face has -1 as its first corner, a dead vertex -1
as its half-edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.meshes import FloatArray, IntArray

#: most triangles around an operation; with more, it is refused
MOST_FACES = 64


#: the normal of a triangle may turn by less than acos(this) in one operation
MIN_COSINE = 0.3


#: a triangle whose shape is below this is nearly flat: its normal says nothing, and TetGen may fail on it
FLAT = 0.05


class Work(NamedTuple):
    """A surface that is being remeshed, in arrays with room to grow, and the samples attached to its faces."""

    #: (n, 3) float64 mm
    points: FloatArray
    #: (n,) int32, triangle of the given surface (in tree order) that each vertex lies on
    on_triangle: IntArray
    #: (n,) float64 mm, target edge length
    size: FloatArray
    #: (n,) int32, a half-edge that leaves the vertex
    leaving: IntArray
    #: (m, 3) int32
    faces: IntArray
    #: (3 m,) int32, the same edge in the other direction
    opposite: IntArray
    #: (m,) int32, the first sample of each face, and (s,) int32, the one after each sample; -1 ends a list
    first: IntArray
    after: IntArray
    #: (s, 3) float64 mm, samples of the given surface
    samples: FloatArray
    #: (s,) float64 mm2, squared distance of each sample to its face, and its limit
    distance2: FloatArray
    limit2: FloatArray
    #: (2,) int64: vertices and faces in use, dead ones included
    used: NDArray[np.int64]


class Scratch(NamedTuple):
    """Working arrays of an operation before it is carried out."""

    #: faces whose samples are examined, and the triangles (9 coordinates) that replace them
    old: IntArray
    new: FloatArray
    #: boxes around these triangles: lowest and highest coordinates
    box: FloatArray
    #: samples of the old faces, the nearest new triangle of each, and the squared distance
    sample: IntArray
    nearest: IntArray
    distance2: FloatArray


def scratch(samples: int) -> Scratch:
    """Working arrays for operations on a surface with `samples` samples."""
    return Scratch(
        np.empty(MOST_FACES, np.int32),
        np.empty((MOST_FACES, 9)),
        np.empty((MOST_FACES, 6)),
        np.empty(samples, np.int32),
        np.empty(samples, np.int32),
        np.empty(samples),
    )


@numba.njit(cache=True, error_model="numpy", inline="always")
def next_of(h):  # type: ignore[no-untyped-def]
    return h - 2 if h % 3 == 2 else h + 1


@numba.njit(cache=True, error_model="numpy", inline="always")
def previous_of(h):  # type: ignore[no-untyped-def]
    return h + 2 if h % 3 == 0 else h - 1


@numba.njit(cache=True, error_model="numpy", inline="always")
def origin_of(w, h):  # type: ignore[no-untyped-def]
    return w.faces[h // 3, h % 3]


@numba.njit(cache=True, error_model="numpy")
def link(faces, opposite, leaving):  # type: ignore[no-untyped-def]
    """Fill `opposite` and `leaving` for the faces (m, 3) of a closed, oriented manifold."""
    m, n = len(faces), len(leaving)
    count = np.zeros(n + 1, np.int64)
    for f in range(m):
        for i in range(3):
            count[faces[f, i] + 1] += 1
            leaving[faces[f, i]] = 3 * f + i
    for v in range(n):
        count[v + 1] += count[v]
    at = count[:-1].copy()
    halfedge = np.empty(3 * m, np.int32)
    for h in range(3 * m):
        v = faces[h // 3, h % 3]
        halfedge[at[v]] = h
        at[v] += 1
    for h in range(3 * m):
        a, b = faces[h // 3, h % 3], faces[h // 3, (h % 3 + 1) % 3]
        for k in range(count[b], count[b + 1]):
            g = halfedge[k]
            if faces[g // 3, (g % 3 + 1) % 3] == a:
                opposite[h] = g


@numba.njit(cache=True, error_model="numpy")
def length_of(w, a, b):  # type: ignore[no-untyped-def]
    dx, dy, dz = w.points[a, 0] - w.points[b, 0], w.points[a, 1] - w.points[b, 1], w.points[a, 2] - w.points[b, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True, error_model="numpy")
def corners_of(w, f, moved, x, y, z, row):  # type: ignore[no-untyped-def]
    """Coordinates of face f, with vertex `moved` at (x, y, z)."""
    for i in range(3):
        v = w.faces[f, i]
        if v == moved:
            row[3 * i], row[3 * i + 1], row[3 * i + 2] = x, y, z
        else:
            row[3 * i], row[3 * i + 1], row[3 * i + 2] = w.points[v, 0], w.points[v, 1], w.points[v, 2]


@numba.njit(cache=True, error_model="numpy")
def set_corner(row, i, points, v):  # type: ignore[no-untyped-def]
    row[3 * i], row[3 * i + 1], row[3 * i + 2] = points[v, 0], points[v, 1], points[v, 2]


@numba.njit(cache=True, error_model="numpy")
def cross_of(c):  # type: ignore[no-untyped-def]
    """Normal of a triangle (9 coordinates), of length twice its area."""
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@numba.njit(cache=True, error_model="numpy")
def has_turned(new, old):  # type: ignore[no-untyped-def]
    """Whether the normal of a triangle has turned too far; a nearly flat old triangle has no normal to turn from."""
    if not shape_of(old) > FLAT:
        return False
    mx, my, mz = cross_of(old)
    nx, ny, nz = cross_of(new)
    was, now = mx * mx + my * my + mz * mz, nx * nx + ny * ny + nz * nz
    return not (nx * mx + ny * my + nz * mz > MIN_COSINE * np.sqrt(was * now))


@numba.njit(cache=True, error_model="numpy")
def shape_of(c):  # type: ignore[no-untyped-def]
    """4 sqrt(3) area over the sum of squared edges: 1 for the equilateral triangle, 0 for a flat one."""
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    nx, ny, nz = cross_of(c)
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    squares = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
    return 2 * np.sqrt(3.0) * np.sqrt(nx * nx + ny * ny + nz * nz) / squares if squares > 0 else 0.0


@numba.njit(cache=True, error_model="numpy")
def normal_of(w, f):  # type: ignore[no-untyped-def]
    """Normal of face f, of length twice its area."""
    a, b, c = w.points[w.faces[f, 0]], w.points[w.faces[f, 1]], w.points[w.faces[f, 2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@numba.njit(cache=True, error_model="numpy")
def valence_of(w, v):  # type: ignore[no-untyped-def]
    h = w.leaving[v]
    count = 0
    while True:
        count += 1
        h = w.opposite[previous_of(h)]
        if h == w.leaving[v]:
            return count


@numba.njit(cache=True, error_model="numpy")
def share_an_edge(w, a, b):  # type: ignore[no-untyped-def]
    """Whether an edge joins two vertices."""
    h = w.leaving[a]
    while True:
        if origin_of(w, next_of(h)) == b:
            return True
        h = w.opposite[previous_of(h)]
        if h == w.leaving[a]:
            return False


@numba.njit(cache=True, error_model="numpy")
def pair(w, h, g):  # type: ignore[no-untyped-def]
    w.opposite[h] = g
    w.opposite[g] = h


@numba.njit(cache=True, error_model="numpy")
def face_row(w, f):  # type: ignore[no-untyped-def]
    row = np.empty(9)
    corners_of(w, f, -1, 0.0, 0.0, 0.0, row)
    return row


@numba.njit(cache=True, error_model="numpy")
def limit_growth(faces, points, size, growth):  # type: ignore[no-untyped-def]
    """Lower `size` (n,) until along no edge of `faces` it grows by more than `growth` times the length of the edge."""
    changed = True
    while changed:
        changed = False
        for f in range(len(faces)):
            if faces[f, 0] < 0:
                continue
            for i in range(3):
                a, b = faces[f, i], faces[f, (i + 1) % 3]
                dx, dy, dz = points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], points[a, 2] - points[b, 2]
                rise = growth * np.sqrt(dx * dx + dy * dy + dz * dz)
                if size[a] > size[b] + rise * (1 + 1e-9):
                    size[a] = size[b] + rise
                    changed = True
                elif size[b] > size[a] + rise * (1 + 1e-9):
                    size[b] = size[a] + rise
                    changed = True
