"""Parameters, memory and time of each job of the workflow.

Methods take the wildcards of a job, by their names.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from cortet.cohort.inputs import Inputs, Sources
from cortet.cohort.layout import EXPORTED, Wildcards, filled, inner_of, region_wildcard
from cortet.cohort.plan import Plan
from cortet.cohort.resources import cost, expected_tets, expected_volume_ml, memory_to_ask_mb, minutes_to_ask
from cortet.cohort.user_files import content
from cortet.config import Config
from cortet.formats.ownership import json_of
from cortet.stages import STAGES, certify_record
from cortet.stages.stage import About, Stage, Values


@dataclass(frozen=True)
class Report:
    """A report on the way to a mesh."""

    stage: str
    #: that writes it: the first also repairs, the last also certifies
    rule: str
    #: the inner surface that it is about; empty for the surface of the case, and for all of them
    inner: str
    path: Path
    #: wildcards of its job
    job: Wildcards


@dataclass(frozen=True)
class Jobs:
    """The jobs of a plan: what they take."""

    plan: Plan

    @cached_property
    def inputs(self) -> Inputs:
        """The files of the line."""
        return Inputs(self.plan)

    @cached_property
    def sources(self) -> Sources:
        """The user's files."""
        return self.inputs.sources

    def about(self, job: Wildcards) -> About:
        """What is known of the surface or mesh of a job."""
        case, inner = self.sources.case(job), inner_of(job)
        return About(
            cell_size=int(job["res"]) / 1000 if job.get("res") else None,
            mesher=job.get("mesher"),
            gestational_age=case.scan_age,
            hemi=case.hemi,
            to_mm=self.sources.placement(job),
            inside=bool(inner),
            source=self.sources.source(job),
            sphere_file=str(case.sphere) if case.sphere else None,
            inner={} if inner else {name: str(path) for name, path in case.inner.items()},
        )

    def steps(self, stages: Sequence[str], job: Wildcards) -> dict[str, Values]:
        """What each of some stages of a job is given; `made_from` says whether it runs again.

        Stages of the surface that the line leaves out are left out. Other settings may have a stage of the mesh that
        the line has not, and that all settings share.
        """
        about, line = self.about(job), self.inputs.line(job)
        return {
            stage.name: {
                "settings": stage.settings_of(self._config_of(stage, job), about),
                "about": stage.about_of(about).model_dump(exclude_defaults=True),
            }
            for stage in map(STAGES.get, stages)
            if stage and (stage in line or stage.gives == "mesh")
        }

    def phantom_arguments(self, job: Wildcards) -> dict[str, Any]:
        """Keyword arguments of `phantoms.phantom`."""
        case, section = self.sources.case(job), self.plan.config.phantom
        of_case = {"gestational_age": case.scan_age, "hemisphere": case.hemi}
        return {"subdivisions": section.subdivisions, "seed": section.seed, **of_case}

    def recorded_line(self, job: Wildcards) -> dict[str, Values]:
        """What the stages of a setting and the certificate depend on, as certificates record it."""
        about = self.about(job)
        done = {stage.name: stage.record(self._config_of(stage, job), about) for stage in self.inputs.line(job)}
        return {**done, "certify": self._certify_record(job)}

    def _certify_record(self, job: Wildcards) -> Values:
        return certify_record(self.inputs.setting(job), int(job["res"]) / 1000)

    def made_from(self, rule: str, job: Wildcards, unread: Mapping[str, str] = MappingProxyType({})) -> str:
        """SHA-256 of what a job on a case depends on, or more: what was made from anything else is not planned.

        A job of a stage depends on that stage and those before it, any other job on all of them, and on what follows
        them. Names of files decide nothing. Empty for an inner surface that the case no longer has.

        Parameters
        ----------
        unread : SHA-256, by the names of `Sources.paths`, that files count with which cannot be read
        """
        case, inner = self.sources.case(job), inner_of(job)
        if inner and inner not in case.inner:
            return ""
        line, about, more = self.inputs.line(job), self.about(job), list[object]()
        if stage := STAGES.get(rule):
            earlier, read = [*STAGES][: [*STAGES].index(rule)], self.sources.paths(job)
            line = [*(one for one in line if one.name in earlier), stage]
        else:
            read = self.sources.all_paths(job) | self.sources.volume_paths(job)
            more = [self.plan.config.export.values(), self.plan.config.fold.model_dump(mode="json")]
            more += [case.extra, sorted(case.fields), sorted(case.volumes)]
        done = [stage.record(self._config_of(stage, job), about) for stage in line]
        if rule == "solver_ready":
            done.append(self._certify_record(job))
        digests = {name: now or unread.get(name) for name, now in content(read).items()}
        told = json.dumps([rule, done, digests, *more], default=str)
        return hashlib.sha256(told.encode()).hexdigest()

    def is_planned(self, rule: str, job: Wildcards, record: Mapping[str, Any]) -> bool:
        """Whether a result was made from what the plan says, by its record.

        A file of the user that cannot be read counts as the one that the result was made from.
        """
        return record.get("made_from") == self.made_from(rule, job, record.get("input_sha256", {}))

    def certified_from(self, job: Wildcards) -> str:
        """`made_from` of the certificate of a mesh, if that is as planned."""
        known = json_of(Path(filled(self.plan.layout.certificate, job))).get("input_sha256", {})
        return self.made_from("solver_ready", job, known)

    def reports(self, job: Wildcards) -> list[Report]:
        """The reports from which the last stage makes the certificate of a mesh, and its own."""
        inner, found = list(self.sources.case(job).inner), []
        for stage in self.inputs.line(job):
            # each report of `separate` is about all inner surfaces
            for name in ["", *inner] if stage.each_surface else inner[:1] if stage.nested else [""]:
                own = {"folder": job["folder"], "case": job["case"], "region": region_wildcard(name) if name else ""}
                own |= {key: job[key] for key in stage.wildcards}
                path = Path(filled(self.inputs.report(stage), own))
                rule = "gate" if stage.name == "repair" else stage.name
                found.append(Report(stage.name, rule, name if stage.each_surface else "", path, own))
        return found

    def of_reports(self, job: Wildcards) -> list[tuple[str, str, str, str]]:
        """Stage, rule, inner surface, and `made_from` of each report before the last stage's own."""
        before = self.reports(job)[:-1]
        return [(one.stage, one.rule, one.inner, self.made_from(one.rule, one.job)) for one in before]

    def _config_of(self, stage: Stage, job: Wildcards) -> Config:
        """The configuration of a stage; those that all settings share use that of the line."""
        return self.plan.config if stage.shared_by_settings or stage.gives == "surface" else self.inputs.setting(job)

    def origin(self, label: str, job: Wildcards) -> dict[str, Any]:
        """Origin of the record that a job writes; `label` is that of the stage that made the mesh or surface."""
        if job.get("mesher"):
            return self.plan.origin_of_mesh(label, job["case"], int(job["res"]), job["mesher"], job.get("setting", ""))
        inner = {"inner": inner_of(job)} if inner_of(job) else {}
        return {"case": job["case"], "stage": label, **inner}

    def page_facts(self, job: Wildcards) -> dict[str, Any]:
        """The facts at the top of the page of a mesh."""
        known = self.plan.described((job["case"], int(job["res"]), job["mesher"]))
        return {"surface": self.sources.kind_of_surface(job), **known}

    def exported(self, job: Wildcards) -> dict[str, Any]:
        """Names, by their label, and formats of a mesh's files for solvers, and whether any mesh has them."""
        layout, export = self.plan.layout, self.plan.config.export
        files = {layout.mesh("{label}", end): name for end, name in EXPORTED.items() if name in export.formats}
        files |= {layout.ten_node_files([name])[0]: f"{name}, ten nodes" for name in export.ten_nodes}
        names = [(Path(filled(pattern, job, label="{label}")).name, form) for pattern, form in files.items()]
        return {"names": names, "uncertified": export.uncertified}

    def tets(self, job: Wildcards) -> float:
        """Expected tetrahedra: from the volume that the gate measured, else from the age; 0 for a job on a surface."""
        if not job.get("mesher"):
            return 0
        case = self.sources.case(job)
        try:
            gated = filled(self.plan.layout.surface(STAGES["gate"].label, "white.json"), job)
            volume = json.loads(Path(gated).read_text(encoding="utf-8"))["volume_ml"]
        except (OSError, ValueError):
            volume = expected_volume_ml(case.scan_age, whole=case.hemi is None)
        return expected_tets(volume, int(job["res"]) / 1000, job["mesher"])

    def megabytes(self, rule: str, job: Wildcards, attempt: int) -> int:
        """Memory that a job asks for, MB: more after each time it was killed."""
        return memory_to_ask_mb(cost(rule, job.get("mesher", "")).memory_mb(self.tets(job)), attempt)

    def minutes(self, rule: str, job: Wildcards) -> int:
        """Time limit that a job asks for."""
        return minutes_to_ask(cost(rule, job.get("mesher", "")).cpu_seconds(self.tets(job)))
