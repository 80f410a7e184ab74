"""Convex hulls as sets of planes, and distances of points beyond them."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from cortet.meshes import FloatArray


def planes_of(hull: ConvexHull) -> FloatArray:
    """The distinct planes of a convex hull: (p, 4), outward unit normal n and offset o; n x + o < 0 is inside."""
    return np.unique(hull.equations, axis=0)  # the hull has one plane per triangle, and a flat side has many triangles


@numba.njit(cache=True, error_model="numpy")
def beyond(planes: FloatArray, points: FloatArray, size: float = 1.0) -> tuple[FloatArray, NDArray[np.int32]]:
    """How far points lie beyond the planes of a hull: the largest distance of each point, and its plane.

    Parameters
    ----------
    planes : (p, 4), `planes_of`
    points : (n, 3)
    size : factor by which the hull is scaled about the origin

    Returns
    -------
    distance (n,), negative inside; plane (n,)
    """
    distance, plane = np.full(len(points), -np.inf), np.full(len(points), -1, np.int32)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(len(planes)):
            d = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z + size * planes[k, 3]
            if d > distance[i]:
                distance[i], plane[i] = d, k
    return distance, plane
