"""Parameters, memory and time of each job of the workflow.

Methods take the wildcards of a job, by their names.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cortet.cohort.inputs import Inputs
from cortet.cohort.layout import EXPORTED, Wildcards, filled, inner_of
from cortet.cohort.plan import Plan
from cortet.cohort.resources import cost, expected_tets, expected_volume_ml, memory_to_ask_mb, minutes_to_ask
from cortet.cohort.sources import Sources
from cortet.cohort.user_files import content
from cortet.config import Config
from cortet.stages import STAGES, certify_record
from cortet.stages.stage import LOCATIONS, About, Stage, Values
from cortet.version import version_of


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
        """What each of some stages of a job depends on; if it changes, the job runs again.

        Stages of the surface that the line leaves out are left out. Other settings may have a stage of the mesh that
        the line has not, and that all settings share.
        """
        about, line = self.about(job), self.inputs.line(job)
        return {
            stage.name: {
                "settings": stage.settings_of(self._config_of(stage, job), about),
                "about": stage.about_of(about).model_dump(exclude=LOCATIONS, exclude_defaults=True),
                "version": version_of(f"stages.{stage.name}"),
            }
            for stage in map(STAGES.get, stages)
            if stage and (stage in line or stage.gives == "mesh")
        }

    def locations(self, job: Wildcards) -> Values:
        """Names of the user's surfaces of a job, for messages and reports."""
        return self.about(job).model_dump(include=LOCATIONS, exclude_defaults=True)

    def phantom_arguments(self, job: Wildcards) -> dict[str, Any]:
        """Keyword arguments of `phantoms.phantom`."""
        case, section = self.sources.case(job), self.plan.config.phantom
        of_case = {"gestational_age": case.scan_age, "hemisphere": case.hemi}
        return {"subdivisions": section.subdivisions, "seed": section.seed, **of_case}

    def stages_before(self, stage: str, job: Wildcards) -> list[str]:
        """The stages of the line of a job that come before a stage: a job runs again if one is left out or added."""
        names = [one.name for one in self.inputs.line(job)]
        return names[: names.index(stage)] if stage in names else names

    def recorded_line(self, job: Wildcards) -> dict[str, Values]:
        """What the stages of a setting and the certificate depend on: if it changes, a certificate is made again."""
        about = self.about(job)
        done = {stage.name: stage.record(self._config_of(stage, job), about) for stage in self.inputs.line(job)}
        return {**done, "certify": certify_record(self.inputs.setting(job), int(job["res"]) / 1000)}

    def made_from(self, rule: str, job: Wildcards) -> str:
        """SHA-256 of what a job on a case depends on, or more: a failure of a job with another one does not count.

        A job of a stage depends on that stage and those before it, any other job on all of them, and on what follows
        them. Names of files decide nothing. Empty for an inner surface that the case no longer has.
        """
        case, inner = self.sources.case(job), inner_of(job)
        if inner and inner not in case.inner:
            return ""
        line, about, more = self.inputs.line(job), self.about(job), list[object]()
        names = [stage.name for stage in line]
        if rule in names:
            line, read = line[: names.index(rule) + 1], self.sources.paths(job)
        else:
            read = self.sources.all_paths(job) | self.sources.volume_paths(job)
            more = [self.plan.config.export.values(), self.plan.config.fold.model_dump(mode="json")]
            more += [case.extra, sorted(case.fields), sorted(case.volumes)]
        done = [stage.record(self._config_of(stage, job), about) for stage in line]
        told = json.dumps([rule, done, content(read), *more], default=str)
        return hashlib.sha256(told.encode()).hexdigest()

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
        case = self.sources.case(job)
        return {
            "surface": self.sources.kind_of_surface(job),
            "scan_age": case.scan_age,
            "hemi": case.hemi,
            "cell_size": int(job["res"]) / 1000,
            "mesher": job["mesher"],
        }

    def exported(self, job: Wildcards) -> dict[str, Any]:
        """Names and formats of a mesh's files for solvers, and whether a mesh that is not certified has them."""
        files = [
            (Path(filled(self.plan.layout.mesh("Solver", suffix), job)).name, name)
            for suffix, name in EXPORTED.items()
            if name in self.plan.config.export.formats
        ]
        for name in self.plan.config.export.ten_nodes:
            pattern, _ = self.plan.layout.ten_node_files([name])
            files.append((Path(filled(pattern, job)).name, f"{name}, ten nodes"))
        return {"names": files, "uncertified": self.plan.config.export.uncertified}

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
