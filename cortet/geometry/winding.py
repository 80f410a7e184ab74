"""How many times triangles wind around a point, even if they are not closed.

The generalised winding number is the sum of the solid angles of all triangles over 4 pi (Jacobson et al., ACM
Transactions on Graphics 32, 2013). Holes, crossings and doubled triangles change it little. Each distant box of
triangles counts as one dipole (Barill et al., ibid. 37, 2018).
"""

from __future__ import annotations

import numba
import numpy as np

from cortet.geometry.closest_point import SurfaceTree, tree_of
from cortet.geometry.remembering import once_per_object
from cortet.meshes import FloatArray, TriSurface

#: a box of triangles counts as one dipole beyond this many times its radius (Barill et al. take 2)
_FAR = 2.0
_STACK_SIZE = 64
#: points per block; a thread takes whole blocks
_BLOCK = 256


def winding_numbers(surface: TriSurface, points: FloatArray) -> FloatArray:
    """How many times a surface winds around each of some points (k, 3) mm: (k,), whole numbers where it is closed."""
    return _winding_numbers(
        tuple(tree_of(surface)), _dipoles_of(surface), np.ascontiguousarray(points, dtype=np.float64)
    )


@once_per_object
def _dipoles_of(surface: TriSurface) -> FloatArray:
    """One dipole for each box of the tree of a surface."""
    found: FloatArray = _dipoles(tree_of(surface))
    return found


@numba.njit(cache=True, error_model="numpy")
def _dipoles(tree):  # type: ignore[no-untyped-def]
    """For each box: the sum of its triangles' area vectors, their area-weighted centre, and the radius."""
    corners, boxes, child, size = tree.corners, tree.boxes, tree.child, tree.size
    found = np.zeros((len(boxes), 8))
    for box in range(len(boxes) - 1, -1, -1):  # children come after their parents
        if size[box]:
            for t in range(child[box], child[box] + size[box]):
                c = corners[t]
                ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
                vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
                nx, ny, nz = (uy * vz - uz * vy) / 2, (uz * vx - ux * vz) / 2, (ux * vy - uy * vx) / 2
                area = np.sqrt(nx * nx + ny * ny + nz * nz)
                found[box, 0] += nx
                found[box, 1] += ny
                found[box, 2] += nz
                for k in range(3):
                    found[box, 3 + k] += area * (c[k] + c[k + 3] + c[k + 6]) / 3
                found[box, 6] += area
        else:
            for below in range(child[box], child[box] + 2):
                for k in range(3):
                    found[box, k] += found[below, k]
                    found[box, 3 + k] += found[below, 3 + k] * found[below, 6]
                found[box, 6] += found[below, 6]
        for k in range(3):
            found[box, 3 + k] /= max(found[box, 6], 1e-300)
        radius = 0.0
        for k in range(3):
            reach = max(boxes[box, k + 3] - found[box, 3 + k], found[box, 3 + k] - boxes[box, k])
            radius += reach * reach
        found[box, 7] = np.sqrt(radius)
    return found


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _winding_numbers(tree, dipoles, points):  # type: ignore[no-untyped-def]
    found = np.empty(len(points))
    for block in numba.prange((len(points) + _BLOCK - 1) // _BLOCK):
        for i in range(block * _BLOCK, min(len(points), (block + 1) * _BLOCK)):
            found[i] = _winding_number(SurfaceTree(*tree), dipoles, points[i, 0], points[i, 1], points[i, 2])
    return found


@numba.njit(cache=True, error_model="numpy")
def _winding_number(tree, dipoles, x, y, z):  # type: ignore[no-untyped-def]
    """Sum over 4 pi of the solid angles of near triangles and of the dipoles of far boxes."""
    stack = np.empty(_STACK_SIZE, np.int64)
    stack[0], top, total = 0, 1, 0.0
    while top:
        top -= 1
        box = stack[top]
        d = dipoles[box]
        rx, ry, rz = d[3] - x, d[4] - y, d[5] - z
        distance = np.sqrt(rx * rx + ry * ry + rz * rz)
        if distance > _FAR * d[7]:
            total += (d[0] * rx + d[1] * ry + d[2] * rz) / distance**3
        elif tree.size[box]:
            for t in range(tree.child[box], tree.child[box] + tree.size[box]):
                total += _solid_angle(tree.corners[t], x, y, z)
        else:
            stack[top], stack[top + 1] = tree.child[box], tree.child[box] + 1
            top += 2
    return total / (4 * np.pi)


@numba.njit(cache=True, error_model="numpy")
def _solid_angle(c, x, y, z):  # type: ignore[no-untyped-def]
    """Solid angle of a triangle (9 coordinates) at a point.

    Source: Van Oosterom and Strackee, IEEE Trans. Biomed. Eng., 1983.
    """
    ax, ay, az = c[0] - x, c[1] - y, c[2] - z
    bx, by, bz = c[3] - x, c[4] - y, c[5] - z
    gx, gy, gz = c[6] - x, c[7] - y, c[8] - z
    a = np.sqrt(ax * ax + ay * ay + az * az)
    b = np.sqrt(bx * bx + by * by + bz * bz)
    g = np.sqrt(gx * gx + gy * gy + gz * gz)
    triple = ax * (by * gz - bz * gy) + ay * (bz * gx - bx * gz) + az * (bx * gy - by * gx)
    ab, bg, ga = ax * bx + ay * by + az * bz, bx * gx + by * gy + bz * gz, gx * ax + gy * ay + gz * az
    return 2 * np.arctan2(triple, a * b * g + ab * g + bg * a + ga * b)
