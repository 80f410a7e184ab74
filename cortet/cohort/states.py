"""What became of a run: which of its meshes are there as planned, which failed, and why files are missing.

Reports, certificates and `failure.json`, which a job that fails or is killed leaves beside its log, say what they were
made from (`Jobs.made_from`). A mesh is finished if its certificate was made from what its plan says; a failure of a job
that was made from something else does not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cortet.cohort.jobs import Jobs
from cortet.cohort.layout import Wildcards, beside
from cortet.cohort.plan import Mesh, Plan
from cortet.cohort.sheet import Case
from cortet.cohort.status import STOPPED, failure_reason, in_words
from cortet.cohort.user_files import content
from cortet.errors import CortetError
from cortet.formats.certificates import certificate_of
from cortet.formats.ownership import changed_of, files_of, json_of
from cortet.stages import STAGES

#: rules after the certificate: the mesh is measured even if they fail
AFTER_CERTIFICATE = (
    *("volumes", "export", "ten_nodes", "case_page", "case_maps"),
    *("fold", "fold_figures", "folded_surface"),
)
#: rules on a case, in the order in which a case goes through them
ORDER = (*("phantom", "phantom_inner", "fields"), *STAGES, *AFTER_CERTIFICATE)
#: folder of a case for its outdated results (`cohort.outdated`)
OUTDATED = "outdated"
#: end of the name of a certificate
CERTIFICATE = "Solver_certificate.json"
#: what to do about a job that left no word
_AFTER_A_KILL = "give the job more memory or time, and run again"
#: why a file is missing, or a mesh unfinished
_ENDED = "the run ended before this case was done"
_OTHER_SIZE = "its mesh has a different cell size or mesher than requested"
_OTHER = "its mesh was replaced, or made with other settings, from another surface, or by another version of cortet"
_DAMAGED = "its certificate is damaged, edited, or from another version of cortet"


@dataclass(frozen=True)
class Failure:
    """A job that failed or was killed."""

    rule: str
    wildcards: Wildcards
    #: `Jobs.made_from`, when it was planned
    made_from: str
    reason: str
    #: what to do about it; empty if only its log can tell
    remedy: str
    log: Path

    def is_about(self, **wildcards: object) -> bool:
        """Whether the job worked for a mesh, as far as its wildcards say: one on a surface works for all its meshes."""
        return all(self.wildcards.get(key, str(value)) == str(value) for key, value in wildcards.items())


@dataclass(frozen=True)
class States:
    """A plan, with what became of it. While a run is planned, nothing has failed and no file is missing."""

    plan: Plan
    #: mesh that failed or is unfinished -> `stage`, `state`, `reason`, `remedy` and `log`
    failures: Mapping[Mesh, Mapping[str, Any]] = field(default_factory=dict)
    #: jobs that failed, in the order of the line; None while a run is planned
    failed: Sequence[Failure] | None = None

    def is_measured(self, mesh: Mesh) -> bool:
        """Whether a mesh has its certificate: it did not fail, or only after the certificate."""
        return mesh not in self.failures or self.failures[mesh]["stage"] in AFTER_CERTIFICATE

    def measured(self) -> list[Mesh]:
        """The meshes that have their certificate."""
        return [*filter(self.is_measured, self.plan.meshes())]

    def unmeasured(self) -> dict[str, str]:
        """Why cases have no certificate, by their names, without what to do about it."""
        return {mesh[0]: failure["reason"] for mesh, failure in self.failures.items() if not self.is_measured(mesh)}

    def measured_certificates(self) -> list[str]:
        """Certificates of all meshes that have one."""
        return [self.plan.file(self.plan.layout.certificate, mesh) for mesh in self.measured()]

    def exported_files(self) -> list[str]:
        """Last meshes, and files for solvers with their sidecars, of the meshes that did not fail."""
        meshes = [mesh for mesh in self.plan.meshes() if mesh not in self.failures]
        return [path for mesh in meshes for path in self.plan.final_files(mesh)]

    def tissue_tables(self) -> dict[Mesh, str]:
        """Tables of the tissue in the meshes of cases with volumes."""
        meshes = [mesh for mesh in self.measured() if self.plan.cases[mesh[0]].volumes]
        made = [mesh for mesh in meshes if self.failures.get(mesh, {}).get("stage") != "volumes"]
        return {mesh: self.plan.file(self.plan.layout.mesh("Solver", "volumes.tsv"), mesh) for mesh in made}

    def maps(self, hemi: str) -> dict[str, str]:
        """Maps of the cases of a hemisphere, by case: those that a run makes; afterwards, those that exist."""
        asked = {mesh: path for mesh, path in self.plan.maps(hemi).items() if self.is_measured(mesh)}
        return {mesh[0]: path for mesh, path in asked.items() if self.failed is None or Path(path).exists()}

    def listed_on_page(self) -> list[dict[str, Any]]:
        """The meshes that the page of all cases lists."""
        plan = self.plan
        pages = plan.each_case(plan.layout.case_page)
        return [plan.described(mesh) | {"page": beside(page, plan.layout.cohort_page)} for mesh, page in pages.items()]

    def rows(self) -> list[dict[str, Any]]:
        """Rows of the table of states, one per mesh and per excluded row of the sheet, without columns that are empty.

        A mesh that is not certified is `uncertified`, even if a later step failed, too.
        """
        whys = {case.name: case.exclude_reason or "no reason given" for case in self.plan.sheet if not case.include}
        excluded = [{"case": name, "state": "excluded", "reason": why} for name, why in whys.items()]
        return [*map(self._row, self.plan.meshes()), *excluded]

    def _row(self, mesh: Mesh) -> dict[str, Any]:
        name, res, mesher = mesh
        row: dict[str, Any] = {"case": name, "cell_size_mm": res / 1000, "mesher": mesher}
        failure = self.failures.get(mesh, {})
        row |= {column: failure[column] for column in ("stage", "state", "log") if column in failure}
        if failure:
            row["reason"] = in_words(failure)
        if not self.is_measured(mesh):
            return row
        content = certificate_of(self.plan.file(self.plan.layout.certificate, mesh))
        row["verdict_in_words"] = content["verdict"]
        if not content["certified"]:
            row |= {"stage": "certify", "state": "uncertified", "reason": "; ".join(content["reasons"])}
        elif not failure:
            row |= {"stage": "certify", "state": "certified", "reason": "; ".join(content["remarks"])}
        return row

    def why_missing(self, path: str, rule: str, job: Mapping[str, object]) -> str | None:
        """Why a file cannot be used: it was not made, or an earlier stage of its mesh has failed since; None if it can.

        Parameters
        ----------
        rule : that makes the file
        job : wildcards of that job
        """
        if self.failed is None:
            return None
        exists = Path(path).exists()
        for cause in self.failed:
            before = ORDER.index(cause.rule) < ORDER.index(rule) and cause.rule not in AFTER_CERTIFICATE
            if cause.is_about(**job) and (before or not exists):
                return f"{cause.rule}: {cause.reason}"
        return None if exists else _ENDED


def read_states(plan: Plan, *, ended: bool = True) -> States:
    """What became of a plan, as its output folder says.

    Parameters
    ----------
    ended : whether no job is running now; if one may be, only those count that said why they failed
    """
    jobs, output = Jobs(plan), Path(plan.layout.output)
    failed = [one for one in _failures(output, ended=ended) if _is_planned(jobs, one)]
    known: dict[Mesh, dict[str, Any]] = {}
    for mesh, certificate in plan.certificates().items():
        if found := _state(jobs, mesh, certificate, failed):
            # the surface of a case that failed is missing, else its results would be outdated
            kept = found["state"] == "failed" and found["stage"] not in AFTER_CERTIFICATE and certificate.exists()
            folder = certificate.parent if kept else _earlier_results(plan, plan.cases[mesh[0]])
            known[mesh] = found | ({"earlier": _inside(plan, folder)} if folder else {})
    return States(plan, known, failed)


def _state(jobs: Jobs, mesh: Mesh, certificate: Path, failed: Sequence[Failure]) -> dict[str, Any] | None:
    """How a mesh failed, or that it is unfinished: `stage`, `state`, `reason`, `remedy` and `log` if it failed."""
    plan = jobs.plan
    job, rule = plan.job(mesh), first_other_rule(jobs, mesh)
    for one in failed:
        if rule and one.rule in AFTER_CERTIFICATE:
            continue  # it is the mesh or its certificate that has to be made again
        if one.is_about(**job):
            words = {"reason": one.reason, "remedy": one.remedy}
            return {"stage": one.rule, "state": "failed", **words, "log": _inside(plan, one.log)}
    reason = _ENDED
    if rule and certificate.exists():
        why = _OTHER if certificate_of(certificate) else _DAMAGED
        reason = f"{why}; `snakemake --forcerun {rule}` remakes it"
    elif rule and certificates_of(plan, plan.cases[mesh[0]]):
        reason = _OTHER_SIZE
    elif rule:
        pass
    elif missing := [maker for path, maker in plan.final_files(mesh).items() if not Path(path).exists()]:
        rule = missing[0]
    elif edited := edited_exports(plan, mesh):
        rule, reason = "export", edited[0]
    elif other := _other_field(jobs, mesh):
        rule, reason = "fields", f"the file of the field {other} has changed; `snakemake --forcerun fields` carries it"
    else:
        return None
    return {"stage": rule, "state": "unfinished", "reason": reason}


def first_other_rule(jobs: Jobs, mesh: Mesh) -> str | None:
    """The first rule that made a mesh from something else than planned; None if its certificate holds.

    A file of the user that cannot be read counts as the one that the mesh was made from.
    """

    def is_planned(rule: str, job: Wildcards, record: Mapping[str, Any]) -> bool:
        return record.get("made_from") == jobs.made_from(rule, job, record.get("input_sha256", {}))

    job, certificate = jobs.plan.job(mesh), Path(jobs.plan.file(jobs.plan.layout.certificate, mesh))
    if is_planned("solver_ready", job, certificate_of(certificate)):
        last = Path(jobs.plan.file(jobs.plan.layout.mesh(STAGES["solver_ready"].label), mesh))
        return "solver_ready" if _is_replaced(last, certificate) else None
    others = (one.rule for one in jobs.reports(job) if not is_planned(one.rule, one.job, json_of(one.path)))
    return next(others, "solver_ready")


def _is_replaced(mesh: Path, certificate: Path) -> bool:
    """Whether a mesh is not the one that a certificate is about; only one that is newer is read."""
    if not mesh.is_file() or mesh.stat().st_mtime_ns <= certificate.stat().st_mtime_ns:
        return False
    from cortet.formats import vtu  # loads what most runs do without
    from cortet.formats.hashing import mesh_sha256

    try:
        return mesh_sha256(vtu.read(mesh)) != certificate_of(certificate)["mesh_sha256"]
    except CortetError:
        return True


def has_other_input(jobs: Jobs, job: Wildcards, certificate: Path) -> bool:
    """Whether a mesh is known to be made from other files of the user than those that are there."""
    report = certificate.name.replace(CERTIFICATE, f"{STAGES['solver_ready'].label}_tetmesh.json")
    record = json_of(certificate.with_name(report))
    made_from, present = record.get("input_sha256", {}), jobs.sources.input_sha256(job)
    return bool(made_from) and any(now and made_from.get(name) != now for name, now in present.items())


def edited_exports(plan: Plan, mesh: Mesh) -> list[str]:
    """What was changed or deleted of the files for solvers of a mesh since cortet wrote them, in sentences."""
    told = []
    for file in (path for path in plan.exports(mesh) if path.is_file()):
        record = Path(f"{file}.json")
        gone = [name for name in files_of(record) if not (record.parent / name).is_file()]
        told += [f"{record.parent / name} is missing: delete {file} and cortet remakes both" for name in gone]
        changed = [] if gone else changed_of(record)
        told += [f"{path} was changed after cortet wrote it: delete it and cortet remakes it" for path in changed]
    return told


def _other_field(jobs: Jobs, mesh: Mesh) -> str | None:
    """A field whose file has another content than that which a file for solvers holds; None if there is none."""
    present = content(jobs.sources.field_paths(jobs.plan.job(mesh)))
    for file in jobs.plan.exports(mesh):
        held = json_of(file.with_name(f"{file.name}.json")).get("fields") or {}
        for name, digest in present.items():
            if digest and held.get(name, {}).get("source_sha256", digest) != digest:
                return name
    return None


def certificates_of(plan: Plan, case: Case) -> list[Path]:
    """The certificates of a case that are there, of any cell size, mesher and setting."""
    return sorted((Path(plan.layout.output) / case.folder).glob(f"mesh/{case.name}_res-*{CERTIFICATE}"))


def made_otherwise(plan: Plan) -> dict[Mesh, str]:
    """Meshes that are there, but were made otherwise than planned -> rule from which on."""
    jobs = Jobs(plan)
    there = [mesh for mesh, certificate in plan.certificates().items() if certificate.exists()]
    return {mesh: rule for mesh in there if (rule := first_other_rule(jobs, mesh))}


def _failures(output: Path, *, ended: bool) -> list[Failure]:
    """Jobs below an output folder that did not succeed when they last ran, in the order of the line."""
    found = []
    for path in sorted((output / "logs").rglob("*.failure.json")):
        told, log = json_of(path), path.with_name(path.name.replace(".failure.json", ".log"))
        has_word = "reason" in told
        if told.get("stage") not in ORDER or not (ended or has_word):
            continue
        reason = told["reason"] if has_word else failure_reason(log)
        remedy = (told["remedy"] or "") if has_word else _AFTER_A_KILL
        if reason != STOPPED:
            made_from = str(told.get("made_from"))
            found.append(Failure(told["stage"], told["wildcards"], made_from, reason, remedy, log))
    return sorted(found, key=lambda failure: ORDER.index(failure.rule))


def _is_planned(jobs: Jobs, failure: Failure) -> bool:
    """Whether a plan has the job that failed, as it was then."""
    case, setting = failure.wildcards.get("case"), failure.wildcards.get("setting", "")
    known = case in jobs.plan.cases and setting in jobs.plan.settings
    return known and jobs.made_from(failure.rule, failure.wildcards) == failure.made_from


def _earlier_results(plan: Plan, case: Case) -> Path | None:
    """The folder with outdated results of a case; None if it has none."""
    folder = Path(plan.layout.output) / case.folder / OUTDATED
    return folder if any(folder.glob(f"*/{case.name}_*")) else None


def _inside(plan: Plan, path: Path) -> str:
    """The name of a file or folder from the output folder, from wherever the run was started."""
    return path.relative_to(plan.layout.output).as_posix()
