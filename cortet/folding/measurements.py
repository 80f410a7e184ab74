"""Measurements of a folding body at one moment: a row of the table that a run writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from cortet.folding.contact import beyond, planes_of
from cortet.formats.tables import read_columns
from cortet.geometry.spheres import vertex_areas
from cortet.geometry.topology import edges, enclosed_volume, face_areas, face_normals, vertex_normals
from cortet.meshes import FloatArray, IntArray, TriSurface

#: length over which curvature is smoothed, mm: shorter than any fold, longer than the edges of a mesh
_SMOOTHING = 1.5
#: radius of the ball of local gyrification over the length of the surface
_GYRIFICATION = 0.12

#: largest over smallest elastic stretch, and J, beyond which a tetrahedron counts as distorted and as compressed
DISTORTED, COMPRESSED = 5.0, 0.5
#: columns of the table, in the order of `Measurements`
COLUMNS = read_columns(Path(__file__).with_name("data") / "fold_columns.tsv")


@dataclass(frozen=True)
class Measurements:
    """One row of the table; `COLUMNS` gives the meaning and unit of each value."""

    step: int
    time: float
    gestational_age: float
    kinetic_energy: float
    elastic_energy: float
    dissipated_energy: float
    growth_work: float
    contact_work: float
    energy_error: float | None
    min_j: float
    inverted: int
    degenerate: int
    distortion: float | None
    distortion_max: float | None
    distorted_share: float
    compressed_share: float
    gyrification_index: float
    gyrification_index_error: float | None
    fold_spacing_mm: float | None
    fold_spacing_error_mm: float | None
    fold_wavelength_mm: float | None
    sulcal_depth_mm: float
    area_mm2: float
    volume_mm3: float
    hull_volume_mm3: float
    extent_lr_mm: float
    extent_ap_mm: float
    extent_is_mm: float
    cortex_share: float
    cortical_thickness_mm: float
    concave_share: float
    contacts: int


def shape(points: FloatArray, faces: IntArray, wall: NDArray[np.bool_], cortex_volume: float) -> dict[str, Any]:
    """The measurements that depend on the shape alone.

    Parameters
    ----------
    points : nodes (n, 3), mm
    faces : triangles (k, 3) of the boundary
    wall : (n,), nodes of the medial wall, where no folds are counted
    cortex_volume : mm3; NaN if unknown, then thickness and share are unknown, too
    """
    volume = enclosed_volume(points, faces)
    nodes, inverse = np.unique(faces, return_inverse=True)
    cortex: FloatArray = 1.0 - wall[nodes].astype(float)
    points, faces = points[nodes], inverse.reshape(faces.shape).astype(np.int32)
    areas, hull = face_areas(points, faces), ConvexHull(points)
    own = areas * cortex[faces].min(axis=1)
    folds = folds_of(points, faces, cortex)
    lr, ap, si = np.ptp(points, axis=0).tolist()
    return {
        "gyrification_index": float(areas.sum()) / float(hull.area),
        "fold_spacing_mm": folds.spacing,
        "fold_wavelength_mm": folds.wavelength,
        "sulcal_depth_mm": _mean_over(-beyond(planes_of(hull), points)[0], points, faces, cortex),
        "area_mm2": float(areas.sum()),
        "volume_mm3": volume,
        "hull_volume_mm3": float(hull.volume),
        "extent_lr_mm": lr,
        "extent_ap_mm": ap,
        "extent_is_mm": si,
        "cortex_share": cortex_volume / volume,
        "cortical_thickness_mm": cortex_volume / max(float(own.sum()), np.finfo(float).tiny),
        "concave_share": folds.concave,
    }


class Folds(NamedTuple):
    """Measures of the folds of a surface, from its mean curvature smoothed over 1.5 mm."""

    #: mean distance from gyrus to gyrus, mm; None if there is no line between gyri and sulci
    spacing: float | None
    #: the same with lines where the curvature is its median, mm
    wavelength: float | None
    #: share of the area with a mean curvature below zero
    concave: float


def folds_of(points: FloatArray, faces: IntArray, cortex: FloatArray) -> Folds:
    """Width, wavelength and concavity of the folds of a closed surface.

    The width is the mean distance from gyrus to gyrus: twice the area over the length of the lines between gyri and
    sulci. On these lines, the mean curvature, smoothed over 1.5 mm, is zero. Stripes of any direction, straight or
    winding, have two such lines per wavelength (the stereological relation of length per area; Underwood 1970).

    A brain is convex, so shallow folds have few such lines, and the deeper they get, the more: the width of young folds
    says more of their depth than of their distance. The wavelength takes the lines where curvature is its median over
    the cortex, which waves of any height have.

    Parameters
    ----------
    points, faces : mm (n, 3) and outward (k, 3)
    cortex : (n,), 1 at vertices that count, 0 at those that do not, on the medial wall
    """
    counted = cortex[faces].min(axis=1)
    values = smoothed_curvature(points, faces)
    area = float(face_areas(points, faces) @ counted)
    order = np.argsort(values)
    weight = np.cumsum((vertex_areas(TriSurface(points, faces)) * cortex)[order])
    median = values[order[np.searchsorted(weight, weight[-1] / 2)]]

    def between(level: float) -> float | None:
        """Twice the area over the length of the lines at a level."""
        length = float(_zero_line(points[faces], (values - level)[faces]) @ counted)
        return 2 * area / length if length > 0 else None

    return Folds(
        spacing=between(0.0),
        wavelength=between(median),
        concave=_mean_over((values < 0).astype(float), points, faces, cortex),
    )


def depth_below_hull(points: FloatArray) -> FloatArray:
    """Distance of each point (n, 3) from the convex hull of all: (n,)."""
    return -beyond(planes_of(ConvexHull(points)), points)[0]


def _mean_over(values: FloatArray, points: FloatArray, faces: IntArray, cortex: FloatArray) -> float:
    """Mean of values (n,) over the area of the cortex; NaN if there is none."""
    weight = np.bincount(faces.ravel(), np.repeat(face_areas(points, faces), 3), minlength=len(points)) * cortex
    return float(np.average(values, weights=weight)) if weight.sum() > 0 else float("nan")


def smoothed_curvature(points: FloatArray, faces: IntArray) -> FloatArray:
    """Mean curvature of each vertex, 1/mm (n,), smoothed over 1.5 mm: above zero on gyri, below it in sulci."""
    return _smoothed(mean_curvature(points, faces), points, faces)


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


def gaussian_curvature(points: FloatArray, faces: IntArray) -> FloatArray:
    """Gaussian curvature of each vertex, 1/mm2 (n,): the angle that its triangles lack to a full turn, over its area.

    References
    ----------
    Meyer et al., Discrete differential-geometry operators for triangulated 2-manifolds, Visualization and Mathematics
    III, 2003; the area is a third of that of the triangles around a vertex.
    """
    corners, angles = points[faces], np.empty(faces.shape)
    for corner in range(3):
        to_next, to_last = (corners[:, (corner + step) % 3] - corners[:, corner] for step in (1, 2))
        turn = np.linalg.norm(np.cross(to_next, to_last), axis=1)
        angles[:, corner] = np.arctan2(turn, (to_next * to_last).sum(axis=1))
    lacking = 2 * np.pi - np.bincount(faces.ravel(), angles.ravel(), minlength=len(points))
    return lacking / vertex_areas(TriSurface(points, faces))


def local_gyrification(points: FloatArray, faces: IntArray) -> FloatArray:
    """Area of the surface within a ball around each vertex, over that of the ball's great circle: (n,).

    Its radius is 0.12 of the length of the surface: 20 mm on an adult brain of 170 mm, as by Toro et al.

    References
    ----------
    Toro et al., Brain size and folding of the human cerebral cortex, Cerebral Cortex 18, 2008.
    """
    radius = _GYRIFICATION * float(np.ptp(points, axis=0).max())
    within = _area_within(np.ascontiguousarray(points), vertex_areas(TriSurface(points, faces)), radius)
    return np.asarray(within / (np.pi * radius**2))


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _area_within(points, areas, radius):  # type: ignore[no-untyped-def]
    """Area within a radius of each vertex; a vertex at the rim counts in part, as a disc of its area would."""
    widths = 2 * np.sqrt(areas / np.pi)
    found = np.zeros(len(points))
    for i in numba.prange(len(points)):
        for j in range(len(points)):
            x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
            squared = x * x + y * y + z * z
            if squared < (radius + widths[j] / 2) ** 2:
                found[i] += areas[j] * min((radius - np.sqrt(squared)) / widths[j] + 0.5, 1.0)
    return found


def _smoothed(values: FloatArray, points: FloatArray, faces: IntArray) -> FloatArray:
    """Values (n,) averaged with those of their neighbours, repeatedly, up to the smoothing length."""
    start, end = edges(faces).T
    mean_square = float(((points[start] - points[end]) ** 2).sum(axis=1).mean())
    degree = np.bincount(np.r_[start, end], minlength=len(points))
    rounds = max(1.0, 2 * _SMOOTHING**2 / mean_square)
    # the last round counts in part: with whole rounds alone, the width of folds would jump as a mesh grows
    for part in [1.0] * int(rounds) + [rounds % 1]:
        total = np.bincount(start, values[end], minlength=len(points))
        total = total + np.bincount(end, values[start], minlength=len(points))
        values = values + part * (total / degree - values) / 2
    return values


def _zero_line(corners: FloatArray, values: FloatArray) -> FloatArray:
    """Length of the line in each triangle where linearly interpolated values are zero: (k,).

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
        # each crossed triangle has two such edges: the line is the difference of their crossing points
        sign = np.where(positive[:, corner], 1.0, -1.0)
        ends += np.where(differ[:, None], sign[:, None] * place, 0.0)
    return np.where(crossed, np.linalg.norm(ends, axis=1), 0.0)
