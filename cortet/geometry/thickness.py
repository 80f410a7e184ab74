"""The shrinking ball: thickness of a body below each point of its surface, and width of the gap above.

The ball touches a closed surface at a point and shrinks until nothing else of the surface is within it (Ma, Bae and
Choi, 3D medial axis point approximation using nearest neighbors and the normal field, The Visual Computer 28, 2012).
"""

from __future__ import annotations

import numba
import numpy as np

from cortet.geometry.closest_point import SurfaceTree, closest_point, triangle_normal
from cortet.meshes import FloatArray

_MOST_STEPS = 30
#: a ball that shrinks by less than this share of its radius has converged: roughly, and in exact measurements
_ROUGHLY, _EXACTLY = 0.01, 1e-6
#: if the normals at a ball's two points of contact have a cosine above this, both points are on the same side, which is
#: bent or rough there; exact measurements have no such side
_SAME_SIDE, _NO_SIDE = 0.5, 2.0


def thickness(tree: SurfaceTree, points: FloatArray, normals: FloatArray, most: float, *, inside: bool) -> FloatArray:
    """Diameter of the largest ball, inside or outside, that touches a closed surface at each given point, to a percent.

    Parameters
    ----------
    tree : of the surface
    points, normals : (n, 3) mm, on the surface; (n, 3) unit normals of the faces there, assumed to point outward
    most : mm, the diameter at which the search begins
    inside : True measures the thickness of blades, False the width of sulci

    Returns
    -------
    (n,) mm; `most` where the ball meets no other side
    """
    side = -1.0 if inside else 1.0
    return _diameters(
        tuple(tree), np.ascontiguousarray(points), np.ascontiguousarray(normals), most, side, _ROUGHLY, _SAME_SIDE
    )


def gaps(tree: SurfaceTree, points: FloatArray, normals: FloatArray, most: float) -> FloatArray:
    """Width of the gap in front of each point, exactly; the parameters and the result are those of `thickness`."""
    return _diameters(
        tuple(tree), np.ascontiguousarray(points), np.ascontiguousarray(normals), most, 1.0, _EXACTLY, _NO_SIDE
    )


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _diameters(tree, points, normals, most, side, settled, same_side):  # type: ignore[no-untyped-def]
    found = np.empty(len(points))
    for i in numba.prange(len(points)):
        found[i] = 2 * _radius(SurfaceTree(*tree), points[i], normals[i], most / 2, side, settled, same_side)
    return found


@numba.njit(cache=True, error_model="numpy")
def _radius(tree, point, normal, most, side, settled, same_side):  # type: ignore[no-untyped-def]
    """Radius of the ball at one point: it shrinks until no other side of the surface is within it."""
    radius, place = most, -1
    for _ in range(_MOST_STEPS):
        centre = point + side * radius * normal
        x, y, z, place, _, _, _ = closest_point(tree, centre[0], centre[1], centre[2], place)
        touched = np.array([x, y, z])
        distance = np.sqrt(((touched - centre) ** 2).sum())
        nx, ny, nz = triangle_normal(tree.corners[place])
        is_own = nx * normal[0] + ny * normal[1] + nz * normal[2] > same_side
        if is_own or distance >= radius * (1 - settled):
            return radius
        chord = touched - point
        along = side * (chord * normal).sum()
        if not along > 0:
            return radius
        radius = (chord * chord).sum() / (2 * along)
    return radius
