"""Is a mesh the brain that a fold takes it for?

It should be in mm and RAS coordinates, at its age, with its midline where the hemisphere says, and with cells finer
than its cortex. A mesh that certainly fails is refused; a doubt is reported.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Literal

import numpy as np

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.body import require_positive
from cortet.folding.growth import check_age
from cortet.folding.medial_wall import TOWARDS_MIDLINE
from cortet.folding.run import Run, thickness_mm
from cortet.formats.hashing import sha256
from cortet.formats.surface_sets import MEDIAL_WALL
from cortet.geometry.topology import boundary, components, face_areas, face_normals
from cortet.measure.quality import signed_volumes
from cortet.measure.usual_size import UNUSUAL_TIMES, unusual_volume
from cortet.meshes import AROUND, FloatArray, TetMesh, require_measurable
from cortet.solver_files.sidecar import read_sidecar

#: gestational age, weeks, and hemisphere, where they are known
Brain = tuple[float | None, Literal["L", "R"] | None]
#: weeks by which two ages of one scan may differ, rounded to weeks or not
_SAME_SCAN = 1.0
#: longest side of a body that may be a brain in mm; mice have 8 mm, human adults 180
EXTENT_MM = (5.0, 400.0)
#: a body that is larger or smaller than the usual one of its age by more than this factor is refused
_TIMES = 2.0
#: a side is flat where the faces point to it, up to an angle of this cosine, and are within this depth of the
#: outermost, in units of half the length
_COSINE, _DEPTH = 0.7, 0.12
#: how much flatter than the expected medial side another side must be to be taken for it. In 30 real and synthetic
#: hemispheres of 22 weeks to adults, the medial side is 1.13 to 5 times as flat as any other
_OTHER_SIDE, _OTHER_AXIS = 1.2, 1.5
#: cell size over thickness above which the cells determine the width of folds
COARSEST = 0.6
#: half a brain lies on one side of x = 0 if it reaches beyond it by less than this share of its width
_REACH = 0.1
#: smallest over largest extent below which a body has the shape of half a brain (0.36 to 0.5); the sides of a rounder
#: body are uncertain
_NARROW = 0.65
#: largest ratio of flatness at which two sides are equally flat
_ALIKE = 1.05
#: tetrahedra per cube of the cell size
_TETS_PER_CUBE = 4.0

_SIDES = {(axis, sign): f"{'+' if sign > 0 else '-'}{'xyz'[axis]}" for axis in range(3) for sign in (1, -1)}


def refuse_space_around(regions: Collection[str]) -> None:
    """Raise InputError if another region surrounds the brain: the model's cortex ends at the boundary.

    Parameters
    ----------
    regions : names of the regions of a mesh, or of its sets of tetrahedra
    """
    if around := [name for name in AROUND if name in regions]:
        what = f"the mesh has the region {around[0]} around the brain"
        raise InputError(what, remedy="mesh the brain without a surface around it")


def check_mesh(mesh: TetMesh, settings: Settings) -> list[str]:
    """Doubts about a mesh, as sentences.

    Raises
    ------
    InputError
        the age is impossible; the mesh cannot be measured, has inverted elements or several pieces, or is not a brain
        of its age in mm; other regions surround the brain; or its medial side is another than the hemisphere says
    """
    require_measurable(mesh)
    refuse_space_around(mesh.sets.cells)
    require_positive(signed_volumes(mesh.points, mesh.cells))
    if (pieces := components(mesh.cells)) > 1:
        raise InputError(f"the mesh has {pieces} separate pieces", remedy="fold each brain or hemisphere by itself")
    check_age(settings.gestational_age)
    if settings.reference:
        return []
    doubts = _of_size(mesh, settings)
    return doubts + (_side(mesh, settings.hemisphere) if settings.hemisphere else [])


def cell_size_mm(run: Run) -> float:
    """Size of the cells next to the surface, mm."""
    volumes = signed_volumes(run.mesh.points, run.mesh.cells)[np.unique(boundary(run.mesh).cells)]
    return float(np.cbrt(_TETS_PER_CUBE * np.median(volumes)))


def check_cells(run: Run, settings: Settings) -> list[str]:
    """A doubt, as a sentence, about a forced fold whose cells are nearly as coarse as its cortex is thick.

    Raises
    ------
    InputError : the cells next to the surface are so coarse, and the fold is not forced
    """
    size, thickness = cell_size_mm(run), thickness_mm(run)
    if size <= COARSEST * thickness:
        return []
    doubt = (
        f"the cells are {size:.2f} mm and the cortex is {thickness:.2f} mm thick, so the cells determine the width of "
        "the folds"
    )
    if settings.force or settings.reference:
        return [doubt]
    raise InputError(
        doubt,
        remedy=f"use cells of at most {COARSEST * thickness:.2g} mm, such as those of `--setting folding`; "
        "to fold this mesh anyway, set fold.force or add --force",
    )


def _of_size(mesh: TetMesh, settings: Settings) -> list[str]:
    """A doubt about a volume that is unusual at its age.

    Raises
    ------
    InputError : the length is not that of a brain in mm, or the volume is that of no brain, and nothing is forced
    """
    extents = np.ptp(mesh.points, axis=0).tolist()
    longest = max(extents)
    low, high = EXTENT_MM
    if not low <= longest <= high:
        unit = next(
            (name for name, factor in {"metres": 1e3, "micrometres": 1e-3}.items() if low <= longest * factor <= high),
            "",
        )
        raise InputError(
            f"the mesh is {longest:.4g} mm long; cortet accepts {low:g} to {high:g} mm"
            + (f"; its coordinates may be in {unit}" if unit else ""),
            remedy="give a mesh in mm",
        )
    volume, age = float(signed_volumes(mesh.points, mesh.cells).sum()) / 1000, settings.gestational_age
    if not settings.force and (refused := unusual_volume(volume, extents, age, settings.hemisphere, times=_TIMES)):
        raise InputError(
            f"the mesh has {refused}",
            remedy="give the age of this brain, and a mesh in mm; for other species set fold.force or add --force",
        )
    unusual = unusual_volume(volume, extents, age, settings.hemisphere, times=UNUSUAL_TIMES)
    return [f"the mesh has {unusual}"] if unusual else []


def _side(mesh: TetMesh, hemisphere: str) -> list[str]:
    """A doubt if the medial side of half a brain is not where it should be; InputError if it is certainly elsewhere.

    A medial side is the flattest of the six, so another side that is flatter contradicts the one expected.
    """
    said = (0, int(TOWARDS_MIDLINE[hemisphere]))
    if MEDIAL_WALL in mesh.point_data or MEDIAL_WALL in mesh.sets.faces:
        return []
    flat = flatness(mesh)
    best = max(flat, key=lambda side: flat[side])
    ratio = flat[best] / max(flat[said], np.finfo(float).tiny)
    if ratio <= _ALIKE:
        return []
    other = {"L": "R", "R": "L"}[hemisphere]
    opposite = best == (0, -said[1])
    what = (
        f"the midline of hemisphere {hemisphere} lies at {_SIDES[said]} in RAS coordinates, but the flattest side of "
        f"the mesh is {_SIDES[best]} ({flat[best]:.1%} of the surface, {flat[said]:.1%} at {_SIDES[said]})"
    )
    remedy = (
        f"use --hemi {other} (in a sheet: hemi) if it is that side, or convert LPS coordinates to RAS"
        if opposite
        else "convert the mesh to RAS coordinates: x to the right, y to the front, z up"
    )
    across = -said[1] * mesh.points[:, 0]  # above 0 on the side of the midline x = 0 where this half should be
    elsewhere = opposite and across.max() < _REACH * np.ptp(across)
    extents = np.ptp(mesh.points, axis=0)
    half = extents.min() < _NARROW * extents.max()
    if half and (elsewhere or ratio >= (_OTHER_SIDE if opposite else _OTHER_AXIS)):
        raise InputError(what, remedy=f"{remedy}; or mark the medial wall in a field {MEDIAL_WALL} of the mesh")
    return [f"{what}: {remedy}"]


def flatness(mesh: TetMesh) -> dict[tuple[int, int], float]:
    """Share of the surface that is flat and outermost on each of the six sides: (axis, sign) -> share."""
    faces = boundary(mesh).faces
    areas = face_areas(mesh.points, faces)
    normals: FloatArray = face_normals(mesh.points, faces) / (2 * areas[:, None])
    centres = mesh.points[faces].mean(axis=1)
    depth = _DEPTH * float(np.ptp(mesh.points, axis=0).max()) / 2
    return {
        (axis, sign): float(
            areas[
                (sign * normals[:, axis] > _COSINE)
                & (sign * centres[:, axis] > (sign * centres[:, axis]).max() - depth)
            ].sum()
            / areas.sum()
        )
        for axis, sign in _SIDES
    }


def brain_of(mesh: Path, age: float | None, hemisphere: Literal["L", "R"] | None) -> Brain:
    """Gestational age, weeks, and hemisphere of a mesh file: those given, or else those that its sidecar records.

    A sidecar of another file, or of the mesh before it was edited, gives none.
    """
    record = read_sidecar(mesh)
    origin = record.get("made_from") or {}
    known, side = origin.get("gestational_age"), origin.get("hemisphere")
    require_same_brain((age, hemisphere), (known, side), file=mesh)
    if (age is None or hemisphere is None) and record.get("files") and sha256(mesh) not in record["files"].values():
        return age, hemisphere
    return known if age is None else age, hemisphere or side


def require_same_brain(given: Brain, made: Brain, *, file: Path | None = None) -> None:
    """Raise InputError if age or hemisphere differ from those that a mesh, which may come from a file, was made for."""
    (age, hemisphere), (known, side) = given, made
    mesh, says = ("", " according to its sidecar") if file else ("the mesh ", "")
    if age is not None and known is not None and abs(age - known) > _SAME_SCAN:
        raise InputError(
            f"{mesh}was made for a brain of {known:g} weeks{says}, not {age:g}",
            file=file,
            remedy=f"give the age {known:g}, or make the mesh again with the right age",
        )
    if hemisphere and side and hemisphere != side:
        raise InputError(
            f"{mesh}was made from a surface of hemisphere {side}{says}, not {hemisphere}",
            file=file,
            remedy=f"give the hemisphere {side}, or make the mesh again with the right one",
        )
