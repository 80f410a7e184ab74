"""Which meshes take part in the experiments of the paper, and the names of their records."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cortet.cohort.layout import LABELS, SHARED, file_of
from cortet.cohort.plan import Plan
from cortet.cohort.selection import chosen
from cortet.cohort.sheet import Case
from cortet.cohort.states import States
from cortet.config.section import Cases
from cortet.meshers import BASELINES
from cortet.report.records import Origin
from cortet.stages import STAGES

#: label of a stage whose effect is measured -> stages that have run, what the last of them adds
ABLATED = {
    STAGES["generate"].label: ("S1-S2", "only"),
    STAGES["relocate"].label: ("S1-S3", "+ Gmsh (S3)"),
    STAGES["clean"].label: ("S1-S4", "+ cleaning (S4)"),
    STAGES["reconnect"].label: ("S1-S4+", "+ reconnection (S4+)"),
}
#: label of the last stage
_LAST = LABELS["solver_ready"]
#: label of a stage -> its rule
_RULES = {label: stage for stage, label in LABELS.items()}
#: case, cell size in µm and mesher
OfCase = tuple[Case, int, str]
#: path of a record -> the mesh that it is about, so that a table can also say whose record is missing
Records = dict[str, Origin]


@dataclass(frozen=True)
class Experiments:
    """The experiments on the cases of a plan."""

    states: States

    @property
    def plan(self) -> Plan:
        """What the run is asked for."""
        return self.states.plan

    @cached_property
    def compared_meshers(self) -> list[str]:
        """Meshers of other projects, for comparison. If one fails, its report says so and the run continues."""
        meshers = self.plan.config.experiments.ablation.meshers
        return [mesher for mesher in meshers if mesher in BASELINES and mesher not in self.plan.config.generate.meshers]

    @cached_property
    def own_meshers(self) -> list[str]:
        """Meshers whose failure is that of the case."""
        named = [*self.plan.config.generate.meshers, *self.plan.config.experiments.ablation.meshers]
        return list(dict.fromkeys(name for name in named if name not in self.compared_meshers))

    @cached_property
    def mesher_of(self) -> dict[str, str]:
        """By setting, the mesher whose meshes stand for it."""
        return {name: setting.generate.meshers[0] for name, setting in self.plan.settings.items()}

    @cached_property
    def ablation_cases(self) -> dict[int, list[Case]]:
        """Cell size in µm -> cases of the ablation."""
        ablation = self.plan.config.experiments.ablation
        sizes = dict.fromkeys(self.plan.resolutions, ablation.cases)
        sizes |= {round(1000 * size): which for size, which in ablation.further.items()}
        return {res: self._cases(which) for res, which in sizes.items()}

    def ablated(self, meshers: Iterable[str]) -> list[OfCase]:
        """Every mesh that the ablation takes from some meshers."""
        meshers = list(meshers)
        return [
            (case, res, mesher) for res, cases in self.ablation_cases.items() for case in cases for mesher in meshers
        ]

    def ablation_reports(self) -> Records:
        """What S1 reported of every mesh; with these as inputs the meshers run at once, not one after the other."""
        meshes = self.ablated([*self.own_meshers, *self.compared_meshers])
        return {_report(self.plan, mesh): self._origin(STAGES["generate"].label, mesh) for mesh in meshes}

    def ablation_records(self) -> Records:
        """Quality records of the ablation, without those of meshers of other projects that made no mesh."""
        made = [mesh for mesh in self.ablated(self.compared_meshers) if self._is_made(mesh)]
        return self.records_of([*self.ablated(self.own_meshers), *made])

    def ablation_asked(self) -> Records:
        """As `ablation_records`, with those of meshers of other projects that did not say what they made."""
        others = self.ablated(self.compared_meshers)
        silent = [
            mesh for mesh in others if self._why(_report(self.plan, mesh), "generate", mesh) or self._is_made(mesh)
        ]
        return self.records_of([*self.ablated(self.own_meshers), *silent])

    def references(self) -> dict[str, Path]:
        """Reference meshes by name."""
        return {path.stem: path for path in self.plan.config.experiments.reference_meshes}

    def records_of(self, meshes: Iterable[OfCase]) -> Records:
        """Quality records of meshes after each stage that the ablation looks at, in the settings run on them.

        These are the settings that name the mesher, else all.
        """
        plan = self.plan

        def settings_on(mesher: str) -> list[str]:
            own = [name for name, setting in plan.settings.items() if mesher in setting.generate.meshers]
            return own or list(plan.settings)

        return {
            path: origin
            for mesh in meshes
            for stage, label in LABELS.items()
            for name in ([""] if stage in SHARED else settings_on(mesh[2]))
            if label in ABLATED and plan.settings[name].enabled(stage)
            for path, origin in self._record(label, mesh, name).items()
        }

    def resolution_records(self) -> Records:
        """Quality records of the last meshes of every setting, by cell size."""
        asked = self.plan.config.experiments.resolution
        sizes = [round(1000 * size) for size in asked.cell_size] or self.plan.resolutions
        return self._last_records((case, res) for case in self._cases(asked.cases) for res in sizes)

    def measures_records(self) -> Records:
        """Quality records of the last meshes of every setting, for the table of other measures."""
        cases = self._cases(self.plan.config.experiments.measures.cases)
        return self._last_records((case, self.plan.resolutions[0]) for case in cases)

    def certificates(self, records: Records) -> Records:
        """Certificates of the meshes of the line among those of records; other settings and cell sizes have none."""
        plan = self.plan
        meshes = plan.each_case(plan.layout.certificate).items()
        line = {path: Origin(**plan.origin_of_mesh(_LAST, *mesh)) for mesh, path in meshes}
        return {path: origin for path, origin in line.items() if origin in records.values()}

    def pooled_records(self, res: int) -> Records:
        """Quality records that the figure of pooled quality takes at one cell size, µm."""
        meshers = dict.fromkeys(self.mesher_of.values())
        return self.records_of(mesh for mesh in self.ablated(meshers) if mesh[1] == res)

    def series(self) -> list[dict[str, Any]]:
        """Brains of the developmental series by age, unknown ages last: both hemispheres where the sheet has them.

        By hemisphere, each has `meshes`, and the `certificates` of those that have one.
        """
        plan = self.plan
        wanted = {(case.participant, case.session) for case in self._cases(plan.config.experiments.series.cases)}
        brains: dict[tuple[str, str | None], dict[str, Any]] = {}
        for case in plan.cases.values():
            key = (case.participant, case.session)
            patterns = (plan.layout.mesh(_LAST), plan.layout.certificate)
            mesh, certificate = (file_of(one, case, plan.resolutions[0], self.mesher_of[""]) for one in patterns)
            place = (case, plan.resolutions[0], self.mesher_of[""])
            if key in wanted and not self._why(mesh, "solver_ready", place):
                name = f"sub-{case.participant}" + (f", ses-{case.session}" if case.session else "")
                new: dict[str, Any] = {"name": name, "age": case.scan_age, "meshes": {}, "certificates": {}}
                brain = brains.setdefault(key, new)
                brain["meshes"][case.hemi or "n/a"] = mesh
                if not self._why(certificate, "solver_ready", place):
                    brain["certificates"][case.hemi or "n/a"] = certificate
        return sorted(
            brains.values(), key=lambda one: (one["age"] is None, one["age"] or 0, list(one["meshes"].values()))
        )

    def missing(self, records: Records) -> dict[Origin, str]:
        """Why records are missing, by their meshes."""
        reasons = ((origin, self._why_of(path, origin)) for path, origin in records.items())
        return {origin: reason for origin, reason in reasons if reason}

    def made(self, records: Records) -> Records:
        """The records that are not missing."""
        return {path: origin for path, origin in records.items() if not self._why_of(path, origin)}

    def _why_of(self, path: str, origin: Origin) -> str | None:
        """Why a record is missing."""
        case, res = self.plan.cases[origin.case], round(1000 * origin.cell_size_mm)
        named = {str(setting.setting): name for name, setting in self.plan.settings.items()}
        return self._why(path, _RULES[origin.stage], (case, res, origin.mesher), named.get(str(origin.setting), ""))

    def _why(self, path: str, rule: str, mesh: OfCase, setting: str = "") -> str | None:
        case, res, mesher = mesh
        job = {"folder": case.folder, "case": case.name, "res": res, "mesher": mesher, "setting": setting}
        return self.states.why_missing(path, rule, job)

    def _cases(self, which: Cases) -> list[Case]:
        """Cases of an experiment, without those with inner surfaces, which the meshers compared do not know."""
        return chosen([case for case in self.plan.cases.values() if not case.inner], which)

    def _last_records(self, meshes: Iterable[tuple[Case, int]]) -> Records:
        return {
            path: origin
            for case, res in meshes
            for name, mesher in self.mesher_of.items()
            for path, origin in self._record(_LAST, (case, res, mesher), name).items()
        }

    def _record(self, label: str, mesh: OfCase, setting: str = "") -> Records:
        path = file_of(self.plan.layout.mesh(label, "quality.json"), *mesh, setting)
        return {path: self._origin(label, mesh, setting)}

    def _origin(self, label: str, mesh: OfCase, setting: str = "") -> Origin:
        case, res, mesher = mesh
        return Origin(**self.plan.origin_of_mesh(label, case.name, res, mesher, setting))

    def _is_made(self, mesh: OfCase) -> bool:
        """Whether a mesher of another project made a mesh."""
        case, res, mesher = mesh
        waited = self.plan.waited_for
        path = Path(
            waited("baseline", folder=case.folder, case=case.name, res=res, mesher=mesher)
            if waited
            else _report(self.plan, mesh)
        )
        return path.exists() and "failure" not in json.loads(path.read_text(encoding="utf-8"))


def _report(plan: Plan, mesh: OfCase) -> str:
    """What S1 reports of a mesh."""
    return file_of(plan.layout.mesh("Generated", "tetmesh.json"), *mesh)
