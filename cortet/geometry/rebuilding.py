"""A surface rebuilt on a grid: it encloses what triangles wind around, and has the topology of a sphere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from cortet.errors import InputError
from cortet.geometry.closest_point import closer_than, closest_points, tree_of
from cortet.geometry.grid_topology import as_ball, skin
from cortet.geometry.mending import measurable
from cortet.geometry.topology import enclosed_volume
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FloatArray, TriSurface

#: most points that a grid may have
MOST_POINTS = 60_000_000
#: in spacings: margin of the grid around the triangles, and the distance up to which distances are exact
_MARGIN, _FARTHEST = 3, 2.0


def rebuilt(surface: TriSurface, spacing: float) -> tuple[TriSurface, float]:
    """A topological sphere around all points of winding number above one half, and the volume of these points.

    Parameters
    ----------
    surface : triangles that agree in their orientation nearly everywhere; they need not be closed
    spacing : mm, spacing of the grid

    Returns
    -------
    the surface; and the volume inside before the topology is corrected, mm3

    Raises
    ------
    InputError
        the grid would have too many points, or nothing is inside
    """
    file = measurable(surface)
    corners = file.points[file.faces].reshape(-1, 3)
    low = corners.min(axis=0) - _MARGIN * spacing
    shape = np.ceil((corners.max(axis=0) + _MARGIN * spacing - low) / spacing).astype(np.int64) + 1
    if shape.prod() > MOST_POINTS:
        raise InputError(
            f"a grid of {spacing:g} mm would have {shape.prod():,} points, more than {MOST_POINTS:,}",
            remedy="increase repair.spacing",
        )
    depth = depths_on_grid(file, low, shape, spacing)
    if not (depth > 0).any():
        raise InputError("the triangles enclose nothing", remedy="decrease repair.spacing, or export the surface again")
    wound, ball = skin(depth), as_ball(depth, spacing)
    points, faces = wound if np.array_equal(ball, depth) else skin(ball)
    return TriSurface(low + spacing * points, faces), enclosed_volume(*wound) * spacing**3


def depths_on_grid(file: TriSurface, low: FloatArray, shape: NDArray[np.int64], spacing: float) -> FloatArray:
    """Distance of grid points to triangles, mm, negative outside: (*shape). Beyond two spacings it is rough."""
    tree, depth = tree_of(file), np.empty(shape)
    y, z = (low[axis] + spacing * np.arange(shape[axis]) for axis in (1, 2))
    plane = np.stack([np.zeros(shape[1:]), *np.meshgrid(y, z, indexing="ij")], axis=-1).reshape(-1, 3)
    for i in range(shape[0]):
        plane[:, 0] = low[0] + spacing * i
        near = closer_than(tree, plane, _FARTHEST * spacing)
        away = np.full(len(plane), _FARTHEST * spacing)
        away[near] = closest_points(tree, plane[near]).distances
        inside = winding_numbers(file, plane) > 0.5
        depth[i] = np.where(inside, away, -away).reshape(shape[1:])
    inside = depth > 0
    for side, sign in ((inside, 1), (~inside, -1)):
        far = np.abs(depth) == _FARTHEST * spacing
        steps = distance_transform_edt(side)
        depth[side & far] = sign * spacing * np.maximum(steps[side & far], _FARTHEST)
    return depth
