"""What became of a run: which of its meshes are there as planned, which failed, and why files are missing.

Reports, certificates and the record of a failure say what they were made from (`Jobs.made_from`). A mesh is finished if
its certificate was made from what its plan says; a failure of a job that was made from something else does not count.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cortet.cohort.failures import Failure, failures
from cortet.cohort.jobs import Jobs
from cortet.cohort.layout import LABELS, Wildcards
from cortet.cohort.plan import Mesh, Plan
from cortet.cohort.sheet import Case
from cortet.cohort.user_files import content
from cortet.errors import CortetError
from cortet.formats.certificates import certificate_of
from cortet.formats.ownership import changed_of, files_of, json_of
from cortet.formats.tables import Column
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
#: states of a mesh; the worst last
STATES = {
    "certified": "every number of its certificate is within its limit",
    "uncertified": "meshed, but not certified; exported only if the configuration allows it",
    "unfinished": "the run ended before the case was done",
    "failed": "a stage refused its input, or failed",
}
#: columns of `cohort_status.tsv`: a row for each mesh, and for each row that the sheet excludes
COLUMNS = (
    Column("case", "Name of the case; files begin with it", heading="Case"),
    Column("cell_size_mm", "Cell size h", "mm", heading="h (mm)", form="g"),
    Column("mesher", "Mesher of stage S1", heading="Mesher"),
    Column("stage", "The job that failed or has to run again; `certify` for a mesh with its certificate"),
    Column("state", "State of the case", levels={**STATES, "excluded": "the sheet excludes it"}, heading="State"),
    Column("verdict_in_words", "The verdict: how much of the surface repair made, and which limits were relaxed"),
    Column("reason", "Why the case is not certified; for a certified case, remarks"),
    Column("log", "Log of the job that failed, in the output folder"),
)
#: why a file is missing, or a mesh unfinished
_ENDED = "the run ended before this case was done"
_OTHER_SIZE = "its mesh has a different cell size or mesher than requested"
_OTHER = "its mesh was made with other settings, from another surface, or by another version of cortet"
_REPLACED = "its mesh was replaced"
_DAMAGED = "its certificate is damaged, edited, or from another version of cortet"


@dataclass(frozen=True)
class State:
    """What became of a mesh."""

    #: the job that failed or has to run again; `certify` if the certificate and all files after it are there
    stage: str
    #: one of `STATES`; a failure of a job after the certificate comes before the verdict
    state: str
    reason: str = ""
    #: what to do about it, if that is known
    remedy: str = ""
    #: log of the job that failed, and folder with earlier results; in the output folder
    log: str = ""
    earlier: str = ""
    #: whether the earlier results still have their names
    is_kept: bool = False
    #: `certified`, `verdict`, `reasons` and `remarks` of the certificate; empty if that is missing or not as planned
    verdict: Mapping[str, Any] = field(default_factory=dict)

    @property
    def in_words(self) -> str:
        """Reason, remedy, and where earlier results are."""
        remedy = f" ({self.remedy})" if self.remedy else ""
        return f"{self.reason}{remedy}" + (f"; earlier results are in {self.earlier}" if self.earlier else "")

    def cells(self) -> dict[str, Any]:
        """Its cells in the table, where a mesh that is not certified is `uncertified` even if a later job failed."""
        cells = {"stage": self.stage, "state": self.state, "reason": self.in_words, "log": self.log}
        if self.verdict and not self.verdict["certified"]:
            cells |= {"stage": "certify", "state": "uncertified", "reason": "; ".join(self.verdict["reasons"])}
        return cells | {"verdict_in_words": self.verdict.get("verdict")}


#: of every mesh, while a run is planned
PLANNED = State("certify", "certified", verdict={"certified": True})


@dataclass(frozen=True)
class States:
    """A plan, with what became of it. While a run is planned, nothing has failed and no file is missing."""

    plan: Plan
    of: Mapping[Mesh, State] = field(default_factory=dict)
    #: jobs that failed, in the order of the line; None while a run is planned
    failed: Sequence[Failure] | None = None

    def state(self, mesh: Mesh) -> State:
        """What became of a mesh."""
        return self.of.get(mesh, PLANNED)

    def measured(self) -> list[Mesh]:
        """The meshes that have their certificate: they did not fail, or only after it."""
        return [mesh for mesh in self.plan.meshes() if self.state(mesh).verdict]

    def measured_certificates(self) -> list[str]:
        """Certificates of all meshes that have one."""
        return [self.plan.file(self.plan.layout.certificate, mesh) for mesh in self.measured()]

    def exported_files(self) -> list[str]:
        """Last meshes, and files for solvers with their sidecars, of the meshes that did not fail."""
        meshes = [mesh for mesh in self.plan.meshes() if self.state(mesh).stage == "certify"]
        return [path for mesh in meshes for path in self.plan.final_files(mesh)]

    def tissue_tables(self) -> dict[Mesh, str]:
        """Tables of the tissue in the meshes of cases with volumes."""
        meshes = [mesh for mesh in self.measured() if self.plan.cases[mesh[0]].volumes]
        made = [mesh for mesh in meshes if self.state(mesh).stage != "volumes"]
        return {mesh: self.plan.file(self.plan.layout.mesh("Solver", "volumes.tsv"), mesh) for mesh in made}

    def maps(self, hemi: str) -> dict[str, str]:
        """Maps of the cases of a hemisphere, by case: those that a run makes; afterwards, those that exist."""
        asked = {mesh: path for mesh, path in self.plan.maps(hemi).items() if self.state(mesh).verdict}
        return {mesh[0]: path for mesh, path in asked.items() if self.failed is None or Path(path).exists()}

    def rows(self) -> list[dict[str, Any]]:
        """Rows of the table of states, one per mesh and per excluded row of the sheet."""
        rows: list[dict[str, Any]] = [
            {"case": mesh[0], "cell_size_mm": mesh[1] / 1000, "mesher": mesh[2], **self.state(mesh).cells()}
            for mesh in self.plan.meshes()
        ]
        whys = {case.name: case.exclude_reason or "no reason given" for case in self.plan.sheet if not case.include}
        return rows + [{"case": name, "state": "excluded", "reason": why} for name, why in whys.items()]

    def worst(self, names: Collection[str]) -> dict[str, str]:
        """The worst state of each named case."""
        states = [(mesh[0], self.state(mesh).cells()["state"]) for mesh in self.plan.meshes() if mesh[0] in names]
        return dict(sorted(states, key=lambda one: [*STATES].index(one[1])))  # the last of a case stays

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
    jobs = Jobs(plan)
    found = [one for one in failures(Path(plan.layout.output), ended=ended) if _is_planned(jobs, one)]
    failed = sorted(found, key=lambda failure: ORDER.index(failure.rule))
    return States(plan, {mesh: state_of(jobs, mesh, failed) for mesh in plan.meshes()}, failed)


def state_of(jobs: Jobs, mesh: Mesh, failed: Sequence[Failure]) -> State:
    """What became of a mesh, by what its certificate and reports were made from, and by the jobs that failed.

    Parameters
    ----------
    failed : in the order of the line
    """
    plan, job = jobs.plan, jobs.plan.job(mesh)
    case, certificate = plan.cases[mesh[0]], plan.certificate(mesh)
    content = certificate_of(certificate)
    is_earlier = bool(content) and not jobs.is_planned("solver_ready", job, content)
    is_replaced = bool(content) and _is_replaced(plan, mesh, content)
    other = None if content and not is_earlier and not is_replaced else _first_other_rule(jobs, job)
    verdict = {} if other else {key: content[key] for key in ("certified", "verdict", "reasons", "remarks")}
    failed = [one for one in failed if one.is_about(**job)]
    if other:  # it is the mesh or its certificate that has to be made again
        failed = [one for one in failed if one.rule not in AFTER_CERTIFICATE]
    else:  # a job that was killed as it made a part of the mesh again has changed nothing
        failed = [one for one in failed if one.rule in AFTER_CERTIFICATE or not one.is_silent]
    if failed:
        log = failed[0].log.relative_to(plan.layout.output).as_posix()
        state = State(failed[0].rule, "failed", failed[0].reason, failed[0].remedy, log)
    elif other and certificate.exists():
        why = _REPLACED if is_replaced else _OTHER if content else _DAMAGED
        state = State(other, "unfinished", why, f"`snakemake --forcerun {other}` remakes it")
    elif other:
        state = State(other, "unfinished", _OTHER_SIZE if certificates_of(plan, case) else _ENDED)
    elif missing := [maker for path, maker in plan.final_files(mesh).items() if not Path(path).exists()]:
        state = State(missing[0], "unfinished", _ENDED)
    elif edited := edited_exports(plan, mesh):
        files = " and ".join(map(str, edited))
        state = State("export", "unfinished", "; ".join(edited.values()), f"delete {files}, and cortet remakes it")
    elif name := _other_field(jobs, mesh):
        remedy = "`snakemake --forcerun fields` carries it"
        state = State("fields", "unfinished", f"the file of the field {name} has changed", remedy)
    else:
        return State("certify", "certified", "; ".join(content["remarks"]), verdict=verdict)
    is_measured = state.stage in AFTER_CERTIFICATE
    # the surface of a case that failed is missing, else its results would be outdated
    kept = certificate.exists() and not is_measured if state.state == "failed" else is_earlier and not is_replaced
    folder = certificate.parent if kept else Path(plan.layout.output) / case.folder / OUTDATED
    has_earlier = kept or any(folder.glob(f"*/{case.name}_*"))
    earlier = folder.relative_to(plan.layout.output).as_posix() if has_earlier else ""
    return replace(state, earlier=earlier, is_kept=kept, verdict=verdict if is_measured else {})


def _first_other_rule(jobs: Jobs, job: Wildcards) -> str:
    """The first rule that made a mesh from something else than planned; the last one if all reports are as planned."""
    others = (one.rule for one in jobs.reports(job) if not jobs.is_planned(one.rule, one.job, json_of(one.path)))
    return next(others, "solver_ready")


def _is_replaced(plan: Plan, mesh: Mesh, content: Mapping[str, Any]) -> bool:
    """Whether a mesh is not the one that its certificate is about.

    A mesh that is older than the certificate is told by its numbers of nodes and tetrahedra and its end; only a newer
    one is read.

    Parameters
    ----------
    content : of the certificate
    """
    last, certificate = Path(plan.file(plan.layout.mesh(LABELS["solver_ready"]), mesh)), plan.certificate(mesh)
    if not last.is_file():
        return last.exists()
    from cortet.formats import vtu  # loads what most runs do without
    from cortet.formats.hashing import mesh_sha256

    try:
        if last.stat().st_mtime_ns <= certificate.stat().st_mtime_ns:
            return vtu.counts(last) != (content["quality"]["nodes"], content["quality"]["tets"])
        return mesh_sha256(vtu.read(last)) != content["mesh_sha256"]
    except CortetError:
        return True


def edited_exports(plan: Plan, mesh: Mesh) -> dict[Path, str]:
    """Files for solvers of a mesh that were changed, or lack a file that belongs to them -> what happened, in words."""
    found = {}
    for file in (path for path in plan.exports(mesh) if path.is_file()):
        record = Path(f"{file}.json")
        gone = [name for name in files_of(record) if not (record.parent / name).is_file()]
        if gone:
            found[file] = f"{record.parent / gone[0]} is missing"
        elif changed := changed_of(record):
            found[file] = f"{changed[0]} was changed after cortet wrote it"
    return found


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


def _is_planned(jobs: Jobs, failure: Failure) -> bool:
    """Whether a plan has the job that failed, as it was then."""
    plan, case = jobs.plan, failure.job.get("case")
    known = failure.rule in ORDER and case in plan.cases and failure.job.get("setting", "") in plan.settings
    return known and jobs.is_planned(failure.rule, failure.job, vars(failure))
