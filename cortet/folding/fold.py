"""Fold a mesh from one gestational age to another, write the results, and say how it ended."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.cohort.lock import NAME as LOCK
from cortet.cohort.lock import hold
from cortet.config.fold import Settings
from cortet.errors import place_mm
from cortet.folding.body import with_interface
from cortet.folding.contact import listed_at
from cortet.folding.fields import THICKNESS_FIELD
from cortet.folding.growth import age_of, time_of
from cortet.folding.growth_map import ages_of_maps
from cortet.folding.journal import (
    CHECKPOINT,
    FILES,
    SERIES,
    SIDECAR,
    TABLE,
    VERDICT,
    Progress,
    fingerprint,
    load_checkpoint,
    save_checkpoint,
    write_series,
)
from cortet.folding.kernels import Motion
from cortet.folding.measurements import COLUMNS, COMPRESSED, DISTORTED, Measurements
from cortet.folding.measures import weeks_in
from cortet.folding.mechanics import Mechanics, distortion, mechanics
from cortet.folding.patches import renew
from cortet.folding.plausible import COARSEST, cell_size_mm, check_cells, check_mesh
from cortet.folding.run import (
    Moment,
    Run,
    advance_to,
    beginning,
    described,
    measured,
    millimetres,
    prepared,
    thickness_mm,
)
from cortet.formats import vtu
from cortet.formats.atomic import write_json
from cortet.formats.ownership import delete, delete_abandoned, is_ours
from cortet.formats.surface_sets import MEDIAL_WALL
from cortet.formats.tables import write_table
from cortet.meshes import FloatArray, TetMesh

VERSION: int = 17

#: wall time between two checkpoints, and between two updates of the tables
_CHECKPOINT_SECONDS, _TABLE_SECONDS = 30.0, 1.0
#: names of frames
_FRAMES = "frame_[0-9][0-9][0-9][0-9]*.vtu"
#: weeks by which two ages may differ and be the same
SAME_AGE = 1e-6
#: gyrification index below which a body is none that folds, and its fold ends
_LEAST_INDEX = 0.95
#: column of the table, largest fraction of tetrahedra that is no doubt, and what these tetrahedra do. Of a brain at 34
#: weeks 1 % were distorted; there, cells a quarter smaller changed edges by 3.5 %, elsewhere by 2 %. With more than
#: 5 % no fold has been compared. No tissue is compressed to half of its volume, so a tenth of a per cent is a doubt
_STRAINED = (
    ("distorted_share", 0.05, f"are stretched elastically {DISTORTED:g} times as much along as across"),
    ("compressed_share", 1e-3, f"are compressed to less than {COMPRESSED:g} of their volume"),
)
#: errors of a fold that are due to its cells, of the index over its gain and of the width over itself, divided by the
#: square of cell size over thickness: means of four brains with two sizes each (0.42 to 0.73 and 0.10 to 0.41 at 34
#: weeks), about the same in each week. A third size of two of them gives the same: `snakemake -s studies/Snakefile`
_INDEX_ERROR, _WIDTH_ERROR = 0.6, 0.3
#: weeks by which the age in the name of a field may be rounded
_ROUNDED = 1e-3

logger = logging.getLogger(__name__)

#: called with a sentence
Say = Callable[[str], None]


@dataclass(frozen=True)
class Verdict:
    """How a run ended, in plain values."""

    outcome: Literal["folded", "inverted", "implausible"]
    reason: str
    #: what is doubtful about the mesh, in sentences
    warnings: tuple[str, ...]
    tets: int
    #: number of steps taken
    steps: int
    gestational_age: float
    #: thickness of the growing cortex at the start; its mean if it varies
    thickness_mm: float
    #: smallest J of all steps
    min_j: float
    #: largest elastic distortion of all rows of the table, None if an element has inverted; and largest fractions of
    #: tetrahedra with a large distortion and a small J
    distortion_max: float | None
    distorted_share: float
    compressed_share: float
    gyrification_index_last: float
    #: size of the cells in the cortex, and the errors of index and width at the end that are due to it, as in the table
    cell_size_mm: float
    gyrification_index_error: float | None
    fold_spacing_error_mm: float | None
    #: of the fold: the section `fold`, gestational age at the start, and hemisphere
    settings: dict[str, Any]
    #: the tetrahedron that inverted, and its centre
    element: int | None = None
    place_mm: tuple[float, float, float] | None = None


def fold(
    mesh: TetMesh,
    folder: Path,
    settings: Settings,
    progress: Progress | None = None,
    say: Say = logger.info,
    *,
    frames_at: Sequence[float] = (),
) -> Verdict:
    """Grow the cortex of a mesh until the end, its last map of growth, or the first element that inverts.

    The folder gets the table of measurements with its sidecar, a table of wall seconds, frames with their series, and
    the verdict. A run that was killed continues from its last checkpoint there and ends with the same bits, and so does
    one that had ended. With another mesh or other settings it starts again.

    Parameters
    ----------
    mesh : mm, RAS coordinates; point data `growth` (0 to 1), `thickness` (mm) and `label` are used if present; if it
        has regions, the outer one is the cortex
    frames_at : further ages, weeks, that get a row and a frame, such as those of surfaces to compare with

    Raises
    ------
    InputError : the mesh cannot be folded, or another fold is writing to the folder
    """
    mesh = with_interface(mesh)
    doubts = check_mesh(mesh, settings)
    known = max(ages_of_maps(mesh), default=settings.end)
    if settings.gestational_age < known < settings.end - _ROUNDED:
        doubts.append(f"growth was measured up to {known:g} weeks, so the fold ends there, not at {settings.end:g}")
        settings = settings.with_keys(end=known)
    run = prepared(mesh, settings)
    doubts += check_cells(run, settings)
    for sentence in [*described(run), *(f"warning: {doubt}" for doubt in doubts)]:
        say(sentence)
    frames_at = [*frames_at, *settings.surfaces]
    made_of = fingerprint(mesh, {**settings.model_dump(), "version": VERSION, "frames_at": frames_at})
    is_new = not folder.exists()
    with hold(folder):
        try:
            moment, rows = _followed(run, Journal(folder, made_of), settings, progress, frames_at)
            verdict = _verdict(run, moment, rows, [*doubts, *_strained(rows)], settings)
            write_json(asdict(verdict), folder / VERDICT)
        finally:
            (folder / LOCK).unlink()
            if is_new and not any(folder.iterdir()):  # the fold was refused
                folder.rmdir()
    return verdict


def _followed(
    run: Run, journal: Journal, settings: Settings, progress: Progress | None, frames_at: Sequence[float]
) -> tuple[Moment, list[dict[str, Any]]]:
    """Follow a run to its end: its last moment, and the rows of its table."""
    moment = journal.resumed(run)
    stops = _stops(run, settings, frames_at)
    relative = cell_size_mm(run) / thickness_mm(run)
    are_known = settings.model == "growing" and relative <= COARSEST
    for stop in stops:
        if stop <= moment.time and journal.rows:
            continue
        began = time.perf_counter()
        inverted = stop > moment.time and advance_to(run, moment, stop)
        journal.seconds += time.perf_counter() - began
        distorted = distortion(run, moment)
        measurements = measured(run, moment, distorted)
        if are_known:
            first = journal.rows[0]["gyrification_index"] if journal.rows else measurements.gyrification_index
            measurements = _with_errors(measurements, first, relative)
        last = inverted or stop == run.end or measurements.gyrification_index < _LEAST_INDEX
        if last or _has_frame(measurements.gestational_age, settings, frames_at):
            asked = _is_one_of(measurements.gestational_age, settings.surfaces)
            felt = mechanics(run, moment) if asked and not inverted else None
            journal.add_frame(run, moment, measurements.gestational_age, distorted, felt)
        part = (moment.time - run.start) / (run.end - run.start)
        journal.add_row(measurements, last=last)
        moment.work.min_j[0] = np.inf
        if progress:
            progress(measurements, part, journal.seconds)
        if last:
            break
        journal.save(run, moment)
    return moment, journal.rows


def _with_errors(measurements: Measurements, index_at_start: float, relative: float) -> Measurements:
    """The same with the errors that are due to the cells; `relative` is their size over the thickness."""
    gain, width = max(measurements.gyrification_index - index_at_start, 0.0), measurements.fold_spacing_mm
    return replace(
        measurements,
        gyrification_index_error=_INDEX_ERROR * relative**2 * gain,
        fold_spacing_error_mm=None if width is None else _WIDTH_ERROR * relative**2 * width,
    )


def _stops(run: Run, settings: Settings, frames_at: Sequence[float]) -> list[float]:
    """Times at which the body is measured: first and last, others evenly spaced in age, and those of further frames."""
    count = int(np.ceil((settings.end - settings.gestational_age) / settings.record_interval - 1e-6))
    ages = settings.gestational_age + settings.record_interval * np.arange(1, count)
    further = [age for age in frames_at if settings.gestational_age < age < settings.end]
    further = [age for age in further if np.abs(ages - age).min(initial=np.inf) > SAME_AGE]
    return [run.start, *(time_of(age) for age in sorted([*ages, *further])), run.end]


def _has_frame(age: float, settings: Settings, frames_at: Sequence[float]) -> bool:
    """Whether the body has a frame at an age at which it is measured."""
    every = max(round(settings.frame_interval / settings.record_interval), 1) * settings.record_interval
    steps = (age - settings.gestational_age) / every
    return abs(steps - round(steps)) * every < SAME_AGE or _is_one_of(age, frames_at)


def _is_one_of(age: float, ages: Sequence[float]) -> bool:
    return any(abs(age - one) < SAME_AGE for one in ages)


class Journal:
    """The results that a run has written so far."""

    def __init__(self, folder: Path, fingerprint: str) -> None:
        self.folder, self.fingerprint = folder, fingerprint
        self.checkpoint = folder / CHECKPOINT
        self.rows: list[dict[str, Any]] = []
        #: file names relative to the folder, and gestational ages
        self.frames: list[tuple[str, float]] = []
        self.seconds = 0.0
        self.saved = time.monotonic()
        self.written = -np.inf

    def resumed(self, run: Run) -> Moment:
        """The moment of the last checkpoint, or the beginning; then files of another run in the folder are deleted.

        Of folded surfaces and their maps those that commands of cortet wrote; jobs of the workflow declare theirs. A
        surface without any map is of another command.
        """
        moment = beginning(run)
        delete_abandoned(self.folder, *FILES)
        delete_abandoned(self.folder / "frames", _FRAMES)
        last = load_checkpoint(self.checkpoint, self.fingerprint)
        if last is None:
            frames = sorted(self.folder.glob(f"frames/{_FRAMES}"))
            weeks = ([path for path in files if is_ours(path)] for files in weeks_in(self.folder))
            maps = [path for files in weeks if len(files) > 1 for path in files]
            delete(*frames, *maps, *(self.folder / name for name in (VERDICT, SERIES, CHECKPOINT)))
            if frames or maps:
                logger.warning(
                    "%s: an earlier fold is replaced (frames: %d, surfaces and maps: %d)",
                    *(self.folder, len(frames), len(maps)),
                )
            return moment
        logger.info("resumed at step %d, time %.3f", last["step"], last["time"])
        self.rows, self.seconds = last["rows"], last["seconds"]
        self.frames = [(name, age) for name, age in last["frames"]]
        at_listing = last["x"].copy()
        at_listing[moment.contact.nodes] = last["listed"]
        moment.work.counts[:], moment.work.energy[:] = last["counts"], last["energy"]
        moment.state = Motion(last["x"], last["v"])
        moment.mode = last.get("mode")
        for name in ("step", "time", "dt", "growth_work"):
            setattr(moment, name, last[name])
        if "gradients" in last:
            moment.base.gradients[:] = last["gradients"]
            renew(moment.work.patches, moment.base)
        moment.contact = listed_at(moment.contact, at_listing, last["envelope"])
        return moment

    def save(self, run: Run, moment: Moment) -> None:
        """Write a checkpoint, unless the last one is recent."""
        if time.monotonic() - self.saved < _CHECKPOINT_SECONDS:
            return
        arrays: dict[str, Any] = {**moment.state._asdict(), "listed": moment.contact.listed}
        arrays |= {"counts": moment.work.counts, "energy": moment.work.energy}
        if moment.mode is not None:
            arrays["mode"] = moment.mode
        if moment.base is not run.body:  # of elements that have yielded
            arrays["gradients"] = moment.base.gradients
        rest = {name: getattr(moment, name) for name in ("step", "time", "dt", "growth_work")}
        rest |= {"envelope": moment.contact.envelope, "fingerprint": self.fingerprint}
        rest |= {name: getattr(self, name) for name in ("seconds", "rows", "frames")}
        save_checkpoint(self.checkpoint, rest, arrays)
        self.saved = time.monotonic()

    def add_row(self, measurements: Measurements, *, last: bool) -> None:
        """Append to the table, whose file follows about once a second."""
        self.rows.append(asdict(measurements))
        if not last and time.monotonic() - self.written < _TABLE_SECONDS:
            return
        self.written = time.monotonic()
        write_table(COLUMNS, self.rows, self.folder / TABLE, self.folder / SIDECAR)

    def add_frame(
        self, run: Run, moment: Moment, age: float, distorted: FloatArray, felt: Mechanics | None = None
    ) -> None:
        """Write a frame, in the numbering of the user's mesh, for weeks of surfaces with what elements feel."""
        name = f"frames/frame_{len(self.frames):04d}.vtu"
        by_node, by_cell = np.argsort(run.node), np.argsort(run.cell)
        points, cells = millimetres(run, moment)[by_node], run.node[run.mesh.cells[by_cell]].astype(np.int32)
        of_nodes: dict[str, NDArray[Any]] = {"displacement": points - run.mesh.points[by_node]}
        of_nodes[MEDIAL_WALL] = run.body.held[by_node].astype(np.uint8)
        j = (moment.work.current / moment.work.grown)[by_cell]
        more = {}
        if felt:
            thickness = run.body.thickness * run.scale.length
            more = {"stress": felt.stress, "stretch": felt.stretch, THICKNESS_FIELD: thickness}
        of_cells = {"J": j, "distortion": distorted[by_cell], "growth": moment.work.share[by_cell]} | {
            key: more[key][by_cell] for key in more
        }
        vtu.write(TetMesh(points, cells, of_nodes, of_cells), self.folder / name)
        self.frames.append((name, age))
        write_series(self.frames, self.folder / SERIES)


