"""Results that no longer answer the sheet move aside, so that nothing under a final name is out of date.

A mesh and its certificate are outdated if the user's surface has changed since they were made, if their case has failed
since, or if the sheet excludes or no longer names the case. They move to a folder `outdated` of the case, and are never
deleted.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from cortet.cohort.jobs import Mesh, without_locations
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import Case
from cortet.formats.ownership import files_of, json_of
from cortet.neighbours import neighbours

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
    for mesh in plan.each_case(plan.layout.certificate):
        failure, job = plan.failures.get(mesh, {}), plan.job(mesh)
        folder = Path(plan.layout.output) / plan.cases[mesh[0]].folder
        why, entries = "", iter(list[Path]())
        if _has_changed(plan, mesh):
            why, entries = "its surface has changed", _results(plan, mesh, plan.settings)
        elif failure.get("state") == "failed" and None not in plan.input_sha256(job).values():
            why = f"{failure['stage']} failed"
            if not plan.is_measured(mesh):
                entries = _results(plan, mesh, [""])
            elif failure["stage"] == "volumes":
                entries = _exported(plan, mesh)
        if moved := _move(folder, entries):
            told.append(f"{mesh[0]}: {why}, and its earlier results were moved to {moved}")
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
    wanted = json.loads(json.dumps(plan.recorded_line(job), default=str))
    made = json_of(Path(plan.layout.certificate.format(**job))).get("parameters")
    if made is None:
        reports = plan.reports(job)
        return next((stage for stage in wanted if stage in reports and not Path(reports[stage]).exists()), "certify")
    if _has_changed(plan, mesh):
        return next(iter(wanted))
    return next(
        (stage for stage in wanted if without_locations(wanted[stage]) != without_locations(made.get(stage, {}))), None
    )


def _has_changed(plan: Plan, mesh: Mesh) -> bool:
    """Whether a mesh was made from other files of the user than the present ones, as far as those can be read."""
    job = plan.job(mesh)
    made_from = json_of(Path(plan.layout.mesh("Solver", "tetmesh.json").format(**job))).get("input_sha256")
    if not isinstance(made_from, dict):
        return False
    present = plan.input_sha256(job)
    return made_from.keys() != present.keys() or any(
        now is not None and made_from[name] != now for name, now in present.items()
    )


def _results(plan: Plan, mesh: Mesh, settings: Iterable[str]) -> Iterator[Path]:
    """The mesh at the end of the line in the settings that have a certificate, and what was made of it."""
    case, res, mesher = mesh
    folder = Path(plan.layout.output) / plan.cases[case].folder
    labels = ["Solver", *(neighbour.label for neighbour in neighbours() if neighbour.label)]
    for setting in settings:
        name = f"{case}_res-{res}um_desc-{mesher}{setting}"
        if (folder / f"mesh/{name}{_CERTIFICATE}").exists():
            for label in labels:
                yield from folder.glob(f"*/{name}{label}*")


def _exported(plan: Plan, mesh: Mesh) -> Iterator[Path]:
    """The files of a mesh for solvers, and those that belong to them."""
    patterns = plan.layout.solver_files(plan.config.export.formats, plan.config.export.ten_nodes)
    for path in (Path(pattern.format(**plan.job(mesh))) for pattern in patterns):
        record = path.with_name(f"{path.name}.json")
        names = {path.name, record.name, *files_of(record)}
        yield from (path.parent / name for name in sorted(names) if (path.parent / name).is_file())


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
