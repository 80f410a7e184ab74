"""Neighbours of each tetrahedron, by counting instead of sorting, and faces that fit no body: O(cells)."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def behind_faces(cells, faces, vertex_count):  # type: ignore[no-untyped-def]
    """The tetrahedron behind the face opposite each corner: (m, 4) int32, -1 outside.

    Faces are sorted into four buckets per smallest vertex; the two sides of a face meet in a bucket of about six.

    Parameters
    ----------
    cells : (m, 4) int32
    faces : (4, 3), corners of the face opposite each corner
    """
    m = len(cells)
    offsets = np.zeros(4 * vertex_count + 1, np.int64)
    for e in range(m):
        for k in range(4):
            low, middle, high = _sorted(cells, faces, e, k)
            offsets[4 * low + (middle + high) % 4 + 1] += 1
    offsets = np.cumsum(offsets)
    free = offsets[:-1].copy()
    bucket = np.empty((4 * m, 2), np.int32)  # the other two vertices of each face
    number = np.empty(4 * m, np.int64)
    for e in range(m):
        for k in range(4):
            low, middle, high = _sorted(cells, faces, e, k)
            slot = 4 * low + (middle + high) % 4
            at = free[slot]
            bucket[at, 0], bucket[at, 1], number[at] = middle, high, 4 * e + k
            free[slot] += 1
    behind = np.full(4 * m, -1, np.int32)
    for slot in range(4 * vertex_count):
        for i in range(offsets[slot], offsets[slot + 1]):
            for j in range(i + 1, offsets[slot + 1]):
                if bucket[i, 0] == bucket[j, 0] and bucket[i, 1] == bucket[j, 1]:
                    behind[number[i]], behind[number[j]] = number[j] // 4, number[i] // 4
    return behind.reshape(m, 4)


@numba.njit(cache=True, error_model="numpy")
def _sorted(cells, faces, e, k):  # type: ignore[no-untyped-def]
    """Vertices of a face, ascending."""
    a, b, c = cells[e, faces[k, 0]], cells[e, faces[k, 1]], cells[e, faces[k, 2]]
    return min(a, b, c), max(min(a, b), min(max(a, b), c)), max(a, b, c)


@numba.njit(parallel=True, cache=True, error_model="numpy")
def wrong_faces(points, cells, faces, behind):  # type: ignore[no-untyped-def]
    """Fault of the face opposite each corner: (m, 4) int8, 0: none, 1: folded, 2: in more than two tetrahedra.

    A folded face has both its tetrahedra on one side; it is flagged in the first of them. If a face is in more than
    two tetrahedra, all but two of them flag it: `behind_faces` pairs only the last two with each other.

    Parameters
    ----------
    points : (n, 3); they show which tetrahedra are inverted
    cells : (m, 4) int32
    faces : (4, 3), corners of the face opposite each corner, outward
    behind : result of `behind_faces`
    """
    wrong = np.zeros((len(cells), 4), np.int8)
    inverted = np.empty(len(cells), np.bool_)
    for e in numba.prange(len(cells)):
        inverted[e] = _is_inverted(points, cells, e)
    for e in numba.prange(len(cells)):
        for k in range(4):
            wrong[e, k] = _fault(inverted, cells, faces, behind, e, k)
    return wrong


@numba.njit(cache=True, error_model="numpy", inline="always")
def _fault(inverted, cells, faces, behind, e, k):  # type: ignore[no-untyped-def]
    """Fault of one face, as in `wrong_faces`."""
    f, fault = behind[e, k], 0
    if f < 0:
        return fault
    face = _sorted(cells, faces, e, k)
    fourth = cells[f, 0] + cells[f, 1] + cells[f, 2] + cells[f, 3] - face[0] - face[1] - face[2]
    for j in range(4):
        if cells[f, j] != fourth or _sorted(cells, faces, f, j) != face:
            continue
        if behind[f, j] != e:
            fault = 2
        elif f > e:
            same_turn = _is_odd(cells, faces, e, k) == _is_odd(cells, faces, f, j)
            if same_turn == (inverted[e] == inverted[f]):
                fault = 1
    return fault


@numba.njit(cache=True, error_model="numpy", inline="always")
def _is_inverted(points, cells, e):  # type: ignore[no-untyped-def]
    """Whether a tetrahedron has negative volume."""
    a, b, c, d = cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3]
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    wx, wy, wz = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1], points[d, 2] - points[a, 2]
    return (uy * vz - uz * vy) * wx + (uz * vx - ux * vz) * wy + (ux * vy - uy * vx) * wz < 0


@numba.njit(cache=True, error_model="numpy", inline="always")
def _is_odd(cells, faces, e, k):  # type: ignore[no-untyped-def]
    """Whether it takes an odd number of swaps to sort the corners of a face."""
    a, b, c = cells[e, faces[k, 0]], cells[e, faces[k, 1]], cells[e, faces[k, 2]]
    return (a > b) ^ (b > c) ^ (a > c)