def _strained(rows: list[dict[str, Any]]) -> list[str]:
    """Doubts about a fold from the week on in which too many of its tetrahedra are distorted or compressed."""
    doubts = []
    for column, most, what in _STRAINED:
        if beyond := [row for row in rows if row[column] > most]:
            since, worst = beyond[0]["gestational_age"], max(row[column] for row in beyond)
            doubts.append(
                f"from {since:.1f} weeks on more than {100 * most:g} % of the tetrahedra {what} (up to {worst:.1%}), "
                "so the later shape depends on the cells; smaller cells are strained less"
            )
    return doubts


def _verdict(
    run: Run, moment: Moment, rows: list[dict[str, Any]], warnings: Sequence[str], settings: Settings
) -> Verdict:
    age, index = rows[-1]["gestational_age"], rows[-1]["gyrification_index"]
    outcome: Literal["folded", "inverted", "implausible"] = "folded"
    element, place = None, None
    if rows[-1]["inverted"]:
        j = moment.work.current / moment.work.grown
        worst = int(np.argmin(np.where(np.isnan(j), -np.inf, j)))
        element = int(run.cell[worst])
        x, y, z = millimetres(run, moment)[run.mesh.cells[worst]].mean(axis=0).tolist()
        place, outcome = (x, y, z), "inverted"
        reason = (
            f"tetrahedron {element} at {place_mm(place)} inverted (J = {j[worst]:.3g}) "
            f"in step {moment.step}, at {age:.2f} weeks"
        )
    elif index < _LEAST_INDEX:
        outcome = "implausible"
        reason = f"gyrification index {index:.3f} at {age:.2f} weeks: no brain has less surface than its convex hull"
    else:
        reason = f"folded from {age_of(run.start):.2f} to {age:.2f} weeks; no element inverted in {moment.step} steps"
    return Verdict(
        outcome=outcome,
        reason=reason,
        warnings=tuple(warnings),
        tets=len(run.cell),
        steps=moment.step,
        gestational_age=round(age, 6),
        thickness_mm=thickness_mm(run),
        min_j=min(row["min_j"] for row in rows),
        distortion_max=None if outcome == "inverted" else max(row["distortion_max"] for row in rows),
        distorted_share=max(row["distorted_share"] for row in rows),
        compressed_share=max(row["compressed_share"] for row in rows),
        gyrification_index_last=index,
        cell_size_mm=cell_size_mm(run),
        gyrification_index_error=rows[-1]["gyrification_index_error"],
        fold_spacing_error_mm=rows[-1]["fold_spacing_error_mm"],
        settings=settings.values(),
        element=element,
        place_mm=place,
    )
