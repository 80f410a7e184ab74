"""How wide and how deep the folds of a surface are."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from cortet.geometry.topology import edges, face_areas, face_normals, vertex_normals
from cortet.mesh import FloatArray, IntArray

#: length over which curvature is smoothed, mm: less than any fold, more than the steps of a mesh
_SMOOTHING = 1.5


def fold_spacing(points: FloatArray, faces: IntArray, cortex: FloatArray) -> float | None:
    """Mean distance from gyrus to gyrus, mm: twice the area over the length of the lines between gyri and sulci.

    The lines are those where the mean curvature is zero, smoothed over 1.5 mm. Stripes of any direction, straight or
    winding, have two of them per wavelength (the stereological relation of length per area; Underwood 1970).

    Parameters
    ----------
    points, faces : of a closed surface, mm (n, 3) and outward (k, 3)
    cortex : (n,), 1 where it counts, 0 where it does not, on the medial wall

    Returns
    -------
    None where there is no such line
    """
    counted = cortex[faces].min(axis=1)
    values = _smoothed(mean_curvature(points, faces), points, faces)[faces]
    length = float(_zero_line(points[faces], values) @ counted)
    area = float(face_areas(points, faces) @ counted)
    return 2 * area / length if length > 0 else None


def sulcal_depth(points: FloatArray, faces: IntArray, cortex: FloatArray) -> float:
    """Mean distance of the cortex from the convex hull of the surface, mm; arguments as in `fold_spacing`."""
    depth = depth_below_hull(points)
    weight = np.bincount(faces.ravel(), np.repeat(face_areas(points, faces), 3), minlength=len(points)) * cortex
    return float(np.average(depth, weights=weight))


def depth_below_hull(points: FloatArray) -> FloatArray:
    """Distance of each of some points (n, 3) from their convex hull: (n,)."""
    planes = ConvexHull(points).equations
    return np.array([-(planes[:, :3] @ point + planes[:, 3]).max() for point in points])


def mean_curvature(points: FloatArray, faces: IntArray) -> FloatArray:
    """Mean curvature of each vertex, 1/mm (n,), positive on gyri: the gradient of the area over twice the area."""
    normals = face_normals(points, faces)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    gradient = np.zeros_like(points)
    for corner in range(3):
        opposite = points[faces[:, (corner + 2) % 3]] - points[faces[:, (corner + 1) % 3]]
        pull = np.cross(unit, opposite) / 2
        for axis in range(3):
            gradient[:, axis] += np.bincount(faces[:, corner], pull[:, axis], minlength=len(points))
    area = np.bincount(faces.ravel(), np.repeat(face_areas(points, faces) / 3, 3), minlength=len(points))
    curvature: FloatArray = (gradient * vertex_normals(points, faces)).sum(axis=1) / (2 * area)
    return curvature


def _smoothed(values: FloatArray, points: FloatArray, faces: IntArray) -> FloatArray:
    """Values (n,) averaged with those of their neighbours, until this reaches over the smoothing length."""
    start, end = edges(faces).T
    mean_square = float(((points[start] - points[end]) ** 2).sum(axis=1).mean())
    degree = np.bincount(np.r_[start, end], minlength=len(points))
    for _ in range(max(1, round(2 * _SMOOTHING**2 / mean_square))):
        total = np.bincount(start, values[end], minlength=len(points))
        total = total + np.bincount(end, values[start], minlength=len(points))
        values = (values + total / degree) / 2
    return values


def _zero_line(corners: FloatArray, values: FloatArray) -> FloatArray:
    """Length of the line in each triangle on which linearly interpolated values are zero: (k,).

    Parameters
    ----------
    corners, values : (k, 3, 3) and (k, 3)
    """
    positive = values > 0
    crossed = (positive.sum(axis=1) == 1) | (positive.sum(axis=1) == 2)
    ends = np.zeros((len(corners), 3))
    for corner in range(3):
        following = (corner + 1) % 3
        differ = positive[:, corner] != positive[:, following]
        step = values[:, corner] - values[:, following]
        part = np.divide(values[:, corner], step, out=np.zeros(len(step)), where=differ)
        place = corners[:, corner] + part[:, None] * (corners[:, following] - corners[:, corner])
        # each crossed triangle has two such edges: the difference of their places is the line
        sign = np.where(positive[:, corner], 1.0, -1.0)
        ends += np.where(differ[:, None], sign[:, None] * place, 0.0)
    return np.where(crossed, np.linalg.norm(ends, axis=1), 0.0)
