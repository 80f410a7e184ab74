"""Input gate: a surface that can be meshed passes, mended where that is safe; others are refused with the reason."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cortet.config.stages import Gate
from cortet.errors import InputError, counted
from cortet.formats.placement import UNITS
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import flat_faces
from cortet.geometry.orientation import outward
from cortet.geometry.smoothing import laplacian
from cortet.geometry.topology import SurfaceTopology, compact, enclosed_volume, face_areas, surface_topology
from cortet.geometry.uncrossing import moved_apart
from cortet.measure.quality import signed_volumes
from cortet.measure.usual_size import UNUSUAL_TIMES, unusual_volume
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface, single_precision

VERSION: int = 4

#: longest side of the bounding box, mm: from a small monkey's hemisphere to an adult human brain in its shell
EXTENT_MM = (15.0, 220.0)
#: the same where the user has stated the unit: from the smallest mammal's to the largest's. No unit that is wrong by a
#: factor of 1000 gives a brain of such a size
STATED_EXTENT_MM = (1.0, 500.0)
#: bound for an unplaced surface in micrometres; a file beyond it is damaged
LARGEST_COORDINATE = 1e9
#: enclosed volume, mL, and where the user has stated the unit
VOLUME_ML, STATED_VOLUME_ML = (1.0, 3000.0), (0.0, 10_000.0)
#: share of the triangles that may cross others and still count as "a few"
MAX_CROSSING = 0.001
#: farthest that the repair of crossing triangles may move a vertex, mm
MAX_REPAIR_MM = 1.0
_REPAIR_ROUNDS = 12

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class GateReport:
    """What was given and what was mended."""

    #: as given to the gate
    source: str | None
    vertices: int
    faces: int
    genus: int
    volume_ml: float
    area_mm2: float
    unused_vertices_dropped: int
    faces_reoriented: int
    #: triangles that crossed others before the repair
    crossing_faces_repaired: int
    #: vertices that the repair moved, and how far
    repair_moved_vertices: int
    repair_max_displacement_mm: float
    #: why the age may be wrong, in words; empty if the volume is usual at this age, or the age is not known
    doubt: str


def gate(
    surface: TriSurface,
    settings: Gate = Gate(),
    *,
    source: Any,
    inside: bool = False,
    gestational_age: float | None = None,
    hemi: str | None = None,
    to_mm: float | None = None,
) -> tuple[TriSurface, GateReport]:
    """Let one closed, oriented, mm-sized manifold without self-intersections through.

    Unused vertices are dropped, triangles are oriented consistently and outward, and a few crossing triangles are
    pulled apart by smoothing around them. Coordinates are float32 values, so a GIfTI file holds the result exactly.

    Parameters
    ----------
    settings : as `Gate` describes them; `unit` is applied before
    source : where the surface comes from, for messages and the report
    inside : the surface lies inside another one, and may be smaller than a brain
    gestational_age : weeks, if it is known; the report says if the volume is unusual at this age
    hemi : L or R; None: a whole brain, or not known
    to_mm : the factor that has brought its coordinates to mm, if the user has stated their unit; else None

    Raises
    ------
    InputError : the surface has absurd coordinates, is open, not a manifold, in several pieces, not orientable, of
        higher genus, crosses itself in many places, has triangles without area, or is not of a brain's size in mm; says
        which and where
    """
    named = source or "the surface"
    try:
        _check_coordinates(surface.points)
        points, faces, kept = compact(surface.points, surface.faces)
        fields = {name: values[kept] for name, values in surface.point_data.items()}
        used = single_precision(replace(surface, points=points, faces=faces, point_data=fields))
        if dropped := len(surface.points) - len(used.points):
            logger.warning("%s: dropped %d vertices that no triangle uses", named, dropped)
        _check_area(used, flat_faces(used.points, used.faces))
        oriented = replace(used, faces=outward(used.points, used.faces))
        if np.array_equal(oriented.points, surface.points) and np.array_equal(oriented.faces, surface.faces):
            oriented = surface  # of which it may be known what crosses
        topology = surface_topology(oriented.faces)
        _check_topology(oriented, topology, settings.allow_genus)
        if reoriented := int((oriented.faces != used.faces).any(axis=1).sum()):
            logger.warning("%s: %d of %d triangles turned outward", named, reoriented, len(used.faces))
        extents = np.ptp(oriented.points, axis=0).tolist()
        if not inside:
            require_size(oriented, to_mm=to_mm or 1.0, stated=to_mm is not None)
        repaired, crossing = _uncross(oriented, named)
    except InputError as error:
        raise InputError(error.what, file=source, remedy=error.remedy) from None
    moved = np.linalg.norm(repaired.points - oriented.points, axis=1)
    moved = moved[moved > 0]
    volume, doubt = enclosed_volume(repaired.points, repaired.faces) / 1000, ""
    if gestational_age is not None and not inside:
        unusual = unusual_volume(volume, extents, gestational_age, hemi, times=UNUSUAL_TIMES)
        doubt = f"the surface encloses {unusual}; is its age right?" if unusual else ""
    if doubt:
        logger.warning("%s: %s", named, doubt)
    return repaired, GateReport(
        source=None if source is None else str(source),
        vertices=len(repaired.points),
        faces=len(repaired.faces),
        genus=int(topology.genus),
        volume_ml=volume,
        area_mm2=float(face_areas(repaired.points, repaired.faces).sum()),
        unused_vertices_dropped=dropped,
        faces_reoriented=reoriented,
        crossing_faces_repaired=crossing,
        repair_moved_vertices=len(moved),
        repair_max_displacement_mm=float(moved.max(initial=0)),
        doubt=doubt,
    )


def _check_coordinates(points: FloatArray) -> None:
    """Raise InputError for coordinates that are not finite, or so large that areas and volumes overflow."""
    largest = float(np.abs(points).max(initial=0))
    if not largest <= LARGEST_COORDINATE:
        raise InputError(
            f"a coordinate is {largest:g}; the largest accepted value, in any unit, is {LARGEST_COORDINATE:g}",
            remedy="export the surface again: the file is damaged",
        )


def _check_area(surface: TriSurface, flat: IntArray) -> None:
    """Raise InputError for triangles without area."""
    if len(flat):
        first = surface.faces[flat[0]]
        where = surface.points[first].mean(axis=0).round(2).tolist()
        what = (
            f"{counted(len(flat), 'triangle has', 'triangles have')} no area; the first is triangle {flat[0]} "
            f"{first.tolist()} at {where} mm"
        )
        raise InputError(what, remedy="collapse them, or remesh the surface")


def _check_topology(surface: TriSurface, found: SurfaceTopology, allow_genus: int) -> None:
    """Raise InputError unless the surface is a closed manifold of an allowed genus."""
    if problems := found.problems(genus=int(found.genus)):
        remedy = "repair the surface, for example with `cortet repair`"
        coincident = len(surface.points) - len(np.unique(surface.points, axis=0))
        if coincident:
            remedy = f"{counted(coincident, 'vertex coincides', 'vertices coincide')} with others: merge them first"
        elif found.misoriented_edges and len(problems) == 1:
            remedy = "the surface is not orientable, so it has no inside"
        raise InputError(f"the surface is not one closed manifold: {'; '.join(problems)}", remedy=remedy)
    if found.genus > allow_genus:
        raise InputError(
            f"genus {found.genus:g} (Euler number {found.euler_number}), at most {allow_genus} is accepted",
            remedy="correct the topology of the segmentation, or set gate.allow_genus if the handles are real",
        )


def require_size(
    shape: TriSurface | TetMesh,
    *,
    file: Any = None,
    to_mm: float = 1.0,
    stated: bool = False,
    option: str = "set gate.unit: {unit}",
    convert: str = "",
) -> None:
    """Raise InputError unless a surface or mesh has the size of a brain or hemisphere.

    Parameters
    ----------
    shape : mm
    file : where it comes from, for the message
    to_mm : the factor that has brought its coordinates to mm; the error names units of the coordinates before
    stated : the user has stated their unit, or cortet has written it: the brain may be that of any mammal
    option : how a user states a unit, with `{unit}` for it; without, what to do where none can be stated
    convert : what to do about another unit than mm where only mm can be stated
    """
    if isinstance(shape, TriSurface):
        volume = abs(enclosed_volume(shape.points, shape.faces)) / 1000
    else:
        volume = abs(float(signed_volumes(shape.points, shape.cells).sum())) / 1000
    corners = shape.faces if isinstance(shape, TriSurface) else shape.cells
    long = float(np.ptp(shape.points[np.unique(corners)], axis=0).max())  # what nothing uses may lie anywhere
    extents, volumes = (STATED_EXTENT_MM, STATED_VOLUME_ML) if stated else (EXTENT_MM, VOLUME_ML)
    if extents[0] <= long <= extents[1] and volumes[0] <= volume <= volumes[1]:
        return
    stored = long / to_mm
    likely = [
        unit for unit, factor in UNITS.items() if factor != to_mm and EXTENT_MM[0] <= stored * factor <= EXTENT_MM[1]
    ]
    remedies = [f"if the coordinates are in {unit}, {convert or option.format(unit=unit)}" for unit in likely]
    if not likely:
        remedies.append("give coordinates in mm, not voxel indices")
    if (
        "{unit}" in option
        and not stated
        and "mm" not in likely
        and STATED_EXTENT_MM[0] <= stored <= STATED_EXTENT_MM[1]
    ):
        remedies.append(f"if this really is the size of the brain, {option.format(unit='mm')}")
    raise InputError(
        f"the surface is {long:.4g} mm long and encloses {volume:.4g} mL; cortet accepts {extents[0]:g} to "
        f"{extents[1]:g} mm and {volumes[0]:g} to {volumes[1]:g} mL",
        file=file,
        remedy="; ".join(remedies),
    )


def _uncross(surface: TriSurface, named: Any) -> tuple[TriSurface, int]:
    """Pull a few crossing triangles apart; returns also how many there were.

    On a macaque surface with 20 crossing triangles this moves 25 vertices by up to 0.42 mm, where MeshFix replaces 360
    and moves the surface by 0.50 mm.
    """
    crossing = self_intersections(surface)
    if not len(crossing):
        return surface, 0

    where = surface.points[surface.faces[crossing[0]]].mean(axis=0).round(2).tolist()
    share = f"{len(crossing)} of {len(surface.faces)} triangles"
    found = f"{share} intersect others; the first is triangle {crossing[0]} at {where} mm"
    remedy = "repair the surface, for example with `cortet repair`, or remesh it"
    if len(crossing) > MAX_CROSSING * len(surface.faces):
        raise InputError(f"{found}; the gate repairs at most {MAX_CROSSING:.1%} of the triangles", remedy=remedy)
    repaired, remaining = moved_apart(surface, lambda one, chosen, _: laplacian(one, chosen), rounds=_REPAIR_ROUNDS)
    moved = np.linalg.norm(repaired.points - surface.points, axis=1)
    if len(remaining) or moved.max() > MAX_REPAIR_MM:
        far = f"smoothing moved vertices by {moved.max():.2f} mm (limit {MAX_REPAIR_MM:g} mm)"
        tried = f"{far}, and {counted(len(remaining), 'triangle still intersects', 'triangles still intersect')}"
        raise InputError(f"{found}; {tried}", remedy=remedy)
    _check_area(repaired, flat_faces(repaired.points, repaired.faces))
    logger.warning(
        "%s: %s; separated by moving %d vertices by up to %.3f mm",
        named,
        found,
        (moved > 0).sum(),
        moved.max(),
    )
    return repaired, len(crossing)
