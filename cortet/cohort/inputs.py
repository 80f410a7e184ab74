"""The files of the line that its jobs read: which stages a case goes through, and what each makes.

Methods take the wildcards of a job, by their names.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from cortet.cohort.layout import LABELS, Wildcards, filled, region_wildcard
from cortet.cohort.plan import Plan
from cortet.cohort.sources import Sources
from cortet.config import Config
from cortet.stages import STAGES, stages_of
from cortet.stages.stage import Stage


@dataclass(frozen=True)
class Inputs:
    """The stages of each case of a plan, and their files."""

    plan: Plan

    @cached_property
    def sources(self) -> Sources:
        """The user's files."""
        return Sources(self.plan)

    def setting(self, job: Wildcards) -> Config:
        """Configuration of the setting that a job works in."""
        return self.plan.settings[job.get("setting", "")]

    def line(self, job: Wildcards) -> list[Stage]:
        """The stages of a case in the setting of a job; all settings mesh the surfaces of the line."""
        case = self.sources.case(job)
        of_case = {
            "nested": bool(case.inner),
            "registered": self.sources.is_resampled(job),
            "aged": case.scan_age is not None,
        }
        surface = [stage for stage in stages_of(self.plan.config, **of_case) if stage.gives == "surface"]
        return [*surface, *(stage for stage in stages_of(self.setting(job), **of_case) if stage.gives == "mesh")]

    def first_surface(self, job: Wildcards) -> str | list[str]:
        """The first surface of the line, for the region of the job; on the common mesh if the case has a sphere."""
        if self.sources.is_resampled(job):
            return self.plan.layout.each_surface(STAGES["resample"].label)
        return self.sources.surface(job)

    def mesh_with_volumes(self, job: Wildcards) -> str:
        """The mesh at the end of the line, with what its volumes hold if the case has some."""
        suffix = "volumes.vtu" if self.sources.case(job).volumes else "tetmesh.vtu"
        return filled(self.plan.layout.mesh(LABELS["solver_ready"], suffix), job)

    def tissues(self, job: Wildcards) -> list[str]:
        """The table of the labels of a mesh, and the picture of its slices; none if it has no volumes."""
        if not self.sources.case(job).volumes:
            return []
        return [filled(self.plan.layout.mesh("Solver", suffix), job) for suffix in ("volumes.tsv", "slices.png")]

    def fields(self, job: Wildcards) -> str | list[str]:
        """The file of the case's fields; empty if it has none."""
        return self.plan.layout.surface("fields") if self.sources.case(job).fields else []

    def meshed_surface(self, job: Wildcards) -> str:
        """The surface that is meshed, and that every later stage measures against."""
        return self.plan.layout.surface(self._last_of_surface(job))

    def inner_surfaces(self, job: Wildcards) -> list[str]:
        """The inner surfaces of a case as S1 meshes them."""
        return self._inner(self.plan.layout.separated(), job)

    def inner_before_separating(self, job: Wildcards) -> list[str]:
        """The inner surfaces of a case as they are before `separate`."""
        return self._inner(self.plan.layout.each_surface(self._last_of_surface(job)), job)

    def _inner(self, pattern: str, job: Wildcards) -> list[str]:
        return [filled(pattern, job, region=region_wildcard(name)) for name in self.sources.case(job).inner]

    def _last_of_surface(self, job: Wildcards) -> str:
        """Label of the last stage that changes the surface of a case, or each of its inner ones, by itself."""
        stages = stages_of(self.plan.config, aged=self.sources.case(job).scan_age is not None)
        return [stage.label for stage in stages if stage.gives == "surface"][-1]

    def mesh_before(self, stage: str, job: Wildcards) -> str:
        """The mesh of the last enabled stage before `stage`. A bypassed stage does not occur."""
        order = list(STAGES)
        meshes = [one for one in stages_of(self.setting(job)) if one.gives == "mesh"]
        earlier = [one for one in meshes if order.index(one.name) < order.index(stage)]
        return filled(self.plan.layout.mesh(earlier[-1].label), job)

    def report(self, stage: Stage) -> str:
        """Pattern of the report of a stage."""
        if stage.nested:
            return self.plan.layout.separated("white.json")
        if stage.gives == "surface":
            return self.plan.layout.each_surface(stage.label, "white.json")
        return self.plan.layout.mesh(stage.label, "tetmesh.json")
