"""Input gate: a surface that can be meshed may pass, mended where that is safe; others are refused with the reason."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pymeshlab
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cortet.errors import InputError
from cortet.formats.gifti import single_precision
from cortet.geometry import topology
from cortet.geometry.intersection import self_intersections
from cortet.mesh import FloatArray, IntArray, TriSurface

VERSION: int = 1

#: longest side of the bounding box, mm: from a small monkey's hemisphere to a whole human brain
EXTENT_MM = (15.0, 200.0)
#: of an unplaced surface in micrometres; beyond it a file is damaged
LARGEST_COORDINATE = 1e9
#: enclosed volume, mL
VOLUME_ML = (1.0, 1000.0)
#: share of the triangles that may cross others and still count as "a few"
MAX_CROSSING = 0.001
#: furthest that a vertex may move in the repair of crossing triangles, mm
MAX_REPAIR_MM = 1.0
_REPAIR_ROUNDS = 12

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class GateReport:
    """What came in and what was mended."""

    #: as given to the gate
    source: str | None
    vertices: int
    faces: int
    genus: int
    volume_ml: float
    area_mm2: float
    #: sides of the bounding box
    extent_mm: tuple[float, float, float]
    unused_vertices_dropped: int
    faces_reoriented: int
    #: triangles that crossed others before the repair
    crossing_faces_repaired: int
    #: vertices that the repair moved, and how far
    repair_moved_vertices: int
    repair_mean_displacement_mm: float
    repair_max_displacement_mm: float


def gate(
    surface: TriSurface, *, source: Any, allow_genus: int = 0, inside: bool = False
) -> tuple[TriSurface, GateReport]:
    """Let one closed, oriented, mm-sized manifold without self-intersections through.

    Unused vertices are dropped, triangles are oriented consistently and outward, and a few crossing triangles are
    pulled apart by smoothing around them. Coordinates are float32 values, so a GIfTI file holds the result exactly.

    Parameters
    ----------
    source : where the surface comes from, for messages and the report
    allow_genus : largest number of handles accepted
    inside : the surface lies inside another one, and may be smaller than a brain

    Raises
    ------
    InputError : the surface has absurd coordinates, is open, not a manifold, in several pieces, not orientable, of
        higher genus, crosses itself in many places, has triangles without area, or is not of a brain's size in mm; says
        which and where
    """
    _check_coordinates(surface, source)
    given = len(surface.points)
    surface = _used_vertices_only(single_precision(surface))
    dropped = given - len(surface.points)
    if dropped:
        logger.warning("%s: dropped %d vertices that no triangle uses", source, dropped)
    _check_area(surface, source)
    oriented = replace(surface, faces=outward(surface.points, surface.faces))
    reoriented = int((oriented.faces != surface.faces).any(axis=1).sum())
    genus = _check_topology(oriented, source, allow_genus)
    if reoriented:
        logger.warning("%s: %d of %d triangles turned outward", source, reoriented, len(surface.faces))
    if not inside:
        _check_size(oriented, source)
    repaired, crossing = _uncross(oriented, source)
    moved = np.linalg.norm(repaired.points - oriented.points, axis=1)
    moved = moved[moved > 0]
    return repaired, GateReport(
        source=None if source is None else str(source),
        vertices=len(repaired.points),
        faces=len(repaired.faces),
        genus=genus,
        volume_ml=topology.enclosed_volume(repaired.points, repaired.faces) / 1000,
        area_mm2=float(topology.face_areas(repaired.points, repaired.faces).sum()),
        extent_mm=_extent(repaired),
        unused_vertices_dropped=dropped,
        faces_reoriented=reoriented,
        crossing_faces_repaired=crossing,
        repair_moved_vertices=len(moved),
        repair_mean_displacement_mm=float(moved.mean()) if len(moved) else 0.0,
        repair_max_displacement_mm=float(moved.max(initial=0)),
    )


def outward(points: FloatArray, faces: IntArray) -> IntArray:
    """Turn triangles so that neighbours agree and the enclosed volume is positive; (m, 3) int32.

    Every triangle stands for two nodes of a graph, as it is and turned; an edge of two triangles links the states that
    run through it in opposite directions. A connected surface then makes two components, one the reverse of the other;
    a surface that cannot be oriented makes only one, and keeps the edges where its triangles disagree.
    """
    directed = faces[:, topology.TRI_EDGES].reshape(-1, 2)
    order = np.argsort(topology.packed(directed), kind="stable")
    undirected = np.sort(directed[order], axis=1)
    here = np.flatnonzero((undirected[1:] == undirected[:-1]).all(axis=1))
    first, second = order[here], order[here + 1]
    agree = directed[first, 0] != directed[second, 0]
    first, second, count = first // 3, second // 3, len(faces)
    links = (np.r_[first, first + count], np.r_[np.where(agree, second, second + count), second + count * agree])
    graph = coo_matrix((np.ones(len(links[0]), np.int8), links), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    turned = label[:count] > label[count:]
    result = np.where(turned[:, None], faces[:, ::-1], faces)
    inside_out = topology.enclosed_volume(points, result) < 0
    return np.ascontiguousarray(result[:, ::-1] if inside_out else result)


def _used_vertices_only(surface: TriSurface) -> TriSurface:
    points, faces, kept = topology.compact(surface.points, surface.faces)
    fields = {name: values[kept] for name, values in surface.point_data.items()}
    return replace(surface, points=points, faces=faces, point_data=fields)


def _check_coordinates(surface: TriSurface, source: Any) -> None:
    """No coordinate that is not finite, or so large that areas and volumes overflow."""
    largest = float(np.abs(surface.points).max(initial=0))
    if not largest <= LARGEST_COORDINATE:
        raise InputError(
            f"a coordinate is {largest:g}, where at most {LARGEST_COORDINATE:g} is accepted in any unit",
            file=source,
            remedy="export the surface again: the file is damaged",
        )


def _check_area(surface: TriSurface, source: Any) -> None:
    """No triangle without area, to within the rounding of its coordinates."""
    corners = surface.points[surface.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    area = topology.face_areas(surface.points, surface.faces)
    bad = np.flatnonzero(area <= np.finfo(np.float32).eps * longest**2)
    if len(bad):
        where = corners[bad[0]].mean(axis=0).round(2).tolist()
        what = f"{len(bad)} triangles without area, the first is triangle {bad[0]} {surface.faces[bad[0]].tolist()}"
        raise InputError(f"{what} at {where} mm", file=source, remedy="collapse them, or remesh the surface")


def _check_topology(surface: TriSurface, source: Any, allow_genus: int) -> int:
    """The genus of a closed manifold, if it is allowed."""
    found = topology.surface_topology(surface.faces)
    problems = found.problems(genus=int(found.genus))
    if problems:
        remedy = "repair the surface, for example with MeshFix or PyMeshLab"
        coincident = len(surface.points) - len(np.unique(surface.points, axis=0))
        if coincident:
            remedy = f"{coincident} vertices coincide with others: merge them, then see what remains"
        elif found.misoriented_edges and len(problems) == 1:
            remedy = "this surface has no inside: it cannot be oriented"
        raise InputError(f"not one closed manifold: {'; '.join(problems)}", file=source, remedy=remedy)
    if found.genus > allow_genus:
        handles = f"genus {found.genus:g} (Euler number {found.euler_number}), at most {allow_genus} is accepted"
        remedy = "correct the topology of the segmentation, or set gate.allow_genus if the handles are meant"
        raise InputError(handles, file=source, remedy=remedy)
    return int(found.genus)


def _extent(surface: TriSurface) -> tuple[float, float, float]:
    x, y, z = np.ptp(surface.points, axis=0).tolist()
    return x, y, z


def _check_size(surface: TriSurface, source: Any) -> None:
    """A brain's or hemisphere's size if lengths are in mm."""
    volume = topology.enclosed_volume(surface.points, surface.faces) / 1000
    extent = max(_extent(surface))
    if EXTENT_MM[0] <= extent <= EXTENT_MM[1] and VOLUME_ML[0] <= volume <= VOLUME_ML[1]:
        return
    usual = f"{EXTENT_MM[0]:g} to {EXTENT_MM[1]:g} mm and {VOLUME_ML[0]:g} to {VOLUME_ML[1]:g} mL"
    what = f"{extent:.4g} mm long and {volume:.4g} mL, where a brain or hemisphere has {usual}"
    unit = "voxels: apply the image's voxel-to-mm affine"
    if EXTENT_MM[0] <= extent * 1000 <= EXTENT_MM[1]:
        unit = "metres: multiply by 1000"
    elif EXTENT_MM[0] <= extent / 1000 <= EXTENT_MM[1]:
        unit = "micrometres: divide by 1000"
    raise InputError(what, file=source, remedy=f"coordinates must be mm; if these are {unit}")


def _uncross(surface: TriSurface, source: Any) -> tuple[TriSurface, int]:
    """Pull a few crossing triangles apart; returns also how many there were.

    Laplacian steps (PyMeshLab) move only the vertices of the triangles that still cross, and of a ring more every third
    round. Vertices and triangles keep their numbers, so fields stay valid. On a macaque surface with 20 crossing
    triangles this moves 25 vertices by up to 0.42 mm, where MeshFix replaces 360 and moves the surface by 0.50 mm.
    """
    crossing = self_intersections(surface)
    if not len(crossing):
        return surface, 0
    where = surface.points[surface.faces[crossing[0]]].mean(axis=0).round(2).tolist()
    found = f"{len(crossing)} of {len(surface.faces)} triangles cross others, the first is {crossing[0]} at {where} mm"
    remedy = "repair them, for example with MeshFix, or remesh the surface"
    if len(crossing) > MAX_CROSSING * len(surface.faces):
        raise InputError(f"{found}; up to {MAX_CROSSING:.1%} would be repaired", file=source, remedy=remedy)
    repaired, remaining = surface, crossing
    for step in range(_REPAIR_ROUNDS):
        repaired = _smoothed_around(repaired, remaining, rings=step // 3)
        remaining = self_intersections(repaired)
        if not len(remaining):
            break
    moved = np.linalg.norm(repaired.points - surface.points, axis=1)
    if len(remaining) or moved.max() > MAX_REPAIR_MM:
        tried = f"smoothing around them by up to {moved.max():.2f} mm leaves {len(remaining)}"
        raise InputError(f"{found}; {tried} ({MAX_REPAIR_MM:g} mm allowed)", file=source, remedy=remedy)
    _check_area(repaired, source)
    logger.warning(
        "%s: %s; pulled apart by moving %d vertices by up to %.3f mm", source, found, (moved > 0).sum(), moved.max()
    )
    return repaired, len(crossing)


def _smoothed_around(surface: TriSurface, faces: IntArray, *, rings: int) -> TriSurface:
    """One Laplacian step of the vertices of `faces` and of the faces within so many rings of them."""
    selected = np.zeros(len(surface.points), bool)
    selected[surface.faces[faces]] = True
    for _ in range(rings):
        selected[surface.faces[selected[surface.faces].any(axis=1)]] = True
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(surface.points, surface.faces, v_scalar_array=selected.astype(float)))
    meshes.compute_selection_by_condition_per_vertex(condselect="(q > 0.5)")
    meshes.apply_coord_laplacian_smoothing(stepsmoothnum=1, cotangentweight=False, selected=True)
    return single_precision(replace(surface, points=meshes.current_mesh().vertex_matrix()))
