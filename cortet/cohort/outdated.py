"""Results that no longer answer the sheet move aside, so that nothing under a final name is out of date.

A mesh and its certificate are outdated if the user's surface has changed since they were made, if their case has failed
since, or if the sheet excludes or no longer names the case. They move to a folder `outdated` of the case, and are never
deleted.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from cortet.cohort.jobs import Job, Mesh, without_locations
from cortet.cohort.layout import EXPORTED
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import Case
from cortet.formats.ownership import files_of, json_of

#: folder of a case for its outdated results, in numbered folders
FOLDER = "outdated"
#: end of the name of a certificate
_CERTIFICATE = "Solver_certificate.json"


def set_aside(plan: Plan, *, dropped: bool = False) -> list[str]:
    """Move outdated results to the folder `outdated` of their case.

    A case whose surface cannot be found keeps its results: its disk may be missing, and they are still those of the
    surface that the sheet names.

    Parameters
    ----------
    plan : with its failures, if a run has ended
    dropped : whether cases that the sheet does not name were in it before, and count as excluded

    Returns
    -------
    What moved, in sentences.
    """
    told = []

    def move(case: Case, why: str, entries: Iterable[Path]) -> None:
        if moved := _move(Path(plan.layout.output) / case.folder, entries):
            told.append(f"{case.name}: {why}, and its earlier results were moved to {moved}")

    for case in plan.cases.values():
        move(case, "its surface has changed", _of_other_surfaces(plan, case))
    for mesh in plan.each_case(plan.layout.certificate):
        case, failure, job = plan.cases[mesh[0]], plan.failures.get(mesh, {}), plan.job(mesh)
        if failure.get("state") == "failed" and None not in plan.input_sha256(job).values():
            entries = _results(plan, mesh) if not plan.is_measured(mesh) else []
            entries = _exported(plan, mesh) if failure["stage"] == "volumes" else entries
            move(case, f"{failure['stage']} failed", entries)
        move(case, "it has another mesh now", _of_an_earlier_mesh(plan, mesh))
    excluded = {case.name for case in plan.sheet if not case.include}
    for name, folder in _without_row(plan):
        if dropped or name in excluded:
            entries = (path for begin in ("res-", "desc-") for path in folder.glob(f"*/{name}_{begin}*"))
            moved = _move(folder, (path for path in entries if path.parent.name != "anat"))
            told.append(f"{name}: the sheet does not include it, and its results were moved to {moved}")
    return told


def earlier_results(plan: Plan, case: Case) -> dict[str, str]:
    """The entry `earlier` of a state: the folder with outdated results of a case; empty if it has none."""
    folder = Path(plan.layout.output) / case.folder / FOLDER
    return {"earlier": str(folder)} if any(folder.glob(f"*/*/{case.name}_*")) else {}


def first_other_stage(plan: Plan, mesh: Mesh) -> str | None:
    """The first stage, or `certify`, that made a mesh otherwise than planned; None if its certificate is current.

    Its certificate records the parameters and versions of all stages; names of files do not count.
    """
    job = plan.job(mesh)
    wanted = json.loads(json.dumps(plan.recorded_settings(job), default=str))
    certificate = Path(plan.layout.certificate.format(**job))
    made = json_of(certificate).get("parameters")
    if made is None or not can_be_read(certificate):
        reports = plan.reports(job)
        return next((stage for stage in wanted if stage in reports and not Path(reports[stage]).exists()), "certify")
    if _has_changed(plan, job, certificate):
        return next(iter(wanted))
    return next((stage for stage in wanted if wanted[stage] != without_locations(made.get(stage, {}))), None)


def can_be_read(certificate: Path) -> bool:
    """Whether a certificate is whole, and not of a version before its content had a schema."""
    return "schema" in json_of(certificate)


def _has_changed(plan: Plan, job: Job, certificate: Path) -> bool:
    """Whether a mesh was made from other files of the user than the present ones, as far as those can be read."""
    record = json_of(certificate.with_name(certificate.name.replace(_CERTIFICATE, "Solver_tetmesh.json")))
    made_from, present = record.get("input_sha256"), plan.input_sha256(job)
    if not isinstance(made_from, dict):
        return False
    return made_from.keys() != present.keys() or any(
        now is not None and made_from[name] != now for name, now in present.items()
    )


def _of_other_surfaces(plan: Plan, case: Case) -> Iterator[Path]:
    """The results of a case, of any cell size, mesher and setting, that were made from other files of the user."""
    folder = Path(plan.layout.output) / case.folder
    job = {"folder": case.folder, "case": case.name, "res": ""}
    for certificate in folder.glob(f"mesh/{case.name}_res-*{_CERTIFICATE}"):
        if _has_changed(plan, job, certificate):
            yield from _made_with(folder, certificate)


def _made_with(folder: Path, certificate: Path) -> Iterator[Path]:
    """The mesh of a certificate, and what was made of it: exports, page, folds."""
    stem = certificate.name.removesuffix(_CERTIFICATE)
    for label in ("Solver", "Folded"):
        yield from folder.glob(f"*/{stem}{label}*")


def _results(plan: Plan, mesh: Mesh) -> Iterator[Path]:
    """The results of a mesh of the line that has a certificate."""
    certificate = Path(plan.layout.certificate.format(**plan.job(mesh)))
    return _made_with(certificate.parents[1], certificate) if certificate.exists() else iter(())


def _exported(plan: Plan, mesh: Mesh) -> list[Path]:
    """The files of a mesh for solvers that are asked for, and those that belong to them."""
    patterns = plan.layout.solver_files(plan.config.export.formats, plan.config.export.ten_nodes)
    files = [Path(pattern.format(**plan.job(mesh))) for pattern in patterns]
    return [path for file in files for path in _with_companions(file)]


def _of_an_earlier_mesh(plan: Plan, mesh: Mesh) -> list[Path]:
    """Files for solvers that are no longer asked for, older than the certificate."""
    certificate = Path(plan.layout.certificate.format(**plan.job(mesh)))
    asked = plan.config.export.formats
    patterns = [plan.layout.mesh("Solver", suffix) for suffix, name in EXPORTED.items() if name not in asked]
    files = [Path(pattern.format(**plan.job(mesh))) for pattern in patterns]
    return [
        path
        for file in files
        if file.exists() and certificate.exists() and file.stat().st_mtime < certificate.stat().st_mtime
        for path in _with_companions(file)
    ]


def _with_companions(file: Path) -> list[Path]:
    """A file for a solver, its sidecar, and the files that this lists; those that are there."""
    record = file.with_name(f"{file.name}.json")
    names = sorted({file.name, record.name, *files_of(record)})
    return [file.parent / name for name in names if (file.parent / name).is_file()]


def _without_row(plan: Plan) -> list[tuple[str, Path]]:
    """Names and folders of the cases that have a certificate, but no row of the sheet that includes them."""
    output = Path(plan.layout.output)
    certificates = [path for case in ("sub-*", "sub-*/ses-*") for path in output.glob(f"{case}/mesh/*{_CERTIFICATE}")]
    found = {(path.name.partition("_res-")[0], path.parents[1]) for path in certificates}
    return [(name, folder) for name, folder in sorted(found) if name not in plan.cases]


def _move(folder: Path, entries: Iterable[Path]) -> Path | None:
    """Move files and folders of a case to a new numbered folder, certificates last; None if there are none."""
    entries = sorted(entries, key=lambda path: (path.name.endswith(_CERTIFICATE), path))
    if not entries:
        return None
    numbers = [int(path.name) for path in (folder / FOLDER).glob("*") if path.name.isdecimal()]
    target = folder / FOLDER / str(max(numbers, default=0) + 1)
    for path in entries:
        new = target / path.relative_to(folder)
        new.parent.mkdir(parents=True, exist_ok=True)
        path.rename(new)
    return target
