"""Results that no longer answer the sheet move aside, so that nothing under a final name is out of date.

A mesh and its certificate are outdated if the user's surface has changed since they were made, if their case has failed
since, or if the sheet excludes or no longer names the case. They move to a folder `outdated` of the case, and are never
deleted.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cortet.cohort.jobs import Jobs
from cortet.cohort.layout import LABELS_OUT
from cortet.cohort.plan import Mesh, Plan
from cortet.cohort.sheet import Case
from cortet.cohort.states import CERTIFICATE, OUTDATED, States, certificates_of
from cortet.formats import FORMATS
from cortet.formats.certificates import certificate_of
from cortet.formats.ownership import files_of, json_of, mesh_of
from cortet.stages import STAGES

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

    def move(name: str, folder: Path, why: str, entries: Iterable[Path]) -> None:
        if moved := _move(folder, entries):
            told.append(f"{name}: {why}, so cortet moved its earlier results to {moved.relative_to(output)}")

    for name, case in plan.cases.items():
        changed = [one for one in certificates_of(plan, case) if _has_other_input(jobs, case, one)]
        entries = [path for one in changed for path in _made_with(one)]
        move(name, output / case.folder, "its surface has changed", entries)
    for mesh in plan.meshes():
        state, folder = states.state(mesh), output / plan.cases[mesh[0]].folder
        if state.state == "failed" and None not in jobs.sources.input_sha256(plan.job(mesh)).values():
            # the certificate itself may be gone: Snakemake deletes it before S5 runs again
            entries = [] if state.verdict else _made_with(plan.certificate(mesh))
            entries = _with_companions(plan.exports(mesh)) if state.stage == "volumes" else entries
            move(mesh[0], folder, f"{state.stage} failed", entries)
        move(mesh[0], folder, "it now has another mesh or verdict", _of_another_mesh(plan, mesh))
    excluded = {case.name for case in plan.sheet if not case.include}
    for name, folder in _without_row(plan):
        if dropped or name in excluded:
            left = (path for begin in ("res-", "desc-") for path in folder.glob(f"*/{name}_{begin}*"))
            entries = [path for path in left if path.parent.name != "anat"]
            move(name, folder, "the sheet does not include it", entries)
    return told


def _has_other_input(jobs: Jobs, case: Case, certificate: Path) -> bool:
    """Whether a mesh is known to be made from other files of the user than those that are there."""
    report = certificate.name.replace(CERTIFICATE, f"{STAGES['solver_ready'].label}_tetmesh.json")
    made_from = json_of(certificate.with_name(report)).get("input_sha256", {})  # the certificate may be another case's
    present = jobs.sources.input_sha256({"folder": case.folder, "case": case.name, "res": "any"})
    return bool(made_from) and any(now and made_from.get(name) != now for name, now in present.items())


def _of_another_mesh(plan: Plan, mesh: Mesh) -> list[Path]:
    """Files of a mesh for solvers that an earlier run was asked for, if its certificate is of another mesh or verdict.

    An earlier version gave the mesh of the last stage, too, the name of a result.
    """
    of_certificate = certificate_of(plan.certificate(mesh)).get("mesh_sha256")
    if of_certificate is None:
        return []
    found, layout, asked, own_label = [], plan.layout, plan.exports(mesh), plan.label_of_exports(mesh)
    for label in LABELS_OUT:
        for file in (Path(plan.file(one, mesh)) for one in layout.solver_files(FORMATS, FORMATS, label)):
            is_other = mesh_of(file.with_name(f"{file.name}.json")) not in (None, of_certificate)
            if file not in asked and (is_other or label != own_label):
                found += _with_companions([file])
    if Path(plan.file(layout.mesh("Ordered"), mesh)).exists():
        ends = ("tetmesh.vtu", "tetmesh.json", "quality.json")
        found += [path for end in ends if (path := Path(plan.file(layout.mesh("Solver", end), mesh))).exists()]
    return found


def _made_with(certificate: Path) -> list[Path]:
    """The mesh of a certificate, and what was made of it: exports, page, folds; not the page of a failure alone."""
    folder, stem = certificate.parents[1], certificate.name.removesuffix(CERTIFICATE)
    found = [path for label in ("Ordered", "Solver", "Folded") for path in folder.glob(f"*/{stem}{label}*")]
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
    output, results = Path(plan.layout.output), (CERTIFICATE, *_OF_FAILURE)
    patterns = [f"{case}/mesh/*{end}" for case in ("sub-*", "sub-*/ses-*") for end in results]
    found = {(path.name.partition("_res-")[0], path.parents[1]) for one in patterns for path in output.glob(one)}
    return [(name, folder) for name, folder in sorted(found) if name not in plan.cases]


def _move(folder: Path, entries: Iterable[Path]) -> Path | None:
    """Move files and folders of a case to a new numbered folder, certificates last; None if there are none.

    They lose their folder `mesh`, by which people find results.
    """
    entries = sorted({*entries}, key=lambda path: (path.name.endswith(CERTIFICATE), path))
    if not entries:
        return None
    numbers = [int(path.name) for path in (folder / OUTDATED).glob("*") if path.name.isdecimal()]
    target = folder / OUTDATED / str(max(numbers, default=0) + 1)
    target.mkdir(parents=True)
    for path in entries:
        path.rename(target / path.name)
    return target
