"""What a certificate says about each region and each interface of a mesh.

An interface must meet the same conditions as the boundary: it is one closed manifold with the topology of its inner
surface, every vertex lies on that surface, the interface follows all of that surface, and no face crosses another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from cortet.errors import InputError, counted
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.nesting import joined, parents, region_boundary, sheets
from cortet.geometry.topology import (
    SurfaceTopology,
    boundary_surface,
    edges,
    enclosed_volume,
    face_areas,
    interfaces,
    sheet,
    surface_topology,
)
from cortet.measure.fidelity import Distances, summary
from cortet.measure.lost import distances_to
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import REGION, TetMesh, TriSurface, region_names

#: most thin spots to list, and their least distance from each other, mm
_THIN_PLACES, _APART_MM = 5, 5.0


@dataclass(frozen=True)
class Across:
    """How many edges lead through a region: the fewest from each node of its outer side to its inner sides."""

    least: int
    p5: float
    median: float


@dataclass(frozen=True)
class RegionRecord:
    """One region of a mesh compared with the surfaces that bound it."""

    name: str
    #: value of the cell data `region`
    number: int
    tetrahedra: int
    volume_ml: float
    #: against the volume between the surfaces that bound the region
    relative_volume_change: float
    q_mean: float
    q_max: float
    #: None for a region with nothing inside it
    edges_across: Across | None


@dataclass(frozen=True)
class ThinPlace:
    """Where a region is thin: a node of its interface and its distance to the faces on the other side."""

    place_mm: tuple[float, float, float]
    thickness_mm: float


@dataclass(frozen=True)
class InterfaceRecord:
    """The faces between a region and the region around it, compared with the inner surface they represent."""

    #: name of the region inside
    name: str
    around: str
    faces: int
    topology: SurfaceTopology
    #: Euler number of the surface
    surface_euler_number: int
    #: faces that are not between these two regions
    misplaced_faces: int
    nodes_to_surface_mm: Distances
    surface_to_interface_mm: Distances
    relative_area_change: float
    #: the thinnest spots of the region around, well apart from each other
    thinnest: tuple[ThinPlace, ...]


def require_known_regions(mesh: TetMesh, surface: TriSurface) -> None:
    """Raise InputError unless each tetrahedron has the number of a region between the surfaces of a nested one."""
    names, region = region_names(surface.inner), _region(mesh)
    known = ", ".join(f"{number} {name}" for number, name in enumerate(names, start=1))
    remedy = f"number the regions like the surfaces: {known}"
    if region.ndim != 1 or region.dtype.kind not in "biuf":
        what = (
            f"regions of the shape {region.shape} and the type {region.dtype} are not numbers, one for each tetrahedron"
        )
        raise InputError(what, remedy=remedy)
    unknown = ~np.isin(region, np.arange(1, len(names) + 1))
    if unknown.any():
        what = f"{counted(unknown.sum(), 'tetrahedron', 'tetrahedra')} of region {region[unknown][0]} without a surface"
        raise InputError(what, remedy=remedy)


def region_records(mesh: TetMesh, surface: TriSurface) -> tuple[RegionRecord, ...]:
    """One record for each region; `mesh` has the cell data `region` of the nested `surface`."""
    region = _region(mesh)
    volumes, q = signed_volumes(mesh.points, mesh.cells), quality(mesh.points, mesh.cells)
    around = parents(surface)
    records = []
    for number, name in enumerate(region_names(surface.inner)):
        mine = region == number + 1
        bounds = region_boundary(surface, number)
        volume, given = float(volumes[mine].sum()) / 1000, enclosed_volume(bounds.points, bounds.faces) / 1000
        within = [child for child, parent in enumerate(around) if parent == number]
        records.append(
            RegionRecord(
                name=name,
                number=number + 1,
                tetrahedra=int(mine.sum()),
                volume_ml=volume,
                relative_volume_change=volume / given - 1,
                q_mean=float(q[mine].mean()) if mine.any() else 0.0,
                q_max=float(q[mine].max(initial=0)),
                edges_across=_across(mesh, number, within) if within and mine.any() else None,
            )
        )
    return tuple(records)


def interface_records(mesh: TetMesh, surface: TriSurface) -> tuple[InterfaceRecord, ...]:
    """One record per inner surface. If the mesh lacks its interface, distances are the size of the surface."""
    region = _region(mesh)
    found, names, around = interfaces(mesh), region_names(surface.inner), parents(surface)
    records = []
    for number, one in enumerate(sheets(surface)[1:], start=1):
        faces, nodes = sheet(mesh, number)
        mine = found.region == number + 1
        if len(nodes):
            off = summary(closest_points(tree_of(one), faces.points).distances)
            lost = summary(distances_to(faces, one))
        else:
            off = lost = Distances(*[float(np.ptp(one.points, axis=0).max())] * 3)
        records.append(
            InterfaceRecord(
                name=names[number],
                around=names[around[number]],
                faces=len(faces.faces),
                topology=surface_topology(faces.faces),
                surface_euler_number=surface_topology(one.faces).euler_number,
                misplaced_faces=int((region[found.behind[mine]] != around[number] + 1).sum()),
                nodes_to_surface_mm=off,
                surface_to_interface_mm=lost,
                relative_area_change=_area(faces) / _area(one) - 1,
                thinnest=_thinnest(faces, sheet(mesh, around[number])[0]),
            )
        )
    return tuple(records)


def _thinnest(inner: TriSurface, outer: TriSurface) -> tuple[ThinPlace, ...]:
    """The vertices of `inner` nearest to `outer`, none within a few mm of a nearer one."""
    if not len(inner.points) or not len(outer.points):
        return ()
    distance = closest_points(tree_of(outer), inner.points).distances
    found: list[ThinPlace] = []
    left = np.ones(len(distance), np.bool_)
    while len(found) < _THIN_PLACES and left.any():
        nearest = int(np.where(left, distance, np.inf).argmin())
        x, y, z = inner.points[nearest].tolist()
        found.append(ThinPlace((x, y, z), float(distance[nearest])))
        left &= np.linalg.norm(inner.points - inner.points[nearest], axis=1) > _APART_MM
    return tuple(found)


def sheets_of(mesh: TetMesh) -> TriSurface:
    """The boundary, then the interfaces of a mesh, as one surface, none of whose faces may cross another."""
    numbers = np.unique(interfaces(mesh).region).tolist()
    return joined([boundary_surface(mesh)[0], *(sheet(mesh, number - 1)[0] for number in numbers)])


def _region(mesh: TetMesh) -> NDArray[np.integer]:
    return np.asarray(mesh.cell_data.get(REGION, np.ones(len(mesh.cells), np.int32)))


def _across(mesh: TetMesh, number: int, within: list[int]) -> Across | None:
    links = edges(mesh.cells[_region(mesh) == number + 1])
    graph = coo_matrix((np.ones(len(links)), (links[:, 0], links[:, 1])), shape=(len(mesh.points),) * 2)
    outer = sheet(mesh, number)[1]
    inner = np.concatenate([sheet(mesh, other)[1] for other in within])
    if not len(inner) or not len(outer):
        return None
    steps = dijkstra(graph.tocsr(), directed=False, indices=inner, unweighted=True, min_only=True)[outer]
    steps = steps[np.isfinite(steps)]
    if not len(steps):  # no edges lead across, so the region numbers are wrong
        return None
    return Across(int(steps.min()), float(np.percentile(steps, 5)), float(np.median(steps)))


def _area(surface: TriSurface) -> float:
    return float(face_areas(surface.points, surface.faces).sum())
