"""Smooth the input surface as much as its gestational age asks for, within limits on what that may change.

Surfaces of young, small brains carry the stair steps of their segmentation; those of older ones carry folds that
smoothing would wipe out. So the age offers three strengths, and the strongest that changes little else is taken.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
import pymeshlab
from scipy.spatial import cKDTree

from cortet.formats.gifti import single_precision
from cortet.geometry import topology
from cortet.geometry.intersection import self_intersections
from cortet.mesh import FloatArray, TriSurface

VERSION: int = 1

#: candidate numbers of iterations below each gestational age (weeks); CORTET, arXiv:2607.12157
ITERATIONS = (
    (23.0, (10, 20, 30)),
    (25.0, (8, 12, 20)),
    (29.0, (4, 6, 12)),
    (33.0, (2, 4, 10)),
    (34.0, (0, 2, 8)),
    (np.inf, (0, 1, 3)),
)
#: normals of a vertex's triangles may turn this much (degrees) before it is held; above about 20 it holds none
_ANGLE = 60.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation over the vertices."""

    mean: float
    sd: float


@dataclass(frozen=True)
class Candidate:
    """The surface after so many iterations, 0 being the input."""

    iterations: int
    area_mm2: float
    #: relative to the input
    area_change: float
    volume_ml: float
    #: symmetric mean nearest-vertex distance to the input
    displacement_mm: float
    #: mean distance of a vertex to the mean of its neighbours
    roughness_mm: float
    mean_curvature_per_mm: Spread
    gaussian_curvature_per_mm2: Spread
    self_intersecting_faces: int
    #: limits it breaks, in words; none when it may be chosen
    breaks: tuple[str, ...]


@dataclass(frozen=True)
class SmoothReport:
    """What was tried and what was chosen."""

    gestational_age_weeks: float
    chosen_iterations: int
    candidates: tuple[Candidate, ...]


def smooth_surface(
    surface: TriSurface, *, gestational_age: float, max_area_change: float = 0.06, max_displacement: float = 0.25
) -> tuple[TriSurface, SmoothReport]:
    """Surface-preserving Laplacian smoothing (PyMeshLab), the candidate that removes most roughness within the limits.

    Candidates whose triangles cross are not eligible. When none is, the surface stays as it is. Coordinates of the
    result are float32 values, so a GIfTI file holds them exactly.

    Parameters
    ----------
    gestational_age : weeks
    max_area_change : largest relative change of the area
    max_displacement : largest symmetric mean nearest-vertex distance to the input, mm
    """
    limits = max_area_change, max_displacement
    tried = {0: surface}
    for iterations in candidate_iterations(gestational_age):
        tried[iterations] = _smoothed(surface, iterations)
    candidates = tuple(_candidate(surface, tried[iterations], iterations, *limits) for iterations in sorted(tried))
    offered = [c for c in candidates if c.iterations in candidate_iterations(gestational_age) and not c.breaks]
    chosen = min(offered, key=lambda c: c.roughness_mm, default=candidates[0])
    for candidate in candidates[1:]:
        if candidate.breaks:
            logger.info("%d iterations are too many: %s", candidate.iterations, "; ".join(candidate.breaks))
    if not offered:
        logger.warning("no candidate is within the limits: the surface is not smoothed")
    logger.info(
        "%d iterations: roughness %.4f -> %.4f mm, area %+.2f %%, displacement %.3f mm",
        chosen.iterations,
        candidates[0].roughness_mm,
        chosen.roughness_mm,
        100 * chosen.area_change,
        chosen.displacement_mm,
    )
    return tried[chosen.iterations], SmoothReport(gestational_age, chosen.iterations, candidates)


def candidate_iterations(gestational_age: float) -> tuple[int, ...]:
    """Numbers of iterations to try at a gestational age in weeks."""
    return next(iterations for below, iterations in ITERATIONS if gestational_age < below)


def _smoothed(surface: TriSurface, iterations: int) -> TriSurface:
    if not iterations:
        return surface
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.points, surface.faces))
    meshes.apply_coord_laplacian_smoothing_surface_preserving(angledeg=_ANGLE, iterations=iterations)
    return single_precision(replace(surface, points=meshes.current_mesh().vertex_matrix()))


def _candidate(
    before: TriSurface, after: TriSurface, iterations: int, max_area_change: float, max_displacement: float
) -> Candidate:
    """Measure one candidate and hold it against the limits."""
    area = float(topology.face_areas(after.points, after.faces).sum())
    area_change = area / float(topology.face_areas(before.points, before.faces).sum()) - 1
    displacement = mean_nearest_vertex_distance(before.points, after.points)
    crossing = len(self_intersections(after))
    breaks = []
    if abs(area_change) > max_area_change:
        breaks.append(f"area changes by {area_change:+.1%}")
    if displacement > max_displacement:
        breaks.append(f"vertices are displaced by {displacement:.3f} mm")
    if crossing:
        breaks.append(f"{crossing} triangles cross")
    offset = after.points - topology.neighbour_means(after.points, after.faces)
    mean_curvature, gaussian_curvature = _curvatures(after)
    return Candidate(
        iterations=iterations,
        area_mm2=area,
        area_change=area_change,
        volume_ml=topology.enclosed_volume(after.points, after.faces) / 1000,
        displacement_mm=displacement,
        roughness_mm=float(np.linalg.norm(offset, axis=1).mean()),
        mean_curvature_per_mm=mean_curvature,
        gaussian_curvature_per_mm2=gaussian_curvature,
        self_intersecting_faces=crossing,
        breaks=tuple(breaks),
    )


def mean_nearest_vertex_distance(one: FloatArray, other: FloatArray) -> float:
    """Mean distance to the nearest vertex of the other set, the mean of both directions; (n, 3) and (m, 3) mm."""
    there, back = cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]
    return float(there.mean() + back.mean()) / 2


def _curvatures(surface: TriSurface) -> tuple[Spread, Spread]:
    """Discrete mean (1/mm) and Gaussian (1/mm2) curvature by PyMeshLab (Meyer et al. 2003)."""
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.points, surface.faces))
    spreads = []
    for kind in ("Mean Curvature", "Gaussian Curvature"):
        meshes.compute_scalar_by_discrete_curvature_per_vertex(curvaturetype=kind)
        values = meshes.current_mesh().vertex_scalar_array()
        spreads.append(Spread(float(values.mean()), float(values.std())))
    return spreads[0], spreads[1]
