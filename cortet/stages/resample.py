"""Put a surface onto a mesh that all cases share, through its sphere, so that vertices correspond across subjects.

A registration tool (MSM, FreeSurfer) maps each vertex of a surface to a point on a sphere, so that equal points mean
equal anatomy. A vertex of the common sphere takes the position that the surface has at that point.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cortet.config.stages import Resample
from cortet.errors import InputError
from cortet.formats.gifti import read_surface
from cortet.geometry import spheres
from cortet.geometry.interpolation import applied
from cortet.geometry.intersection import self_intersections
from cortet.geometry.topology import enclosed_volume, face_areas
from cortet.measure.fidelity import Distances, summary
from cortet.measure.lost import distances_to
from cortet.meshes import TriSurface, single_precision

VERSION: int = 2

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class ResampleReport:
    """The resampled surface compared with the native one. Relative changes are (resampled - native) / native."""

    #: file of the sphere
    sphere: str | None
    #: false: an inner surface whose triangles are not those of the sphere, and which stays as it is
    resampled: bool
    vertices_before: int
    vertices: int
    faces_before: int
    faces: int
    #: vertices and face centres of the native surface to the nearest point of the resampled one, and back
    native_to_resampled_mm: Distances
    resampled_to_native_mm: Distances
    #: triangles that cross others, before and after
    crossing_faces_before: int
    crossing_faces: int
    area_before_mm2: float
    area_mm2: float
    relative_area_change: float
    volume_before_ml: float
    volume_ml: float
    relative_volume_change: float


def resample(
    surface: TriSurface,
    sphere: TriSurface,
    settings: Resample = Resample(),
    *,
    sphere_file: Any = None,
    inside: bool = False,
) -> tuple[TriSurface, ResampleReport]:
    """The surface, and its fields, at the vertices of a common sphere.

    Positions are interpolated linearly in the triangle of `sphere` nearest to the vertex of the common sphere, like
    `wb_command -surface-resample ... BARYCENTRIC`. Fields are interpolated with area-corrected weights, like
    `-metric-resample` and `-label-resample` with `ADAP_BARY_AREA` and both surfaces for areas. Coordinates of the
    result are float32 values.

    Parameters
    ----------
    surface : native, mm; its inner surfaces stay as they are
    sphere : of any radius around the origin; vertex i is that of `surface`, and so are the triangles
    settings : as `Resample` describes them; {hemi} in the name of the template is replaced (`Resample.template_of`)
    sphere_file : where it comes from, for messages
    inside : the surface lies inside another one, and is resampled only if its triangles are those of the sphere

    Raises
    ------
    InputError
        the sphere is not round, or not of this surface; the surface has coordinates that are not finite; the template
        is not a sphere
    """
    if inside and not spheres.same_triangles(sphere, surface):
        return surface, _report(surface, surface, sphere_file, resampled=False)
    _check(surface, sphere, sphere_file)
    common = common_sphere(settings)
    old, new = spheres.of_one_radius(sphere), spheres.of_one_radius(common)
    weights = spheres.barycentric(old, new)
    points = weights @ surface.points
    made = single_precision(TriSurface(points, common.faces, frame=surface.frame, inner=surface.inner))
    if surface.point_data:
        areas = spheres.vertex_areas(surface), spheres.vertex_areas(made)
        gathered = spheres.area_corrected(old, new, *areas)
        fields = {name: applied(gathered, values) for name, values in surface.point_data.items()}
        made = replace(made, point_data=fields)
    report = _report(surface, made, sphere_file, resampled=True)
    logger.info(
        "%d vertices instead of %d; %.3f mm from the native surface on average, %.3f mm at most",
        report.vertices,
        report.vertices_before,
        report.native_to_resampled_mm.mean,
        report.native_to_resampled_mm.max,
    )
    return made, report


def common_sphere(settings: Resample) -> TriSurface:
    """The sphere whose vertices all cases share; InputError if the template is not a sphere."""
    from cortet.geometry.icosphere import icosphere

    if settings.template is None:
        return icosphere(settings.subdivisions)
    sphere = read_surface(settings.template)
    if flaws := spheres.flaws(sphere):
        raise InputError(
            f"is not a sphere: {'; '.join(flaws)}", file=settings.template, remedy="correct resample.template"
        )
    return sphere


def _check(surface: TriSurface, sphere: TriSurface, file: Any) -> None:
    without = "or no sphere: omit --sphere, or write n/a in the column sphere of the cohort sheet"
    if not spheres.same_triangles(sphere, surface):
        raise InputError(
            f"the sphere ({len(sphere.points)} vertices, {len(sphere.faces)} triangles) and the surface "
            f"({len(surface.points)}, {len(surface.faces)}) have different triangles",
            file=file,
            remedy=f"give the sphere of this surface, {without}",
        )
    if flaws := spheres.flaws(sphere):
        raise InputError(
            f"is not a sphere: {'; '.join(flaws)}", file=file, remedy=f"give a registered sphere, {without}"
        )
    if not np.isfinite(surface.points).all():
        raise InputError(
            "cannot resample a surface whose coordinates are not all finite", file=file, remedy="export it again"
        )


def _report(native: TriSurface, made: TriSurface, file: Any, *, resampled: bool) -> ResampleReport:
    area_before, area = (float(face_areas(one.points, one.faces).sum()) for one in (native, made))
    volume_before, volume = (abs(enclosed_volume(one.points, one.faces)) / 1000 for one in (native, made))
    none = Distances(0.0, 0.0, 0.0)
    return ResampleReport(
        sphere=None if file is None else str(file),
        resampled=resampled,
        vertices_before=len(native.points),
        vertices=len(made.points),
        faces_before=len(native.faces),
        faces=len(made.faces),
        native_to_resampled_mm=summary(distances_to(made, native)) if resampled else none,
        resampled_to_native_mm=summary(distances_to(native, made)) if resampled else none,
        crossing_faces_before=len(self_intersections(native)),
        crossing_faces=len(self_intersections(made)),
        area_before_mm2=area_before,
        area_mm2=area,
        relative_area_change=area / area_before - 1,
        volume_before_ml=volume_before,
        volume_ml=volume,
        relative_volume_change=volume / volume_before - 1,
    )
