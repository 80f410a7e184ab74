"""Growth at each spot of a surface, measured between two surfaces whose vertices correspond.

A triangle and its later image give the stretch along the surface, U of the polar decomposition F = R U. Its logarithm
is a symmetric tensor in the plane of the early triangle. Half its trace is the mean logarithmic stretch; the rest says
how much more one direction grows than the other. Logarithms can be averaged and interpolated, and no sum of them gives
a negative stretch (Arsigny et al., Magnetic Resonance in Medicine 56, 2006).

Tensors are rows of six numbers, in the order of `COMPONENTS`, in the coordinates of the early surface.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.spheres import barycentric, of_one_radius, same_triangles, vertex_areas
from cortet.geometry.topology import edges, enclosed_volume, face_areas, face_normals, vertex_normals
from cortet.meshes import FloatArray, IntArray, TriSurface

#: rows and columns of the six components of a symmetric tensor
COMPONENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
_ROW, _COLUMN = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])

#: candidate rounds of smoothing for cross-validation
_ROUNDS = (0, 1, 2, 4, 8, 16, 32, 64)
#: random vectors that estimate a trace (Hutchinson 1990), and their seed
_PROBES, _SEED = 8, 0
#: largest factor by which half of a cortex may grow or shrink in area; from 20 to 40 weeks it is about 8
MOST_GROWTH = 30.0
#: full width at half maximum of a Gaussian of standard deviation 1
_FWHM = float(np.sqrt(8 * np.log(2)))


class Principal(NamedTuple):
    """Principal stretches along a surface at n vertices."""

    #: (n,), the larger and the smaller
    largest: FloatArray
    smallest: FloatArray
    #: (n, 3), unit vector along the larger; its sign has no meaning
    direction: FloatArray


class Smoothed(NamedTuple):
    """Tensors after smoothing along the surface."""

    tensors: FloatArray
    #: full width at half maximum of the smoothing, mm
    width_mm: float


@dataclass(frozen=True, eq=False)
class Growth:
    """Growth between two surfaces, whole and at each vertex."""

    #: (n, 6), logarithm of the stretch along the surface, smoothed
    tensors: FloatArray
    #: full width at half maximum of the smoothing, mm
    width_mm: float
    #: later over early area of the whole surface
    area_ratio: float
    volume_ratio: float
    #: area-weighted percentiles of the vertices' area ratio: percentile -> value
    percentiles: dict[str, float]
    #: values per vertex for people to look at, by name
    metrics: dict[str, FloatArray]


def measured(early: TriSurface, later: TriSurface, width_mm: float | None = None) -> Growth:
    """How much each spot of a surface has grown by the time of a later surface with corresponding vertices.

    Parameters
    ----------
    width_mm : full width at half maximum of the smoothing along the surface; None: as much as noise requires
    """
    found = smoothed(_plausible(logarithmic_growth(early, later)), early, width_mm)
    ratio, areas = area_ratio(found.tensors), vertex_areas(early)
    directions = principal(found.tensors, vertex_normals(early.points, early.faces))
    volumes = [abs(enclosed_volume(one.points, one.faces)) for one in (early, later)]
    area_growth, volume_growth = float(vertex_areas(later).sum() / areas.sum()), volumes[1] / volumes[0]
    if max(area_growth, volume_growth) < 1:
        raise InputError(
            f"the later surface is smaller than the early one: it has {area_growth:.0%} of its area and "
            f"{volume_growth:.0%} of its volume",
            remedy="give the early surface and its age first",
        )
    order = np.argsort(ratio)
    below = (np.cumsum(areas[order]) - areas[order] / 2) / areas.sum()
    return Growth(
        found.tensors,
        found.width_mm,
        area_ratio=area_growth,
        volume_ratio=volume_growth,
        percentiles={f"{part}": float(np.interp(part / 100, below, ratio[order])) for part in (5, 25, 50, 75, 95)},
        metrics={
            "area_ratio": ratio,
            "stretch_largest": directions.largest,
            "stretch_smallest": directions.smallest,
            "beyond_the_whole": np.sqrt(ratio) / np.cbrt(volume_growth),
        },
    )


def _plausible(tensors: FloatArray) -> FloatArray:
    """The given growth; InputError if most of a surface grows or shrinks more than any cortex does."""
    middle = float(np.exp(np.median(np.abs(np.log(area_ratio(tensors))))))
    if middle > MOST_GROWTH:
        raise InputError(
            f"the area of half of the vertices changes by a factor of {middle:,.0f} and more",
            remedy="give two surfaces in mm, whose vertices correspond one by one",
        )
    return tensors


def logarithmic_growth(early: TriSurface, later: TriSurface) -> FloatArray:
    """Logarithm of the stretch along the surface at each vertex of the early one: (n, 6).

    Its trace is the logarithm of the ratio of the areas around the vertex; its shape is the mean of those of the
    triangles around it, weighted by area and turned into the plane of the vertex.
    """
    check_corresponding(early, later)
    per_face = _of_faces(early, later)
    normals = vertex_normals(early.points, early.faces)
    of_face = face_normals(early.points, early.faces)
    areas = face_areas(early.points, early.faces)
    of_face /= 2 * areas[:, None]
    total = np.zeros((len(early.points), 3, 3))
    for corner in early.faces.T:
        turn = _turns(of_face, normals[corner])
        np.add.at(total, corner, areas[:, None, None] * (turn @ per_face @ turn.transpose(0, 2, 1)))
    plane = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    flat = plane @ (total / vertex_areas(early)[:, None, None] / 3) @ plane
    shape = flat - np.trace(flat, axis1=1, axis2=2)[:, None, None] / 2 * plane
    ratio = np.log(vertex_areas(later) / vertex_areas(early))
    return _rows(shape + ratio[:, None, None] / 2 * plane)


def through_spheres(surface: TriSurface, sphere: TriSurface, of_early: TriSurface) -> TriSurface:
    """A later surface at the vertices of an early one, which correspond through registered spheres.

    Parameters
    ----------
    sphere, of_early : registered spheres of the later and of the early surface, of any radius
    """
    if not same_triangles(sphere, surface):
        raise InputError(
            f"the sphere ({len(sphere.points)} vertices) and the surface ({len(surface.points)}) have different "
            "triangles",
            remedy="give the sphere of this surface",
        )
    weights = barycentric(of_one_radius(sphere), of_one_radius(of_early))
    return TriSurface(weights @ surface.points, of_early.faces)


def check_corresponding(early: TriSurface, later: TriSurface) -> None:
    """Raise InputError unless the vertices of two surfaces correspond by their numbers, and no triangle is flat."""
    if early.faces.shape != later.faces.shape or not np.array_equal(early.faces, later.faces):
        raise InputError(
            f"the surfaces have {len(early.points)} and {len(later.points)} vertices and different triangles, so "
            "their vertices do not correspond",
            remedy="give the registered sphere of each surface",
        )
    for surface, name in ((early, "early"), (later, "later")):
        areas = face_areas(surface.points, surface.faces)
        if not areas.min() > 0:
            raise InputError(
                f"triangle {int(areas.argmin())} of the {name} surface has no area", remedy="repair or resample it"
            )


def area_ratio(tensors: FloatArray) -> FloatArray:
    """Later over early area at each vertex: (n,)."""
    return np.exp(tensors[:, :3].sum(axis=1))


def principal(tensors: FloatArray, normals: FloatArray) -> Principal:
    """Principal stretches of tensors (n, 6) along the surface with some unit normals (n, 3)."""
    values, vectors = np.linalg.eigh(matrices(tensors))
    across = np.abs(np.einsum("nik,ni->nk", vectors, normals)).argmax(axis=1)  # its eigenvalue, 0, may have any rank
    rows = np.arange(len(values))
    kept = np.array([[1, 2], [0, 2], [0, 1]])[across]  # eigh sorts in ascending order
    return Principal(np.exp(values[rows, kept[:, 1]]), np.exp(values[rows, kept[:, 0]]), vectors[rows, :, kept[:, 1]])


def smoothed(tensors: FloatArray, surface: TriSurface, width_mm: float | None = None) -> Smoothed:
    """Tensors (n, 6) smoothed along the surface; those of neighbours are turned into the plane of the vertex.

    Parameters
    ----------
    width_mm : full width at half maximum; None: the one with which neighbours predict a vertex best (generalised
        cross-validation, Golub, Heath and Wahba 1979)
    """
    step = _step_mm(surface)
    if width_mm is not None:
        rounds = round((width_mm / _FWHM / step) ** 2)
        return Smoothed(_after(tensors, surface, [rounds])[-1], _FWHM * step * np.sqrt(rounds))
    candidates = _after(tensors, surface, _ROUNDS)
    weights = vertex_areas(surface)
    scores = []
    for values, trace in zip(candidates, _traces(surface), strict=True):
        left = np.average(((values - tensors) ** 2).sum(axis=1), weights=weights)
        scores.append(left / (1 - trace) ** 2 if trace < 1 else np.inf)
    best = int(np.argmin(scores))
    return Smoothed(candidates[best], _FWHM * step * float(np.sqrt(_ROUNDS[best])))


def _of_faces(early: TriSurface, later: TriSurface) -> FloatArray:
    """Logarithm of the stretch of each triangle, in the plane that it lies in early: (m, 3, 3)."""
    before, after = (s.points[s.faces[:, 1:]] - s.points[s.faces[:, :1]] for s in (early, later))
    first = before[:, 0] / np.linalg.norm(before[:, 0], axis=1, keepdims=True)
    normal = face_normals(early.points, early.faces)
    second = np.cross(normal / np.linalg.norm(normal, axis=1, keepdims=True), first)
    basis = np.stack([first, second], axis=1)  # rows
    plane = np.einsum("fij,fkj->fik", basis, before)  # columns are the edges in the plane
    gradient = np.einsum("fki,fkj->fij", after, np.linalg.inv(plane))  # of the later position by the early one
    values, vectors = np.linalg.eigh(gradient.transpose(0, 2, 1) @ gradient)
    flat = (vectors * (np.log(values) / 2)[:, None, :]) @ vectors.transpose(0, 2, 1)
    result: FloatArray = basis.transpose(0, 2, 1) @ flat @ basis
    return result


def _turns(a: FloatArray, b: FloatArray) -> FloatArray:
    """The smallest rotations that take unit vectors a (k, 3) to b: (k, 3, 3); none for opposite ones."""
    axis, cosine = np.cross(a, b), np.einsum("ij,ij->i", a, b)
    skew = np.zeros((len(a), 3, 3))
    skew[:, 0, 1], skew[:, 0, 2], skew[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    skew -= skew.transpose(0, 2, 1)
    factor = np.divide(1.0, 1 + cosine, out=np.zeros_like(cosine), where=cosine > -1 + 1e-9)
    return np.eye(3) + skew + factor[:, None, None] * (skew @ skew)


def _rows(matrices: FloatArray) -> FloatArray:
    return matrices[:, _ROW, _COLUMN]


def matrices(tensors: FloatArray) -> FloatArray:
    """Symmetric matrices of tensors (n, 6): (n, 3, 3)."""
    matrices = np.empty((len(tensors), 3, 3))
    matrices[:, _ROW, _COLUMN] = matrices[:, _COLUMN, _ROW] = tensors
    return matrices


def _step_mm(surface: TriSurface) -> float:
    """Standard deviation along one axis of a round of smoothing, mm: half the weight goes to neighbours."""
    one, other = edges(surface.faces).T
    squares = ((surface.points[one] - surface.points[other]) ** 2).sum(axis=1)
    return float(np.sqrt(squares.mean() / 4))


def _after(tensors: FloatArray, surface: TriSurface, rounds: Sequence[int]) -> list[FloatArray]:
    """Tensors after some numbers of rounds, rising; those of neighbours are turned into the plane of the vertex."""
    normals, (start, end) = vertex_normals(surface.points, surface.faces), _both_ways(surface.faces)
    turn = _turns(normals[start], normals[end])

    def given(values: FloatArray) -> FloatArray:
        return _rows(turn @ matrices(values[start]) @ turn.transpose(0, 2, 1))

    return _averaged(tensors, surface, rounds, given)


def _traces(surface: TriSurface) -> list[float]:
    """Mean weight that a vertex has in its own result after each of `_ROUNDS`."""
    probes = np.random.default_rng(_SEED).choice([-1.0, 1.0], (len(surface.points), _PROBES))
    start = _both_ways(surface.faces)[0]
    return [float((probes * values).mean()) for values in _averaged(probes, surface, _ROUNDS, lambda all_: all_[start])]


def _averaged(
    values: FloatArray, surface: TriSurface, rounds: Sequence[int], given: Callable[[FloatArray], FloatArray]
) -> list[FloatArray]:
    """Values (n, ...) after some numbers of rounds, rising.

    In a round a vertex keeps half of its own and takes half the mean of its neighbours, weighted by area.

    Parameters
    ----------
    given : values at the start of each of `_both_ways`, as its end takes them
    """
    areas, (start, end) = vertex_areas(surface), _both_ways(surface.faces)
    weight = areas[start]
    total = np.bincount(end, weight, minlength=len(areas))
    results, done = [], 0
    for wanted in rounds:
        for _ in range(wanted - done):
            taken = given(values) * weight[:, None]
            sums = np.stack([np.bincount(end, column, minlength=len(areas)) for column in taken.T], axis=1)
            values = values / 2 + sums / total[:, None] / 2
        done = wanted
        results.append(values)
    return results


def _both_ways(faces: IntArray) -> NDArray[np.int64]:
    """Edges in both directions: (2, k)."""
    pairs = edges(faces).astype(np.int64)
    return np.concatenate([pairs, pairs[:, ::-1]]).T
