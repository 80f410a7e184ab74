"""Triangles of a surface that pass through each other.

The kernel computes points of intersection and then locates them in the triangle. The usual test, by the signs of five
determinants, fails in flat areas: all five are rounding noise, and neighbours that merely share a vertex seem to cross.
"""

from __future__ import annotations

import numba
import numpy as np

from cortet.geometry.closest_point import tree_of
from cortet.geometry.remembering import once_per_object
from cortet.meshes import IntArray, TriSurface

_STACK_SIZE = 64
#: boxes per block; a thread takes whole blocks
_BLOCK = 64
#: sine of the angle below which a vertex is in the plane of a triangle: well above rounding, well below any shape
_FLAT = 1e-12


@once_per_object
def self_intersections(surface: TriSurface) -> IntArray:
    """Triangles that meet another triangle outside a shared vertex or edge: (f,) int32, ascending.

    Touching counts, and so does a triangle folded flat onto its neighbour. Every pair whose boxes overlap is tested in
    double precision. (PyMeshLab's filter is as fast, but it reports neighbours in flat areas as crossing and misses
    overlaps within a plane.)
    """
    tree = tree_of(surface)
    flagged = _crossing(surface.faces[tree.faces], tree.corners, tree.boxes, tree.child, tree.size)
    return np.sort(tree.faces[flagged])


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _crossing(vertices, corners, boxes, child, size):  # type: ignore[no-untyped-def]
    """Flag the triangles that meet others.

    `vertices` (m, 3) holds their vertex indices and `corners` (m, 9) their coordinates, in the order of the tree of
    `boxes`, `child`, `size` (`closest_point.SurfaceTree`). Returns (m,) bool.
    """
    m = len(corners)
    flagged = np.zeros(m, np.bool_)
    # triangles are in the order of the boxes, and children follow their box: where the triangles of each box end
    end = child + size
    for box in range(len(boxes) - 1, -1, -1):
        if not size[box]:
            end[box] = end[child[box] + 1]
    # threads may flag the same triangle; flags are only ever raised, so their order does not matter
    for block in numba.prange((len(boxes) + _BLOCK - 1) // _BLOCK):
        _flag_block(block, vertices, corners, boxes, child, size, end, flagged)
    return flagged


@numba.njit(cache=True, error_model="numpy")
def _flag_block(block, vertices, corners, boxes, child, size, end, flagged):  # type: ignore[no-untyped-def]
    stack = np.empty(_STACK_SIZE, np.int64)
    for leaf in range(block * _BLOCK, min(len(boxes), (block + 1) * _BLOCK)):
        stack[0] = 0
        top = 1 if size[leaf] else 0
        while top:
            top -= 1
            box = stack[top]
            if end[box] <= child[leaf] or not _overlap(boxes, box, leaf):
                continue
            if not size[box]:
                stack[top], stack[top + 1] = child[box], child[box] + 1
                top += 2
                continue
            for i in range(child[leaf], end[leaf]):
                for j in range(max(child[box], i + 1), end[box]):
                    if (flagged[i] and flagged[j]) or not _boxes_overlap(corners, i, j):
                        continue
                    if _meet(vertices[i], vertices[j], corners[i], corners[j]):
                        flagged[i] = flagged[j] = True


@numba.njit(cache=True, error_model="numpy", inline="always")
def _overlap(boxes, one, other):  # type: ignore[no-untyped-def]
    apart = False
    for k in range(3):
        apart |= boxes[one, k] > boxes[other, k + 3] or boxes[other, k] > boxes[one, k + 3]
    return not apart


@numba.njit(cache=True, error_model="numpy", inline="always")
def _boxes_overlap(c, i, j):  # type: ignore[no-untyped-def]
    apart = False
    for k in range(3):
        apart |= min(c[i, k], c[i, k + 3], c[i, k + 6]) > max(c[j, k], c[j, k + 3], c[j, k + 6])
        apart |= min(c[j, k], c[j, k + 3], c[j, k + 6]) > max(c[i, k], c[i, k + 3], c[i, k + 6])
    return not apart


@numba.njit(cache=True, error_model="numpy")
def _meet(one, other, a, b):  # type: ignore[no-untyped-def]
    """Whether two triangles (vertices `one`, `other`; coordinates `a`, `b`) meet beyond what they share.

    If two triangles meet, an edge of one meets the other; if they share a vertex, an edge opposite to it does. If they
    share an edge, they overlap when one is folded flat onto the other.
    """
    shared = 0
    corner_a = corner_b = 0  # the shared vertex, or the one opposite to the shared edge
    for i in range(3):
        for j in range(3):
            if one[i] == other[j]:
                shared += 1
                corner_a += i
                corner_b += j
    if shared == 3:
        return True
    if shared == 2:
        return _folded(a, b, 3 - corner_a, 3 - corner_b)
    for k in range(3):
        if (shared == 0 or k == corner_a) and _edge_meets(a, (k + 1) % 3, (k + 2) % 3, b):
            return True
        if (shared == 0 or k == corner_b) and _edge_meets(b, (k + 1) % 3, (k + 2) % 3, a):
            return True
    return False


@numba.njit(cache=True, error_model="numpy")
def _folded(a, b, apex_a, apex_b):  # type: ignore[no-untyped-def]
    """Whether triangles that share the edge opposite these corners lie in one plane on the same side of the edge."""
    start = 3 * ((apex_a + 1) % 3)
    end = 3 * ((apex_a + 2) % 3)
    ex, ey, ez = a[end] - a[start], a[end + 1] - a[start + 1], a[end + 2] - a[start + 2]
    ux, uy, uz = a[3 * apex_a] - a[start], a[3 * apex_a + 1] - a[start + 1], a[3 * apex_a + 2] - a[start + 2]
    vx, vy, vz = b[3 * apex_b] - a[start], b[3 * apex_b + 1] - a[start + 1], b[3 * apex_b + 2] - a[start + 2]
    nx, ny, nz = ey * uz - ez * uy, ez * ux - ex * uz, ex * uy - ey * ux
    mx, my, mz = ey * vz - ez * vy, ez * vx - ex * vz, ex * vy - ey * vx
    cosine = nx * mx + ny * my + nz * mz
    sx, sy, sz = ny * mz - nz * my, nz * mx - nx * mz, nx * my - ny * mx
    return cosine > 0 and sx * sx + sy * sy + sz * sz <= (_FLAT * cosine) ** 2


@numba.njit(cache=True, error_model="numpy")
def _edge_meets(a, start, end, t):  # type: ignore[no-untyped-def]
    """Whether the edge of triangle `a` from corner `start` to `end` meets the closed triangle `t`."""
    px, py, pz = a[3 * start] - t[0], a[3 * start + 1] - t[1], a[3 * start + 2] - t[2]
    qx, qy, qz = a[3 * end] - t[0], a[3 * end + 1] - t[1], a[3 * end + 2] - t[2]
    ux, uy, uz = t[3] - t[0], t[4] - t[1], t[5] - t[2]
    vx, vy, vz = t[6] - t[0], t[7] - t[1], t[8] - t[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    n = (nx * nx + ny * ny + nz * nz) ** 0.5
    p_height, q_height = px * nx + py * ny + pz * nz, qx * nx + qy * ny + qz * nz
    if abs(p_height) <= _FLAT * n * (px * px + py * py + pz * pz) ** 0.5:
        p_height = 0.0
    if abs(q_height) <= _FLAT * n * (qx * qx + qy * qy + qz * qz) ** 0.5:
        q_height = 0.0
    if p_height * q_height > 0:
        return False
    dx, dy, dz = qx - px, qy - py, qz - pz
    first, last = 0.0, 1.0
    if p_height != q_height:
        first = last = p_height / (p_height - q_height)
    # the part of the edge inside all sides of the triangle: p + s d for s in [first, last]
    for k in range(3):
        if k == 0:
            ax, ay, az, sx, sy, sz = 0.0, 0.0, 0.0, ux, uy, uz
        elif k == 1:
            ax, ay, az, sx, sy, sz = ux, uy, uz, vx - ux, vy - uy, vz - uz
        else:
            ax, ay, az, sx, sy, sz = vx, vy, vz, -vx, -vy, -vz
        ix, iy, iz = ny * sz - nz * sy, nz * sx - nx * sz, nx * sy - ny * sx
        at_p = ix * (px - ax) + iy * (py - ay) + iz * (pz - az)
        slope = ix * dx + iy * dy + iz * dz
        if first == last:
            if at_p + first * slope < 0:
                return False
        elif slope > 0:
            first = max(first, -at_p / slope)
        elif slope < 0:
            last = min(last, -at_p / slope)
        elif at_p < 0:
            return False
        if first > last:
            return False
    return True
