"""Results that no longer answer the sheet move aside, so that nothing under a final name is out of date.

A mesh and its certificate are outdated if the user's surface has changed since they were made, if their case has failed
since, or if the sheet excludes or no longer names the case. They move to a folder `outdated` of the case, and are never
deleted.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from cortet.cohort.jobs import Job, Mesh
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import Case
from cortet.cohort.status import certificate_of
from cortet.formats.ownership import files_of, json_of

#: folder of a case for its outdated results, in numbered folders
FOLDER = "outdated"
#: end of the name of a certificate
_CERTIFICATE = "Solver_certificate.json"
#: ends of the names of what a mesh has that failed
_OF_FAILURE = ("Solver_report.html", "Solver_thumbnail.webp")


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
    What moved, in sentences that name folders of the output folder.
    """
    told, output = [], Path(plan.layout.output)

    def move(case: Case, why: str, entries: Iterable[Path]) -> None:
        if moved := _move(output / case.folder, entries):
            told.append(f"{case.name}: {why}, so cortet moved its earlier results to {moved.relative_to(output)}")

    for case in plan.cases.values():
        job = {"folder": case.folder, "case": case.name, "res": "any"}
        changed = [one for one in certificates_of(plan, case) if _has_changed(plan, job, one)]
        move(case, "its surface has changed", [path for one in changed for path in _made_with(one)])
    for mesh, certificate in plan.certificates().items():
        case, failure = plan.cases[mesh[0]], plan.failures.get(mesh, {})
        if failure.get("state") == "failed" and None not in plan.input_sha256(plan.job(mesh)).values():
            # the certificate itself may be gone: Snakemake deletes it before S5 runs again
            entries = [] if plan.is_measured(mesh) else _made_with(certificate)
            entries = _with_companions(plan.exports(mesh)) if failure["stage"] == "volumes" else entries
            move(case, f"{failure['stage']} failed", entries)
        others = [path for path in plan.other_exports(mesh) if _is_older(path, certificate)]
        move(case, "it now has another mesh", _with_companions(others))
    excluded = {case.name for case in plan.sheet if not case.include}
    for name, folder in _without_row(plan):
        if dropped or name in excluded:
            left = (path for begin in ("res-", "desc-") for path in folder.glob(f"*/{name}_{begin}*"))
            if moved := _move(folder, (path for path in left if path.parent.name != "anat")):
                place = moved.relative_to(output)
                told.append(f"{name}: the sheet does not include it, so cortet moved its results to {place}")
    return told


def earlier_results(plan: Plan, case: Case) -> Path | None:
    """The folder with outdated results of a case; None if it has none."""
    folder = Path(plan.layout.output) / case.folder / FOLDER
    return folder if any(folder.glob(f"*/{case.name}_*")) else None


def first_other_stage(plan: Plan, mesh: Mesh) -> str | None:
    """The first stage, or `certify`, that made a mesh otherwise than planned; None if its certificate is current.

    Its certificate records what each stage depends on.
    """
    job, certificate = plan.job(mesh), Path(plan.file(plan.layout.certificate, mesh))
    wanted = json.loads(json.dumps(plan.recorded_line(job), default=str))
    made = certificate_of(certificate).get("parameters")
    if made is None:
        reports = plan.reports(job)
        return next((stage for stage in wanted if stage in reports and not Path(reports[stage]).exists()), "certify")
    if _has_changed(plan, job, certificate):
        return next(iter(wanted))
    return next((stage for stage in wanted if wanted[stage] != made.get(stage)), None)


def certificates_of(plan: Plan, case: Case) -> list[Path]:
    """The certificates of a case that are there, of any cell size, mesher and setting."""
    return sorted((Path(plan.layout.output) / case.folder).glob(f"mesh/{case.name}_res-*{_CERTIFICATE}"))


def _has_changed(plan: Plan, job: Job, certificate: Path) -> bool:
    """Whether a mesh was made from other files of the user than the present ones, as far as those can be read."""
    record = json_of(certificate.with_name(certificate.name.replace(_CERTIFICATE, "Solver_tetmesh.json")))
    made_from, present = record.get("input_sha256"), plan.input_sha256(job)
    if not isinstance(made_from, dict):
        return False
    return made_from.keys() != present.keys() or any(
        now is not None and made_from[name] != now for name, now in present.items()
    )


def _is_older(file: Path, certificate: Path) -> bool:
    """Whether both files are there, and the first is older."""
    return file.exists() and certificate.exists() and file.stat().st_mtime < certificate.stat().st_mtime


def _made_with(certificate: Path) -> list[Path]:
    """The mesh of a certificate, and what was made of it: exports, page, folds; not the page of a failure alone."""
    folder, stem = certificate.parents[1], certificate.name.removesuffix(_CERTIFICATE)
    found = [path for label in ("Solver", "Folded") for path in folder.glob(f"*/{stem}{label}*")]
    return [] if all(path.name.endswith(_OF_FAILURE) for path in found) else found


def _with_companions(files: Iterable[Path]) -> list[Path]:
    """Files for solvers, their sidecars, and the files that these list; those that are there."""
    found = []
    for file in files:
        record = file.with_name(f"{file.name}.json")
        names = {file.name, record.name, *files_of(record)}
        found += [path for path in map(file.with_name, names) if path.is_file()]
    return found


def _without_row(plan: Plan) -> list[tuple[str, Path]]:
    """Names and folders of the cases that no row includes, but that have a certificate or the page of a failure."""
    output, results = Path(plan.layout.output), (_CERTIFICATE, *_OF_FAILURE)
    patterns = [f"{case}/mesh/*{end}" for case in ("sub-*", "sub-*/ses-*") for end in results]
    found = {(path.name.partition("_res-")[0], path.parents[1]) for one in patterns for path in output.glob(one)}
    return [(name, folder) for name, folder in sorted(found) if name not in plan.cases]


def _move(folder: Path, entries: Iterable[Path]) -> Path | None:
    """Move files and folders of a case to a new numbered folder, certificates last; None if there are none.

    They lose their folder `mesh`, by which people find results.
    """
    entries = sorted(entries, key=lambda path: (path.name.endswith(_CERTIFICATE), path))
    if not entries:
        return None
    numbers = [int(path.name) for path in (folder / FOLDER).glob("*") if path.name.isdecimal()]
    target = folder / FOLDER / str(max(numbers, default=0) + 1)
    target.mkdir(parents=True)
    for path in entries:
        path.rename(target / path.name)
    return target
