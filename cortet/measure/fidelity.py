"""How faithful a mesh is to the surface it fills, and to the native one: as read, before smoothing or repair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.mending import measurable
from cortet.geometry.topology import (
    boundary_surface,
    enclosed_volume,
    face_areas,
    mean_edge,
    neighbour_means,
    vertex_normals,
)
from cortet.measure.lost import distances_to, surface_samples
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface


@dataclass(frozen=True)
class Distances:
    """Summary of distances in mm."""

    mean: float
    p95: float
    max: float


@dataclass(frozen=True)
class Fidelity:
    """A mesh compared with its surface. Relative changes are (mesh - surface) / surface."""

    #: boundary nodes to the nearest point of the surface
    nodes_to_surface_mm: Distances
    #: centres of boundary faces to the nearest point of the surface: shows what a coarse mesh cuts off even when all
    #: its boundary nodes lie on the surface
    face_centres_to_surface_mm: Distances
    #: vertices of the surface and centres of its faces to the nearest point of the mesh boundary; large where the mesh
    #: leaves a sulcus or a blade behind, even when all its boundary nodes lie on the surface
    surface_to_boundary_mm: Distances
    #: boundary nodes to the nearest *vertex* of the surface, the measure of the published figures; about half an edge
    #: of the surface even for a perfect mesh
    nodes_to_nearest_vertex_mm: Distances
    volume_ml: float
    relative_volume_change: float
    area_mm2: float
    surface_area_mm2: float
    relative_area_change: float
    #: `boundary_roughness` of the mesh boundary and of the surface
    roughness: float
    surface_roughness: float


def fidelity(mesh: TetMesh, surface: TriSurface) -> Fidelity:
    """Compare the boundary of a mesh with a closed surface."""
    boundary, _ = boundary_surface(mesh)
    onto_surface = tree_of(surface)
    centres = boundary.points[boundary.faces].mean(axis=1)
    volume, surface_volume = (abs(enclosed_volume(s.points, s.faces)) / 1000 for s in (boundary, surface))
    area, surface_area = (float(face_areas(s.points, s.faces).sum()) for s in (boundary, surface))
    return Fidelity(
        nodes_to_surface_mm=summary(closest_points(onto_surface, boundary.points).distances),
        face_centres_to_surface_mm=summary(closest_points(onto_surface, centres).distances),
        surface_to_boundary_mm=summary(distances_to(boundary, surface)),
        nodes_to_nearest_vertex_mm=summary(KDTree(surface.points).query(boundary.points)[0]),
        volume_ml=volume,
        relative_volume_change=volume / surface_volume - 1,
        area_mm2=area,
        surface_area_mm2=surface_area,
        relative_area_change=area / surface_area - 1,
        roughness=boundary_roughness(boundary.points, boundary.faces),
        surface_roughness=boundary_roughness(surface.points, surface.faces),
    )


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


def summary(distances: FloatArray) -> Distances:
    """Mean, 95th percentile and maximum of (k,) distances in mm."""
    return Distances(float(distances.mean()), float(np.percentile(distances, 95)), float(distances.max()))


def boundary_roughness(points: FloatArray, faces: IntArray) -> float:
    """RMS distance of the vertices from the mean of their edge neighbours, over the mean edge length; no unit."""
    offsets = np.linalg.norm(points - neighbour_means(points, faces), axis=1)
    return float(np.sqrt((offsets**2).mean()) / mean_edge(points, faces))


def high_frequency_roughness(points: FloatArray, faces: IntArray) -> float:
    """How much of a surface is stair steps or noise: the mean bi-Laplacian of its vertices along their normals.

    The offset of a vertex from the mean of its neighbours is curvature if it changes little from one vertex to the
    next, and roughness if it does not; so the mean of the neighbours' offsets is subtracted. Divided by the mean edge:
    0.006 to 0.027 on atlas surfaces, 0.11 on the steps of a label image. No unit.
    """
    offsets = points - neighbour_means(points, faces)
    changing = offsets - neighbour_means(offsets, faces)
    along = np.einsum("ij,ij->i", changing, vertex_normals(points, faces))
    return float(np.nanmean(np.abs(along)) / mean_edge(points, faces))
