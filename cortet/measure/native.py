"""A mesh compared with its native surface: as it was read, before smoothing, resampling or repair."""

from __future__ import annotations

from dataclasses import dataclass

from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.mending import measurable
from cortet.geometry.topology import boundary_surface, face_areas
from cortet.measure.fidelity import Distances, summary
from cortet.measure.lost import distances_to, surface_samples
from cortet.meshes import TetMesh, TriSurface


@dataclass(frozen=True)
class Native:
    """The boundary of a mesh compared with its native surface."""

    #: boundary nodes and centres of boundary faces to the nearest point of the native surface
    boundary_to_native_mm: Distances
    #: vertices of the native surface and centres of its faces to the nearest point of the boundary
    native_to_boundary_mm: Distances
    native_area_mm2: float
    #: (boundary - native) / native
    relative_area_change: float


def native_record(mesh: TetMesh, native: TriSurface) -> Native | None:
    """Compare the boundary of a mesh with the native surface; None if no triangle of it has finite coordinates.

    Parameters
    ----------
    native : mm; it may be open, branch or cross itself; vertices without finite coordinates do not count
    """
    native = measurable(native)
    area = float(face_areas(native.points, native.faces).sum())
    if not area > 0:
        return None
    boundary, _ = boundary_surface(mesh)
    return Native(
        boundary_to_native_mm=summary(closest_points(tree_of(native), surface_samples(boundary)).distances),
        native_to_boundary_mm=summary(distances_to(boundary, native)),
        native_area_mm2=area,
        relative_area_change=float(face_areas(boundary.points, boundary.faces).sum()) / area - 1,
    )
