"""What the jobs left in the output folder that did not succeed, and which meshes and files are missing for that.

A job that fails leaves `failure.json` beside its log, and so does one that was killed. A mesh is finished if its
certificate records the present settings and the present files of the user.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cortet.cohort.jobs import Mesh
from cortet.cohort.layout import EXPORTED, inner_of
from cortet.cohort.outdated import certificates_of, earlier_results, first_other_stage
from cortet.cohort.plan import AFTER_CERTIFICATE, Plan
from cortet.cohort.selection import folded
from cortet.cohort.status import STOPPED, certificate_of, failure_reason
from cortet.formats.ownership import json_of
from cortet.stages import STAGES

#: rules on a case, in the order in which a case goes through them
ORDER = (
    *("phantom", "phantom_inner", "fields"),
    *STAGES,
    *AFTER_CERTIFICATE,
)
#: what to do about a job that left no word
_AFTER_A_KILL = "give the job more memory or time, and run again"
#: why a mesh is unfinished although its case has one
_OTHER_SIZE = "its mesh has a different cell size or mesher than requested"
_OTHER = "its mesh was made with other settings, from another surface, or by another version of cortet"
_DAMAGED = "its certificate is damaged, edited, or from another version of cortet"


@dataclass(frozen=True)
class Failure:
    """A job that failed or was killed."""

    rule: str
    wildcards: Mapping[str, str]
    reason: str
    #: what to do about it; empty if only its log can tell
    remedy: str
    log: Path
    #: when it failed or began, seconds since the epoch
    time: float

    def is_about(self, **wildcards: object) -> bool:
        """Whether the job worked for a mesh, as far as its wildcards say: one on a surface works for all its meshes."""
        return all(self.wildcards.get(key, str(value)) == str(value) for key, value in wildcards.items())


def failures(output: Path, *, ended: bool = True) -> list[Failure]:
    """Jobs below an output folder that did not succeed when they last ran, by the order of the line.

    Parameters
    ----------
    ended : whether no job is running now; if one may be, only those count that said why they failed
    """
    found = []
    for path in sorted((output / "logs").rglob("*.failure.json")):
        told, log = json_of(path), path.with_name(path.name.replace(".failure.json", ".log"))
        has_word = "reason" in told
        is_known = told.get("stage") in ORDER and "inner" not in told["wildcards"]  # a wildcard of earlier versions
        if is_known and (ended or has_word):
            reason = told["reason"] if has_word else failure_reason(log)
            remedy = (told["remedy"] or "") if has_word else _AFTER_A_KILL
            if reason != STOPPED:
                found.append(Failure(told["stage"], told["wildcards"], reason, remedy, log, path.stat().st_mtime))
    return sorted(found, key=lambda failure: ORDER.index(failure.rule))


def with_failures(plan: Plan, *, ended: bool = True) -> Plan:
    """The plan, with what its output folder says of meshes and files that are missing."""
    found = failures(Path(plan.layout.output), ended=ended)
    by_case: dict[str, list[Failure]] = {}
    for failure in found:
        by_case.setdefault(failure.wildcards.get("case", ""), []).append(failure)
    known: dict[Mesh, dict[str, Any]] = {}
    for mesh, certificate in plan.certificates().items():
        if state := _state(plan, mesh, certificate, by_case.get(mesh[0], [])):
            # the surface of a case that failed is missing, else its results would be outdated
            kept = state["state"] == "failed" and state["stage"] not in AFTER_CERTIFICATE and certificate.exists()
            folder = certificate.parent if kept else earlier_results(plan, plan.cases[mesh[0]])
            last = {"earlier": _inside(plan, folder)} if folder else {}
            known[mesh] = state | last
    return replace(plan, failures=known, failed=found)


def _state(plan: Plan, mesh: Mesh, certificate: Path, of_case: Sequence[Failure]) -> dict[str, Any] | None:
    """How a mesh failed, or that it is unfinished: `stage`, `state`, `reason`, `remedy` and `log` if it failed."""
    job, stage = plan.job(mesh), first_other_stage(plan, mesh)
    for one in of_case:
        if stage and one.rule in AFTER_CERTIFICATE:
            continue  # it is the mesh or its certificate that has to be made again
        if one.is_about(res=job["res"], mesher=job["mesher"], setting="") and _counts(plan, job, certificate, one):
            words = {"reason": one.reason, "remedy": one.remedy}
            return {"stage": one.rule, "state": "failed", **words, "log": _inside(plan, one.log)}
    reason = "the run ended before this case was done"
    if stage:
        again = f"`snakemake --forcerun {_rule_of(stage)}` remakes it"
        if certificate.exists():
            reason = f"{_OTHER if certificate_of(certificate) else _DAMAGED}; {again}"
        elif certificates_of(plan, plan.case(job)):
            reason = _OTHER_SIZE
    elif missing := [stage for path, stage in plan.final_files(mesh).items() if not Path(path).exists()]:
        stage = missing[0]
    else:
        return None
    return {"stage": stage, "state": "unfinished", "reason": reason}


def _inside(plan: Plan, path: Path) -> str:
    """The name of a file or folder from the output folder, from wherever the run was started."""
    return path.relative_to(plan.layout.output).as_posix()


def made_otherwise(plan: Plan) -> dict[str, int]:
    """Rule from which on meshes were made otherwise than planned -> their number."""
    there = [mesh for mesh, certificate in plan.certificates().items() if certificate.exists()]
    return dict(Counter(_rule_of(stage) for mesh in there if (stage := first_other_stage(plan, mesh))))


def _rule_of(stage: str) -> str:
    """The rule of a stage: the first repairs, too, and the last certifies."""
    return {"repair": "gate", "certify": "solver_ready"}.get(stage, stage)


def _counts(plan: Plan, job: Mapping[str, str], certificate: Path, failure: Failure) -> bool:
    """Whether a job that failed is one that the plan still asks for."""
    case, wildcards, rule = plan.case(job), failure.wildcards, failure.rule
    if rule not in AFTER_CERTIFICATE and certificate.exists() and failure.time < certificate.stat().st_mtime:
        return False  # the mesh has been made since
    stage, inner = STAGES.get(rule), inner_of(wildcards)
    of_variant = wildcards.get("variant", "").lower() in ("", *plan.config.fold.variants)
    is_folded = of_variant and case in folded(list(plan.cases.values()), plan.config.fold.cases)
    asked = {
        "volumes": bool(case.volumes),
        "export": EXPORTED.get(wildcards.get("suffix", "")) in plan.config.export.formats,
        "ten_nodes": bool(plan.config.export.ten_nodes),
        "case_maps": plan.is_resampled(job),
        "fields": bool(case.fields),
        **dict.fromkeys(("fold", "fold_figures", "folded_surface"), is_folded),
    }
    return asked.get(rule, True) and (stage is None or stage in plan.line(job)) and (not inner or inner in case.inner)


def why_missing(plan: Plan, path: str, rule: str, job: Mapping[str, object]) -> str | None:
    """Why a file cannot be used: it was not made, or an earlier stage of its mesh has failed since; None if it can.

    Parameters
    ----------
    plan : with its failures; while a run is planned, no file is missing
    rule : that makes the file
    job : wildcards of that job
    """
    if plan.failed is None:
        return None
    exists = Path(path).exists()
    for cause in plan.failed:
        before = ORDER.index(cause.rule) < ORDER.index(rule) and cause.rule not in AFTER_CERTIFICATE
        if cause.is_about(**job) and (before or not exists):
            return f"{cause.rule}: {cause.reason}"
    return None if exists else "the run ended before this case was done"
