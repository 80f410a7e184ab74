"""Repair of a broken surface, within limits: repairs with one right answer are made and recorded, the rest is refused.

A surface without a flaw passes with its arrays unchanged. The steps run in the order that changes least: first repairs
that equal positions and indices decide, then new triangles in holes, then cuts through handles, and last crossing
triangles.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from cortet.config.stages import Repair
from cortet.errors import InputError
from cortet.formats.hashing import sha256
from cortet.formats.ownership import files_of, json_of
from cortet.geometry.mending import CAP, GIVEN, measurable
from cortet.geometry.topology import enclosed_volume, face_areas
from cortet.measure.fidelity import Distances, summary
from cortet.measure.lost import distances_to
from cortet.meshes import TriSurface
from cortet.stages._repairing import BrokenSurface, RepairStep, has_flaw

VERSION: int = 5

#: remedy if no better one is known
_REMEDY = "edit the surface there, or remesh it"

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RepairReport:
    """What was done to a surface, and how far it is from the file."""

    source: str | None
    #: false: the surface passed as it is, and what follows is as in the file
    repaired: bool
    steps: tuple[RepairStep, ...]
    vertices_before: int
    vertices: int
    faces_before: int
    faces: int
    #: vertices and face centres of the file to the nearest point of the repaired surface, and vice versa
    file_to_surface_mm: Distances
    surface_to_file_mm: Distances
    #: farthest that a triangle was moved, or lies from the one that it replaces; without caps and cuts
    displacement_max_mm: float
    area_before_mm2: float
    area_mm2: float
    #: area of caps on holes of the file
    filled_area_mm2: float
    #: area of all triangles that the file does not have: caps, and replacements of what was cut out
    new_area_mm2: float
    #: area of separate pieces that were dropped
    dropped_area_mm2: float
    #: volume between the caps on holes of the file and flat ones, mL
    bulge_ml: float
    #: volume of the file with its holes filled
    volume_before_ml: float
    volume_ml: float
    relative_area_change: float
    relative_volume_change: float


def repair(
    surface: TriSurface, settings: Repair = Repair(), *, source: Any, allow_genus: int = 0
) -> tuple[TriSurface, RepairReport]:
    """Turn a surface into one closed manifold without crossing triangles, if that has one right answer.

    Values of fields are kept; new vertices take those of the nearest point of the given surface. If a hole was filled,
    the field `filled` is 1 on the vertices of its cap. Coordinates of a repaired surface are float32 values.

    Parameters
    ----------
    surface : as read; coordinates need not be finite; its inner surfaces stay as they are
    settings : as `Repair` describes them
    source : where it comes from, for messages and the report
    allow_genus : number of handles that may stay

    Raises
    ------
    InputError
        something is beyond these limits, or has no single right answer; says what and where
    """
    if not has_flaw(surface, allow_genus):
        return surface, _report(surface, surface, source)
    work = BrokenSurface(surface, settings, allow_genus)
    try:
        work.set_right()
        made = work.result()
    except InputError as error:  # the functions that refuse a surface do not know its file
        raise InputError(error.what, file=source, remedy=error.remedy or _REMEDY) from None
    logger.warning("%s: repaired: %s", source or "the surface", work.done())
    return made, _report(surface, made, source, work)


def record_path(file: Path) -> Path:
    """The report that `cortet repair` writes beside a surface."""
    return file.with_name(f"{file.stem}.repair.json")


def repaired_before(source: str | None) -> RepairReport | None:
    """What `cortet repair` did to a surface whose file it wrote; None for other files, and for one that was edited."""
    if source is None or not (record := record_path(Path(source))).is_file():
        return None
    done = json_of(record)
    if not done.get("repaired") or files_of(record).get(Path(source).name) != sha256(source):
        return None
    known = {key: done.get(key) for key in RepairReport.__dataclass_fields__}
    try:
        return TypeAdapter(RepairReport).validate_python(known)
    except ValidationError:  # of another version
        return None


def _report(given: TriSurface, made: TriSurface, source: Any, work: BrokenSurface | None = None) -> RepairReport:
    """The report of a repair; without one, of a surface that passed as it is."""
    file = given if work is None else measurable(given)
    from_file = to_file = Distances(0.0, 0.0, 0.0)
    if work is not None:
        away = distances_to(made, file)
        from_file = summary(np.r_[away[np.unique(file.faces)], away[len(file.points) :]])
        to_file = summary(distances_to(file, made))
    before, areas = float(face_areas(file.points, file.faces).sum()), face_areas(made.points, made.faces)
    area = float(areas.sum())
    volume = enclosed_volume(made.points, made.faces)
    volume_before = volume if work is None else work.volume_before
    return RepairReport(
        source=None if source is None else str(source),
        repaired=work is not None,
        steps=() if work is None else tuple(work.steps),
        vertices_before=len(given.points),
        vertices=len(made.points),
        faces_before=len(given.faces),
        faces=len(made.faces),
        file_to_surface_mm=from_file,
        surface_to_file_mm=to_file,
        displacement_max_mm=0.0 if work is None else work.displacement,
        area_before_mm2=before,
        area_mm2=area,
        filled_area_mm2=0.0 if work is None else float(areas[work.work.made == CAP].sum()),
        new_area_mm2=0.0 if work is None else float(areas[work.work.made != GIVEN].sum()),
        dropped_area_mm2=0.0 if work is None else work.dropped,
        bulge_ml=0.0 if work is None else work.bulge / 1000,
        volume_before_ml=volume_before / 1000,
        volume_ml=volume / 1000,
        relative_area_change=area / before - 1,
        relative_volume_change=volume / volume_before - 1,
    )
