"""The files that the jobs of a run read: those of the user, and those that the stages of a case make.

Methods take the wildcards of a job, by their names.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from cortet.cohort.layout import Wildcards, filled, inner_of, region_wildcard
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import ELECTRODES, PHANTOM, Case, column_of
from cortet.cohort.user_files import content
from cortet.config import Config
from cortet.errors import InputError
from cortet.formats.electrodes import coordinate_system
from cortet.formats.volumes import label_table, volume_file
from cortet.meshes import by_region
from cortet.stages import STAGES, stages_of
from cortet.stages.stage import Stage


@dataclass(frozen=True)
class Sources:
    """The user's files of a plan."""

    plan: Plan

    def case(self, job: Wildcards) -> Case:
        """The case that a job is about."""
        return self.plan.cases[job["case"]]

    def is_resampled(self, job: Wildcards) -> bool:
        """Whether the line of a case begins with its resampling onto the common mesh."""
        return self.plan.config.enabled("resample") and self.case(job).sphere is not None

    def source(self, job: Wildcards) -> str:
        """The user's file of the surface that a job is about."""
        return str(self._given_surface(job))

    def column(self, job: Wildcards) -> str:
        """The column of the sheet that names that file."""
        return column_of(inner_of(job))

    def _given_surface(self, job: Wildcards) -> Path | str | None:
        case, inner = self.case(job), inner_of(job)
        return case.inner.get(inner) if inner else case.surface

    def paths(self, job: Wildcards) -> dict[str, str]:
        """The user's files from which a job makes its result, by their columns in the sheet, without fields.

        A job on one surface has the files of that surface, a job on a mesh those of all surfaces of the case, and those
        of its contacts.
        """
        case = self.case(job)
        named: dict[str, Any] = {"surface": case.surface} | {f"inner_{name}": path for name, path in case.inner.items()}
        if not job.get("res"):
            own = f"inner_{inner_of(job)}" if inner_of(job) else "surface"
            named = {own: named[own]}
        else:
            named |= self.electrode_paths(job)
        if self.is_resampled(job):
            named |= {"sphere": case.sphere, "template": self._template(case)}
        return {name: str(path) for name, path in named.items() if path not in (None, PHANTOM)}

    def electrode_paths(self, job: Wildcards) -> dict[str, str]:
        """The table of the contacts of a case and the file of their coordinate system; empty without contacts."""
        table = self.case(job).electrodes
        system = coordinate_system(table) if table else None
        return {name: str(path) for name, path in {ELECTRODES: table, "coordsystem": system}.items() if path}

    def field_paths(self, job: Wildcards) -> dict[str, str]:
        """The files of the fields of a case, by name."""
        return {name: str(path) for name, path in self.case(job).fields.items()}

    def all_paths(self, job: Wildcards) -> dict[str, str]:
        """All files of a case, by their columns in the sheet."""
        return self.paths(job) | {f"field_{name}": path for name, path in self.field_paths(job).items()}

    def volume_paths(self, job: Wildcards) -> dict[str, str]:
        """The files of the volumes of a case and of the names of their labels, by column."""
        files = {f"volume_{name}": volume_file(text) for name, text in self.case(job).volumes.items()}
        tables = {f"{name}_names": str(table) for name, file in files.items() if (table := label_table(file))}
        return files | tables

    def given_surfaces(self, job: Wildcards) -> dict[str, str]:
        """The user's surfaces of a case by region; empty for a phantom."""
        case = self.case(job)
        named = by_region(case.surface, case.inner)
        return {region: str(path) for region, path in named.items() if path != PHANTOM}

    def kind_of_surface(self, job: Wildcards) -> str | None:
        """Which surface of the cortex is given, white or pial; None if its file does not say, or cannot be read."""
        case = self.case(job)
        return None if case.is_phantom else _kind_of(case.surface)

    def input_sha256(self, job: Wildcards) -> dict[str, str | None]:
        """Hashes of `paths`. Editing a file reruns its whole case; touching it reruns nothing."""
        return content(self.paths(job))

    def surface(self, job: Wildcards) -> str | list[str]:
        """The surface that a job is about as it is given."""
        return _given(self._given_surface(job), filled(self.plan.layout.each_surface("phantom"), job))

    def sphere(self, job: Wildcards) -> str | list[str]:
        """The sphere of a case that is resampled; empty for other cases, and if the file is missing."""
        sphere = self.case(job).sphere if self.is_resampled(job) else None
        return _given(sphere, self.plan.layout.surface("phantom", "sphere.surf.gii"))

    def template(self, job: Wildcards) -> str | list[str]:
        """The common sphere that a case is resampled to; empty if that is the icosphere."""
        return existing(self._template(self.case(job)) if self.is_resampled(job) else None)

    def _template(self, case: Case) -> str | None:
        """The common sphere of a case; None if it depends on an unknown hemisphere, which the job reports."""
        try:
            return self.plan.config.resample.template_of(case.hemi)
        except InputError:
            return None

    def placement(self, job: Wildcards) -> float | None:
        """Factor from the coordinates of a case to mm; None if nobody states their unit, which is then mm."""
        case = self.case(job)
        return None if case.is_phantom else self.plan.config.placement(case.unit)

    def space(self, job: Wildcards) -> str:
        """The surface in whose space all files of a case are."""
        case = self.case(job)
        return filled(self.plan.layout.surface("phantom"), job) if case.is_phantom else str(case.surface)


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


def existing(path: str | Path | None) -> str | list[str]:
    """The file if it exists: the job reports a missing file, so that other cases continue."""
    return str(path) if path and os.path.isfile(path) else []  # noqa: PTH113, false of names that are too long


def _given(path: str | Path | None, of_phantom: str) -> str | list[str]:
    """A file that the sheet names: that of the phantom, which is made, or one that exists."""
    return of_phantom if path == PHANTOM else existing(path)


def existing_of(paths: Callable[[Wildcards], Mapping[str, str]]) -> Callable[[Wildcards], list[str]]:
    """An input function: those files of a job that exist."""
    return lambda job: [path for path in paths(job).values() if existing(path)]


@cache
def _kind_of(path: str | Path) -> str | None:
    from cortet.formats.gifti import kind_of  # loads what most jobs do without

    try:
        return kind_of(path)
    except InputError:
        return None
