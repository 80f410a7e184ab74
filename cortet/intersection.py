"""Triangles of a surface that pass through others of the same surface."""

from __future__ import annotations

import numba
import numpy as np

from cortet.mesh import IntArray, TriSurface
from cortet.optimise.closest_point import surface_tree

_STACK_SIZE = 128


def self_intersections(surface: TriSurface) -> IntArray:
    """Faces that cross another face of the same surface: (f,) int32, ascending; O(m log m).

    Triangles that share no vertex cross when an edge of one passes through the other. Neighbours in one vertex cross
    when the edge opposite that vertex passes through the other. Neighbours in an edge cross only when one is folded
    flat onto the other. Signs of floating-point volumes decide, zero counting as positive: exact contact of separate
    triangles, which has no volume, is not a crossing.
    """
    tree = surface_tree(surface.points, surface.faces)
    crossing = np.zeros(len(surface.faces), np.bool_)
    _mark(tree, surface.faces, crossing)
    return np.flatnonzero(crossing).astype(np.int32)


@numba.njit(cache=True)
def _mark(tree, faces, crossing):  # type: ignore[no-untyped-def]
    """Walk the tree with the box of every triangle and test it against the later triangles in the leaves it meets."""
    corners, boxes, child, size = tree.corners, tree.boxes, tree.child, tree.size
    stack = np.empty(_STACK_SIZE, np.int32)
    low, high = np.empty(3), np.empty(3)
    for i in range(len(corners)):
        for k in range(3):
            low[k] = min(corners[i, k], corners[i, k + 3], corners[i, k + 6])
            high[k] = max(corners[i, k], corners[i, k + 3], corners[i, k + 6])
        stack[0], top = 0, 1
        while top:
            top -= 1
            box = stack[top]
            apart = False
            for k in range(3):
                apart |= boxes[box, k] > high[k] or boxes[box, k + 3] < low[k]
            if apart:
                continue
            if size[box] == 0:
                stack[top], stack[top + 1] = child[box], child[box] + 1
                top += 2
                continue
            for j in range(max(child[box], i + 1), child[box] + size[box]):
                apart = False
                for k in range(3):
                    x, y, z = corners[j, k], corners[j, k + 3], corners[j, k + 6]
                    apart |= min(x, y, z) > high[k] or max(x, y, z) < low[k]
                if not apart and _cross(corners[i], corners[j], faces[tree.faces[i]], faces[tree.faces[j]]):
                    crossing[tree.faces[i]] = crossing[tree.faces[j]] = True


@numba.njit(cache=True)
def _cross(t, u, vertices_t, vertices_u):  # type: ignore[no-untyped-def]
    """Whether two triangles (9 coordinates each) of one surface pass through each other."""
    shared, in_t, in_u = 0, 0, 0
    for i in range(3):
        for j in range(3):
            if vertices_t[i] == vertices_u[j]:
                shared += 1
                in_t, in_u = in_t + i, in_u + j  # with two shared corners the third is 3 minus this sum
    if shared == 0:
        for k in range(3):  # noqa: SIM110 -- Numba compiles no generators
            if _pierces(t, k, u) or _pierces(u, k, t):
                return True
        return False
    if shared == 1:  # edge k runs from corner k to the next: the one opposite corner c is c + 1
        return _pierces(t, (in_t + 1) % 3, u) or _pierces(u, (in_u + 1) % 3, t)
    if shared == 2:
        return _folded(t, 3 - in_t, u, 3 - in_u)
    return True


@numba.njit(cache=True)
def _volume(p, a, b, c):  # type: ignore[no-untyped-def]
    """Six times the signed volume of the tetrahedron of points p, a, b, c."""
    ux, uy, uz = a[0] - p[0], a[1] - p[1], a[2] - p[2]
    vx, vy, vz = b[0] - p[0], b[1] - p[1], b[2] - p[2]
    wx, wy, wz = c[0] - p[0], c[1] - p[1], c[2] - p[2]
    return ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)


@numba.njit(cache=True)
def _pierces(t, k, u):  # type: ignore[no-untyped-def]
    """Whether edge k of triangle t passes through triangle u."""
    p, q = t[3 * k : 3 * k + 3], t[3 * ((k + 1) % 3) : 3 * ((k + 1) % 3) + 3]
    a, b, c = u[0:3], u[3:6], u[6:9]
    if (_volume(p, a, b, c) >= 0) == (_volume(q, a, b, c) >= 0):
        return False
    side = _volume(p, q, a, b) >= 0
    return side == (_volume(p, q, b, c) >= 0) and side == (_volume(p, q, c, a) >= 0)


@numba.njit(cache=True)
def _folded(t, i, u, j):  # type: ignore[no-untyped-def]
    """Whether two triangles with a common edge, opposite corners i and j, lie flat on each other."""
    a, b = t[3 * ((i + 1) % 3) : 3 * ((i + 1) % 3) + 3], t[3 * ((i + 2) % 3) : 3 * ((i + 2) % 3) + 3]
    edge, first, second = b - a, t[3 * i : 3 * i + 3] - a, u[3 * j : 3 * j + 3] - a
    m, n = np.cross(edge, first), np.cross(edge, second)
    sine = np.cross(m, n)
    dot = (m * n).sum()
    return dot > 0 and (sine * sine).sum() <= 1e-24 * dot * dot
