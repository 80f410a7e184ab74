"""Samples of a given surface, attached to the triangles of a surface that must stay near it (compiled).

The samples are the vertices of the given surface and the centres of its faces, each attached to the nearest triangle.
An operation on triangles measures how far the samples around it would be, and reattaches them. The idea is that of Hu
et al., Error-bounded and feature preserving surface remeshing with minimal angle improvement, TVCG 2017.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from cortet.geometry.closest_point import closest_point, on_triangle, triangle_normal

#: mm2, far above the rounding of a squared distance
_ROUNDING = 1e-9


class Limits(NamedTuple):
    """Mean squared distances (mm2) of the samples around an operation."""

    #: up to this, an operation is made without checking whether another would be closer
    free: float
    #: above this, it is refused
    most: float


@numba.njit(cache=True, error_model="numpy", inline="always")
def _squared_to_box(box, x, y, z):  # type: ignore[no-untyped-def]
    """Squared distance of a point to a box, which no triangle inside the box is nearer than."""
    dx = max(box[0] - x, 0.0, x - box[3])
    dy = max(box[1] - y, 0.0, y - box[4])
    dz = max(box[2] - z, 0.0, z - box[5])
    return dx * dx + dy * dy + dz * dz


@numba.njit(cache=True, error_model="numpy")
def measure(w, s, olds, news, most):  # type: ignore[no-untyped-def]
    """Find the new triangle nearest to each sample of the old faces.

    Returns the number of samples and the sum of squared distances; the sum is infinite if one distance is beyond its
    limit, or if the mean is above both `most` and its old value.
    """
    count, total, before = 0, 0.0, 0.0
    for j in range(news):
        for axis in range(3):
            a, b, c = s.new[j, axis], s.new[j, axis + 3], s.new[j, axis + 6]
            s.box[j, axis], s.box[j, axis + 3] = min(a, b, c), max(a, b, c)
    for k in range(olds):
        i = w.first[s.old[k]]
        while i >= 0:
            x, y, z = w.samples[i, 0], w.samples[i, 1], w.samples[i, 2]
            best, nearest = np.inf, -1
            for turn in range(news):
                # first the triangle that most often follows the old one; where two are as near, the first one counts
                j = turn
                if k < news and turn <= k:
                    j = turn - 1 if turn else k
                if _squared_to_box(s.box[j], x, y, z) > best + _ROUNDING:
                    continue
                c = s.new[j]
                u, v, t = on_triangle(c, x, y, z)
                dx = u * c[0] + v * c[3] + t * c[6] - x
                dy = u * c[1] + v * c[4] + t * c[7] - y
                dz = u * c[2] + v * c[5] + t * c[8] - z
                d = dx * dx + dy * dy + dz * dz
                if d < best or (d == best and j < nearest):
                    best, nearest = d, j
            if best > w.limit2[i]:
                return count, np.inf
            s.sample[count], s.nearest[count], s.distance2[count] = i, nearest, best
            total += best
            before += w.distance2[i]
            count += 1
            i = w.after[i]
    if total > max(before, most * count):
        return count, np.inf
    return count, total


@numba.njit(cache=True, error_model="numpy")
def attach(w, s, olds, count, face_of):  # type: ignore[no-untyped-def]
    """Attach the measured samples to the faces that `face_of` names for the new triangles."""
    for k in range(olds):
        w.first[s.old[k]] = -1
    for k in range(count):
        i, f = s.sample[k], face_of[s.nearest[k]]
        w.distance2[i] = s.distance2[k]
        w.after[i] = w.first[f]
        w.first[f] = i


@numba.njit(cache=True, error_model="numpy")
def onto_surface(tree, x, y, z, hint, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Nearest point of the surface and its triangle; triangle -1 if the point is on the bank opposite to normal n."""
    px, py, pz, on_triangle, _, _, _ = closest_point(tree, x, y, z, hint)
    mx, my, mz = triangle_normal(tree.corners[on_triangle])
    if not nx * mx + ny * my + nz * mz > 0:
        on_triangle = -1
    return px, py, pz, on_triangle
