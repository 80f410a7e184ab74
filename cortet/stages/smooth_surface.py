"""Smooth the input surface according to its roughness, within limits on the changes.

Surfaces from label images have stair steps. Atlas surfaces have none, but folds that smoothing would wipe out. So the
roughness of the surface is measured, and a surface below a limit is not smoothed. The filter of Taubin does not shrink:
each step inward by lambda is followed by one outward by mu. The paper's method is here, too: it smooths by gestational
age, which offers three strengths, and the strongest that changes little else is chosen.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from cortet.config.stages import SmoothingMethod, SmoothSurface
from cortet.errors import InputError, counted
from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.intersection import self_intersections
from cortet.geometry.smoothing import surface_preserving, taubin
from cortet.measure.fidelity import high_frequency_roughness
from cortet.meshes import FloatArray, TriSurface, single_precision

VERSION: int = 2

#: candidate numbers of iterations below each gestational age (weeks); CORTET, arXiv:2607.12157
ITERATIONS = (
    (23.0, (10, 20, 30)),
    (25.0, (8, 12, 20)),
    (29.0, (4, 6, 12)),
    (33.0, (2, 4, 10)),
    (34.0, (0, 2, 8)),
    (np.inf, (0, 1, 3)),
)
#: steps of Taubin's filter, inward by lambda and outward by mu (Taubin, SIGGRAPH 1995), tried in this order
STEPS = (2, 5, 10, 20, 40)
_LAMBDA, _MU = 0.5, -0.53

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Candidate:
    """The surface after a number of iterations; 0 is the input."""

    iterations: int
    area_mm2: float
    #: relative to the input
    area_change: float
    volume_ml: float
    volume_change: float
    #: mean distance to the input, averaged over both directions: from surface to surface for Taubin's method, from
    #: vertex to nearest vertex for the published one
    displacement_mm: float
    #: `measure.fidelity.high_frequency_roughness`
    high_frequency_roughness: float
    #: mean distance of a vertex from the mean of its neighbours
    roughness_mm: float
    #: limits that it breaks, in words; none if it may be chosen
    breaks: tuple[str, ...]


@dataclass(frozen=True)
class SmoothReport:
    """What was tried and what was chosen."""

    method: SmoothingMethod
    #: None if it is not known
    gestational_age_weeks: float | None
    chosen_iterations: int
    candidates: tuple[Candidate, ...]


def smooth_surface(
    surface: TriSurface, settings: SmoothSurface = SmoothSurface(), *, gestational_age: float | None = None
) -> tuple[TriSurface, SmoothReport]:
    """Smooth by the filter of Taubin, or by the paper's surface-preserving Laplacian (both PyMeshLab's).

    Taubin's filter takes the fewest steps that bring the roughness below the limit, or else those that remove
    most of it; a surface already below is not touched. Of the paper's candidates, the one that removes most roughness
    is chosen. Candidates beyond the limits, or with crossing triangles, are not eligible. If none is eligible, the
    surface stays as it is. Coordinates of the result are float32 values, so a GIfTI file holds them exactly.

    Parameters
    ----------
    settings : as `SmoothSurface` describes them
    gestational_age : weeks; `published` needs it

    Raises
    ------
    InputError : `published` without a gestational age
    """
    before = _candidate(surface, surface, 0, settings)
    if settings.method == "published":
        if gestational_age is None:
            raise InputError(
                "the published smoothing needs a gestational age",
                remedy="give the age, or set smooth_surface.method: taubin",
            )
        tried, candidates, offered = _by_age(surface, gestational_age, settings, before)
        chosen = min(offered, key=lambda c: c.roughness_mm, default=candidates[0])
    else:
        tried, candidates = _by_roughness(surface, settings, before)
        offered = [c for c in candidates if not c.breaks]
        chosen = min(offered, key=lambda c: c.high_frequency_roughness)
    for candidate in candidates[1:]:
        if candidate.breaks:
            logger.info("%d iterations are too many: %s", candidate.iterations, "; ".join(candidate.breaks))
    if not offered:
        logger.warning("every candidate exceeds a limit, so the surface is not smoothed")
    if settings.method == "taubin" and chosen.high_frequency_roughness > settings.max_roughness:
        # no warning: a surface whose triangles are too large for its folds is just as rough, and rightly left alone
        logger.info(
            "the surface stays rough: %.3f instead of the target %g, because the limits allow no more smoothing",
            chosen.high_frequency_roughness,
            settings.max_roughness,
        )
    logger.info(
        "%d iterations: roughness %.4f -> %.4f mm, area %+.2f %%, displacement %.3f mm",
        chosen.iterations,
        candidates[0].roughness_mm,
        chosen.roughness_mm,
        100 * chosen.area_change,
        chosen.displacement_mm,
    )
    return tried[chosen.iterations], SmoothReport(settings.method, gestational_age, chosen.iterations, candidates)


def _by_age(
    surface: TriSurface, gestational_age: float, settings: SmoothSurface, before: Candidate
) -> tuple[dict[int, TriSurface], tuple[Candidate, ...], list[Candidate]]:
    """The surface after each number of iterations, the candidates, and those that may be chosen."""
    offered = candidate_iterations(gestational_age)
    tried = {0: surface}
    for iterations in filter(None, offered):
        points = surface_preserving(surface, iterations=iterations)
        tried[iterations] = single_precision(replace(surface, points=points))
    further = (
        _candidate(surface, tried[iterations], iterations, settings) for iterations in sorted(tried) if iterations
    )
    candidates = (before, *further)
    return tried, candidates, [c for c in candidates if c.iterations in offered and not c.breaks]


def _by_roughness(
    surface: TriSurface, settings: SmoothSurface, before: Candidate
) -> tuple[dict[int, TriSurface], tuple[Candidate, ...]]:
    """The surface after ever more steps, until it is smooth or breaks a limit; and the candidates."""
    tried, candidates = {0: surface}, [before]
    for steps in STEPS:
        if candidates[-1].high_frequency_roughness <= settings.max_roughness or candidates[-1].breaks:
            break
        points = taubin(surface, steps=steps, lambda_=_LAMBDA, mu=_MU)
        tried[steps] = single_precision(replace(surface, points=points))
        candidates.append(_candidate(surface, tried[steps], steps, settings))
    return tried, tuple(candidates)


def candidate_iterations(gestational_age: float) -> tuple[int, ...]:
    """Numbers of iterations to try at a gestational age in weeks."""
    return next(iterations for below, iterations in ITERATIONS if gestational_age < below)


def _candidate(before: TriSurface, after: TriSurface, iterations: int, limits: SmoothSurface) -> Candidate:
    """Measure one candidate and compare it with the limits."""
    area = float(topology.face_areas(after.points, after.faces).sum())
    area_change = area / float(topology.face_areas(before.points, before.faces).sum()) - 1
    volume = topology.enclosed_volume(after.points, after.faces)
    volume_change = volume / topology.enclosed_volume(before.points, before.faces) - 1
    if limits.method == "published":
        displacement = mean_nearest_vertex_distance(before.points, after.points)
    else:
        displacement = mean_surface_distance(before, after)
    crossing = len(self_intersections(after)) if iterations else 0
    breaks = []
    if abs(area_change) > limits.max_area_change:
        breaks.append(f"area changes by {area_change:+.1%}")
    if limits.max_volume_change is not None and abs(volume_change) > limits.max_volume_change:
        breaks.append(f"volume changes by {volume_change:+.1%}")
    if displacement > limits.max_displacement:
        breaks.append(f"vertices are displaced by {displacement:.3f} mm")
    if crossing:
        breaks.append(counted(crossing, "triangle crosses", "triangles cross"))
    offset = after.points - topology.neighbour_means(after.points, after.faces)
    return Candidate(
        iterations=iterations,
        area_mm2=area,
        area_change=area_change,
        volume_ml=volume / 1000,
        volume_change=volume_change,
        displacement_mm=displacement,
        high_frequency_roughness=high_frequency_roughness(after.points, after.faces),
        roughness_mm=float(np.linalg.norm(offset, axis=1).mean()),
        breaks=tuple(breaks),
    )


def mean_nearest_vertex_distance(one: FloatArray, other: FloatArray) -> float:
    """Mean distance to the nearest vertex of the other set, the mean of both directions; (n, 3) and (m, 3) mm."""
    there, back = cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]
    return float(there.mean() + back.mean()) / 2


def mean_surface_distance(one: TriSurface, other: TriSurface) -> float:
    """Mean distance of the vertices of each surface from the other surface, averaged over both directions; mm."""
    there = closest_points(tree_of(other), one.points).distances
    back = closest_points(tree_of(one), other.points).distances
    return float(there.mean() + back.mean()) / 2
