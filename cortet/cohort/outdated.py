"""Results that no longer answer the sheet move aside, so that nothing under a final name is out of date.

A mesh and its certificate are outdated if the user's surface has changed since they were made, if their case has failed
since, or if the sheet excludes or no longer names the case. They move to a folder `outdated` of the case, and are never
deleted.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cortet.cohort.jobs import Jobs
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import Case
from cortet.cohort.states import CERTIFICATE, OUTDATED, States, certificates_of, has_other_input
from cortet.formats.ownership import files_of, json_of, mesh_of

#: ends of the names of what a mesh has that failed
_OF_FAILURE = ("Solver_report.html", "Solver_thumbnail.webp")


def set_aside(states: States, *, dropped: bool = False) -> list[str]:
    """Move outdated results to the folder `outdated` of their case.

    A case whose surface cannot be found keeps its results: its disk may be missing, and they are still those of the
    surface that the sheet names.

    Parameters
    ----------
    states : of a run that has ended, or of one that is planned
    dropped : whether cases that the sheet does not name were in it before, and count as excluded

    Returns
    -------
    What moved, in sentences that name folders of the output folder.
    """
    plan = states.plan
    jobs, told, output = Jobs(plan), list[str](), Path(plan.layout.output)

    def move(case: Case, why: str, entries: Iterable[Path]) -> None:
        if moved := _move(output / case.folder, entries):
            told.append(f"{case.name}: {why}, so cortet moved its earlier results to {moved.relative_to(output)}")

    for case in plan.cases.values():
        job = {"folder": case.folder, "case": case.name, "res": "any"}
        changed = [one for one in certificates_of(plan, case) if has_other_input(jobs, job, one)]
        move(case, "its surface has changed", [path for one in changed for path in _made_with(one)])
    for mesh, certificate in plan.certificates().items():
        case, failure = plan.cases[mesh[0]], states.failures.get(mesh, {})
        if failure.get("state") == "failed" and None not in jobs.sources.input_sha256(plan.job(mesh)).values():
            # the certificate itself may be gone: Snakemake deletes it before S5 runs again
            entries = [] if states.is_measured(mesh) else _made_with(certificate)
            entries = _with_companions(plan.exports(mesh)) if failure["stage"] == "volumes" else entries
            move(case, f"{failure['stage']} failed", entries)
        others, label = plan.other_exports(mesh), plan.label_of_exports(mesh)
        of_another = [path for path in others if _is_of_another_mesh(path, certificate)]
        move(case, "it now has another mesh", _with_companions(of_another))
        move(case, "it now has another verdict", _with_companions(path for path in others if label not in path.name))
        move(case, "the last stage names its mesh Ordered_tetmesh.vtu now", _named_as_results(certificate))
    excluded = {case.name for case in plan.sheet if not case.include}
    for name, folder in _without_row(plan):
        if dropped or name in excluded:
            left = (path for begin in ("res-", "desc-") for path in folder.glob(f"*/{name}_{begin}*"))
            if moved := _move(folder, (path for path in left if path.parent.name != "anat")):
                place = moved.relative_to(output)
                told.append(f"{name}: the sheet does not include it, so cortet moved its results to {place}")
    return told


def _is_of_another_mesh(file: Path, certificate: Path) -> bool:
    """Whether a file for solvers has, by its sidecar, another mesh than a certificate; false if either is missing."""
    of_file = mesh_of(file.with_name(f"{file.name}.json"))
    return of_file is not None and of_file != json_of(certificate).get("mesh_sha256", of_file)


def _made_with(certificate: Path) -> list[Path]:
    """The mesh of a certificate, and what was made of it: exports, page, folds; not the page of a failure alone."""
    folder, stem = certificate.parents[1], certificate.name.removesuffix(CERTIFICATE)
    found = [path for label in ("Ordered", "Solver", "Folded") for path in folder.glob(f"*/{stem}{label}*")]
    return [] if all(path.name.endswith(_OF_FAILURE) for path in found) else found


def _named_as_results(certificate: Path) -> list[Path]:
    """Files of the last stage by an earlier version, which gave each mesh the name of a result, if it has run again."""
    ends = ("tetmesh.vtu", "tetmesh.json", "quality.json")
    stem = certificate.name.removesuffix(CERTIFICATE)
    if not certificate.with_name(f"{stem}Ordered_tetmesh.vtu").exists():
        return []
    return [path for end in ends if (path := certificate.with_name(f"{stem}Solver_{end}")).exists()]


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
    output, results = Path(plan.layout.output), (CERTIFICATE, *_OF_FAILURE)
    patterns = [f"{case}/mesh/*{end}" for case in ("sub-*", "sub-*/ses-*") for end in results]
    found = {(path.name.partition("_res-")[0], path.parents[1]) for one in patterns for path in output.glob(one)}
    return [(name, folder) for name, folder in sorted(found) if name not in plan.cases]


def _move(folder: Path, entries: Iterable[Path]) -> Path | None:
    """Move files and folders of a case to a new numbered folder, certificates last; None if there are none.

    They lose their folder `mesh`, by which people find results.
    """
    entries = sorted(entries, key=lambda path: (path.name.endswith(CERTIFICATE), path))
    if not entries:
        return None
    numbers = [int(path.name) for path in (folder / OUTDATED).glob("*") if path.name.isdecimal()]
    target = folder / OUTDATED / str(max(numbers, default=0) + 1)
    target.mkdir(parents=True)
    for path in entries:
        path.rename(target / path.name)
    return target
