"""Exact closest points on a triangulated surface, by a bounding-volume tree that kernels can walk.

The tree is a plain tuple of arrays, so the vertex optimiser can project single points inside its loops. A query that
starts with the distance to a nearby triangle as its bound visits a handful of boxes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.geometry.remembering import once_per_object
from cortet.meshes import FloatArray, IntArray, TriSurface

_LEAF_SIZE = 4
_STACK_SIZE = 64
#: queries per block; a thread answers whole blocks, so the result does not depend on the number of threads
_BLOCK = 256


class SurfaceTree(NamedTuple):
    """Boxes of triangles. Children of an inner box are `child` and `child + 1`; a leaf holds `size` triangles."""

    #: (m, 9) float64, corner coordinates of the triangles in tree order
    corners: FloatArray
    #: (m,) int32, index of each of these triangles in the surface
    faces: IntArray
    #: (b, 6) float64, lower and upper corner of each box
    boxes: FloatArray
    #: (b,) int32, first child of an inner box or first triangle of a leaf
    child: IntArray
    #: (b,) int32, number of triangles of a leaf, 0 for an inner box
    size: IntArray
    #: (m,) int32, root box of the surface that each triangle belongs to; 0 for the first surface
    root: IntArray


class ClosestPoints(NamedTuple):
    """The nearest point of the surface to each of k queries."""

    #: (k, 3) float64 mm
    points: FloatArray
    #: (k,) int32, triangle it lies in
    faces: IntArray
    #: (k, 3) float64, weights of the corners of that triangle, none negative, sum 1
    barycentric: FloatArray
    #: (k,) float64 mm
    distances: FloatArray


def surface_tree(points: FloatArray, faces: IntArray) -> SurfaceTree:
    """Build the tree for a surface of `points` (n, 3) mm and `faces` (m, 3); O(m log m)."""
    corners = np.ascontiguousarray(points[faces].reshape(-1, 9))
    order, boxes, child, size = _build(corners)
    root = np.zeros(len(order), np.int32)
    return SurfaceTree(corners[order], order.astype(np.int32), boxes, child, size, root)


def forest(surface: TriSurface) -> SurfaceTree:
    """One tree for a surface and its inner surfaces.

    A search that starts from a triangle stays on the surface of that triangle. Any other search is on the first
    surface. Faces are numbered consecutively, surface by surface.
    """
    trees = [tree_of(one) for one in (surface, *surface.inner.values())]
    if len(trees) == 1:
        return trees[0]
    triangles = np.cumsum([0, *(len(tree.faces) for tree in trees)])
    boxes = np.cumsum([0, *(len(tree.boxes) for tree in trees)])
    return SurfaceTree(
        corners=np.concatenate([tree.corners for tree in trees]),
        faces=np.concatenate([tree.faces + first for tree, first in zip(trees, triangles, strict=False)]).astype(
            np.int32
        ),
        boxes=np.concatenate([tree.boxes for tree in trees]),
        child=np.concatenate(
            [
                np.where(tree.size > 0, tree.child + first, tree.child + box)
                for tree, first, box in zip(trees, triangles, boxes, strict=False)
            ]
        ).astype(np.int32),
        size=np.concatenate([tree.size for tree in trees]),
        root=np.concatenate([tree.root + box for tree, box in zip(trees, boxes, strict=False)]).astype(np.int32),
    )


def first_triangles(tree: SurfaceTree) -> NDArray[np.int64]:
    """One triangle, in tree order, of each surface of a forest: (surfaces,)."""
    return np.unique(tree.root, return_index=True)[1]


@once_per_object
def tree_of(surface: TriSurface) -> SurfaceTree:
    """The tree of a surface, built on first use and kept as long as the surface lives."""
    return surface_tree(surface.points, surface.faces)


def closest_points(tree: SurfaceTree, queries: FloatArray) -> ClosestPoints:
    """Nearest point of the surface to each of `queries` (k, 3) mm."""
    return ClosestPoints(*_closest_points(tuple(tree), np.ascontiguousarray(queries, dtype=np.float64)))


def closer_than(tree: SurfaceTree, queries: FloatArray, distance: float) -> NDArray[np.bool_]:
    """Whether each of `queries` (k, 3) mm is closer to the surface than `distance` mm."""
    return _closer_than(tuple(tree), np.ascontiguousarray(queries, dtype=np.float64), distance)


@numba.njit(cache=True, error_model="numpy")
def _build(corners: NDArray[np.float64]):  # type: ignore[no-untyped-def]
    """Split boxes at the median centroid along their longest side until each leaf is small enough."""
    m = len(corners)
    centroids, around = np.empty((m, 3)), np.empty((m, 6))
    for i in range(m):
        for k in range(3):
            a, b, c = corners[i, k], corners[i, k + 3], corners[i, k + 6]
            centroids[i, k] = (a + b + c) / 3
            around[i, k], around[i, k + 3] = min(a, b, c), max(a, b, c)
    order = np.arange(m)
    capacity = 2 * (2 * m // _LEAF_SIZE + 2)
    boxes = np.empty((capacity, 6))
    child = np.zeros(capacity, np.int32)
    size = np.zeros(capacity, np.int32)
    first, last = np.zeros(capacity, np.int64), np.zeros(capacity, np.int64)
    first[0], last[0] = 0, m
    used, box = 1, 0
    while box < used:
        lo, hi = first[box], last[box]
        boxes[box, :3], boxes[box, 3:] = np.inf, -np.inf
        for i in order[lo:hi]:
            for k in range(3):
                boxes[box, k] = min(boxes[box, k], around[i, k])
                boxes[box, k + 3] = max(boxes[box, k + 3], around[i, k + 3])
        if hi - lo <= _LEAF_SIZE:
            child[box], size[box] = lo, hi - lo
        else:
            axis = np.argmax(boxes[box, 3:] - boxes[box, :3])
            middle = (lo + hi) // 2
            _partition(order, centroids, axis, lo, hi, middle)
            child[box] = used
            first[used], last[used] = lo, middle
            first[used + 1], last[used + 1] = middle, hi
            used += 2
        box += 1
    return order, boxes[:used].copy(), child[:used].copy(), size[:used].copy()


@numba.njit(cache=True, error_model="numpy")
def _partition(order, centroids, axis, lo, hi, middle):  # type: ignore[no-untyped-def]
    """Arrange order[lo:hi] so that no centroid before `middle` exceeds one at or after it (Hoare, FIND)."""
    hi -= 1
    while lo < hi:
        pivot = centroids[order[(lo + hi) // 2], axis]
        i, j = lo, hi
        while i <= j:
            while centroids[order[i], axis] < pivot:
                i += 1
            while centroids[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            hi = j
        elif middle >= i:
            lo = i
        else:
            return


@numba.njit(cache=True, error_model="numpy", inline="always")
def _box_distance2(boxes, box, x, y, z):  # type: ignore[no-untyped-def]
    dx = max(boxes[box, 0] - x, 0.0, x - boxes[box, 3])
    dy = max(boxes[box, 1] - y, 0.0, y - boxes[box, 4])
    dz = max(boxes[box, 2] - z, 0.0, z - boxes[box, 5])
    return dx * dx + dy * dy + dz * dz


@numba.njit(cache=True, error_model="numpy")
def on_triangle(c, x, y, z):  # type: ignore[no-untyped-def]
    """Barycentric weights of the point of triangle `c` (9 coordinates) closest to (x, y, z).

    Uses the Voronoi regions of the triangle's corners and sides (Ericson, Real-Time Collision Detection, 5.1.5).
    """
    abx, aby, abz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    acx, acy, acz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    apx, apy, apz = x - c[0], y - c[1], z - c[2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    if d1 <= 0 and d2 <= 0:
        return 1.0, 0.0, 0.0
    bpx, bpy, bpz = x - c[3], y - c[4], z - c[5]
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0 and d1 >= 0 and d3 <= 0:
        t = d1 / (d1 - d3) if d1 > d3 else 0.0
        return 1 - t, t, 0.0
    cpx, cpy, cpz = x - c[6], y - c[7], z - c[8]
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0 and d2 >= 0 and d6 <= 0:
        t = d2 / (d2 - d6) if d2 > d6 else 0.0
        return 1 - t, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6)) if (d4 - d3) + (d5 - d6) > 0 else 0.0
        return 0.0, 1 - t, t
    if va + vb + vc == 0:  # the triangle is a line, or rounding makes it one
        return 1.0, 0.0, 0.0
    scale = 1 / (va + vb + vc)
    v, w = vb * scale, vc * scale
    return 1 - v - w, v, w


@numba.njit(cache=True, error_model="numpy")
def triangle_normal(c):  # type: ignore[no-untyped-def]
    """Unit normal of triangle `c` (9 coordinates); NaN if it has no area."""
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length


@numba.njit(cache=True, error_model="numpy")
def closest_point(tree, x, y, z, hint):  # type: ignore[no-untyped-def]
    """Nearest point of the surface to (x, y, z).

    `hint` is a triangle (in tree order) that is probably near, or -1. It bounds the search and selects the surface of
    a forest.
    Returns px, py, pz, triangle in tree order, and the three weights.
    """
    corners, boxes, child, size = tree.corners, tree.boxes, tree.child, tree.size
    best, face = np.inf, max(hint, 0)
    px, py, pz, u, v, w = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    if hint >= 0:
        c = corners[hint]
        u, v, w = on_triangle(c, x, y, z)
        px, py, pz = u * c[0] + v * c[3] + w * c[6], u * c[1] + v * c[4] + w * c[7], u * c[2] + v * c[5] + w * c[8]
        best = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
    stack, bounds = np.empty(_STACK_SIZE, np.int32), np.empty(_STACK_SIZE)
    root = tree.root[hint] if hint >= 0 else 0
    stack[0], bounds[0] = root, _box_distance2(boxes, root, x, y, z)
    top = 1
    while top:
        top -= 1
        box = stack[top]
        if bounds[top] >= best:
            continue
        if size[box]:
            for k in range(child[box], child[box] + size[box]):
                c = corners[k]
                a0, a1, a2 = on_triangle(c, x, y, z)
                qx = a0 * c[0] + a1 * c[3] + a2 * c[6]
                qy = a0 * c[1] + a1 * c[4] + a2 * c[7]
                qz = a0 * c[2] + a1 * c[5] + a2 * c[8]
                d = (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2
                if d < best:
                    best, face, px, py, pz, u, v, w = d, k, qx, qy, qz, a0, a1, a2
        else:
            near, far = child[box], child[box] + 1
            dn, df = _box_distance2(boxes, near, x, y, z), _box_distance2(boxes, far, x, y, z)
            if df < dn:
                near, far, dn, df = far, near, df, dn
            if df < best:
                stack[top], bounds[top] = far, df
                top += 1
            if dn < best:
                stack[top], bounds[top] = near, dn
                top += 1
    return px, py, pz, face, u, v, w


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _closest_points(tree, queries):  # type: ignore[no-untyped-def]
    k = len(queries)
    points, barycentric = np.empty((k, 3)), np.empty((k, 3))
    faces, distances = np.empty(k, np.int32), np.empty(k)
    for block in numba.prange((k + _BLOCK - 1) // _BLOCK):
        hint = -1  # consecutive queries tend to be neighbours
        for i in range(block * _BLOCK, min(k, (block + 1) * _BLOCK)):
            x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
            px, py, pz, hint, u, v, w = closest_point(SurfaceTree(*tree), x, y, z, hint)
            points[i, 0], points[i, 1], points[i, 2] = px, py, pz
            barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = u, v, w
            faces[i] = tree[1][hint]
            distances[i] = np.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
    return points, faces, barycentric, distances


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _closer_than(tree, queries, distance):  # type: ignore[no-untyped-def]
    near = np.empty(len(queries), np.bool_)
    for i in numba.prange(len(queries)):
        near[i] = _is_closer(SurfaceTree(*tree), queries[i, 0], queries[i, 1], queries[i, 2], distance * distance)
    return near


@numba.njit(cache=True, error_model="numpy")
def _is_closer(tree, x, y, z, limit):  # type: ignore[no-untyped-def]
    """Whether the squared distance from (x, y, z) to the surface is below `limit`."""
    stack = np.empty(_STACK_SIZE, np.int32)
    stack[0], top = 0, 1
    while top:
        top -= 1
        box = stack[top]
        if _box_distance2(tree.boxes, box, x, y, z) >= limit:
            continue
        if tree.size[box]:
            for k in range(tree.child[box], tree.child[box] + tree.size[box]):
                c = tree.corners[k]
                u, v, w = on_triangle(c, x, y, z)
                dx = u * c[0] + v * c[3] + w * c[6] - x
                dy = u * c[1] + v * c[4] + w * c[7] - y
                dz = u * c[2] + v * c[5] + w * c[8] - z
                if dx * dx + dy * dy + dz * dz < limit:
                    return True
        else:
            stack[top], stack[top + 1] = tree.child[box], tree.child[box] + 1
            top += 2
    return False
