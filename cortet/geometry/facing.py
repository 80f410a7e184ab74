"""The nearest triangle that faces a triangle across the outside of a surface (compiled).

The distance of two triangles is the least of six distances of a vertex to a triangle and nine of two edges (Ericson,
Real-Time Collision Detection, 5.1.9 and 5.1.10).
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from cortet.geometry.closest_point import on_triangle, tree_of, triangle_normal
from cortet.meshes import FloatArray, IntArray, TriSurface

_STACK_SIZE = 64
#: cosine of the way to a triangle and its normal above which the way lies in front of it and not along it
_LEAST_COSINE = 0.1


class Facing(NamedTuple):
    """For each triangle of a surface, the nearest one that it faces."""

    #: (m,) float64 mm, infinite where no triangle is within reach
    distances: FloatArray
    #: (m, 3) float64 mm, the middle of the shortest way to that triangle
    middles: FloatArray
    #: (m,) int32, that triangle, -1 if there is none
    others: IntArray


def facing(surface: TriSurface, reach: float) -> Facing:
    """Find for each triangle the nearest one that it faces.

    Two triangles face each other if they share no vertex and the shortest way from one to the other lies outside the
    surface, in front of both.

    Parameters
    ----------
    surface : triangles outward
    reach : mm; triangles farther away do not count
    """
    tree = tree_of(surface)
    vertices = surface.faces[tree.faces]
    distance, middle, other = _facing(vertices, tree.corners, tree.boxes, tree.child, tree.size, reach)
    place = np.argsort(tree.faces)  # of each triangle in the tree
    return Facing(distance[place], middle[place], np.where(other < 0, -1, tree.faces[other])[place].astype(np.int32))


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _facing(vertices, corners, boxes, child, size, reach):  # type: ignore[no-untyped-def]
    m = len(corners)
    distance, middle, other = np.full(m, np.inf), np.zeros((m, 3)), np.full(m, -1)
    for i in numba.prange(m):
        _nearest(i, vertices, corners, boxes, child, size, reach, distance, middle, other)
    return distance, middle, other


@numba.njit(cache=True, error_model="numpy")
def _nearest(i, vertices, corners, boxes, child, size, reach, distance, middle, other):  # type: ignore[no-untyped-def]
    stack, way = np.empty(_STACK_SIZE, np.int64), np.empty(6)
    mine = corners[i]
    nx, ny, nz = triangle_normal(mine)
    stack[0], top = 0, 1
    while top:
        top -= 1
        box = stack[top]
        within = min(reach, distance[i])
        apart = False
        for k in range(3):
            low, high = min(mine[k], mine[k + 3], mine[k + 6]), max(mine[k], mine[k + 3], mine[k + 6])
            apart |= boxes[box, k] > high + within or boxes[box, k + 3] < low - within
        if apart:
            continue
        if not size[box]:
            stack[top], stack[top + 1] = child[box], child[box] + 1
            top += 2
            continue
        for j in range(child[box], child[box] + size[box]):
            ox, oy, oz = triangle_normal(corners[j])
            if not nx * ox + ny * oy + nz * oz < 0 or _share_a_vertex(vertices[i], vertices[j]):
                continue
            length = _shortest_way(mine, corners[j], way)
            dx, dy, dz = way[3] - way[0], way[4] - way[1], way[5] - way[2]
            least = _LEAST_COSINE * length
            in_front = dx * nx + dy * ny + dz * nz > least and dx * ox + dy * oy + dz * oz < -least
            if in_front and length < min(reach, distance[i]):
                distance[i], other[i] = length, j
                for k in range(3):
                    middle[i, k] = (way[k] + way[k + 3]) / 2


@numba.njit(cache=True, error_model="numpy")
def _share_a_vertex(one, other):  # type: ignore[no-untyped-def]
    for i in range(3):
        for j in range(3):
            if one[i] == other[j]:
                return True
    return False


@numba.njit(cache=True, error_model="numpy")
def _shortest_way(a, b, way):  # type: ignore[no-untyped-def]
    """Write the nearest points of two triangles (9 coordinates) that do not cross to `way`; return their distance."""
    best = np.inf
    for turn in range(2):
        one, other = (a, b) if turn == 0 else (b, a)
        for i in range(3):
            x, y, z = one[3 * i], one[3 * i + 1], one[3 * i + 2]
            u, v, w = on_triangle(other, x, y, z)
            px = u * other[0] + v * other[3] + w * other[6]
            py = u * other[1] + v * other[4] + w * other[7]
            pz = u * other[2] + v * other[5] + w * other[8]
            far = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
            if far < best:
                best = far
                first = 0 if turn == 0 else 3
                way[first], way[first + 1], way[first + 2] = x, y, z
                way[3 - first], way[4 - first], way[5 - first] = px, py, pz
    for i in range(3):
        p, d = a[3 * i : 3 * i + 3], np.empty(3)
        for k in range(3):
            d[k] = a[3 * ((i + 1) % 3) + k] - p[k]
        for j in range(3):
            q, e = b[3 * j : 3 * j + 3], np.empty(3)
            for k in range(3):
                e[k] = b[3 * ((j + 1) % 3) + k] - q[k]
            s, t = _on_lines(p, d, q, e)
            if not (0 < s < 1 and 0 < t < 1):
                continue  # then an end of an edge is nearest
            far = 0.0
            for k in range(3):
                far += (p[k] + s * d[k] - q[k] - t * e[k]) ** 2
            if far < best:
                best = far
                for k in range(3):
                    way[k], way[k + 3] = p[k] + s * d[k], q[k] + t * e[k]
    return np.sqrt(best)


@numba.njit(cache=True, error_model="numpy")
def _on_lines(p, d, q, e):  # type: ignore[no-untyped-def]
    """Parameters of the nearest points of two lines p + s d and q + t e; not a number if they are parallel."""
    dd = de = ee = dr = er = 0.0
    for k in range(3):
        r = p[k] - q[k]
        dd += d[k] * d[k]
        de += d[k] * e[k]
        ee += e[k] * e[k]
        dr += d[k] * r
        er += e[k] * r
    denominator = dd * ee - de * de
    return (de * er - ee * dr) / denominator, (dd * er - de * dr) / denominator
