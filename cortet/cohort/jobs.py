"""Inputs, parameters, memory and time of each job of the workflow.

Methods take the wildcards of a job, by their names.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from cortet.cohort.layout import LABELS, SHARED, Layout, filled, inner_of, region_wildcard
from cortet.cohort.resources import cost, expected_tets, expected_volume_ml, memory_to_ask_mb, minutes_to_ask
from cortet.cohort.sheet import PHANTOM, Case, column_of
from cortet.cohort.user_files import content
from cortet.config import Config
from cortet.errors import InputError
from cortet.formats import FORMATS
from cortet.formats.volumes import label_table, volume_file
from cortet.meshes import by_region
from cortet.stages import STAGES, certify_record, stages_of
from cortet.stages.stage import LOCATIONS, About, Stage, Values
from cortet.version import version_of

#: wildcards of a job
Job = Mapping[str, str]
#: a mesh of the line: name of its case, cell size in µm, mesher
Mesh = tuple[str, int, str]

#: stages of the table of stages
_TABLED = ("generate", "relocate", "clean", "solver_ready")


@dataclass(frozen=True)
class Jobs:
    """The jobs of a run: their inputs, parameters, memory and time. `Plan` is the whole run."""

    #: configuration of each setting, by its addition to file names; the line's own adds nothing
    settings: Mapping[str, Config]
    #: rows of the sheet, excluded ones too
    sheet: Sequence[Case]
    #: mesh -> how it failed: `stage`, `state`, `reason`, `log`; empty while a run is planned
    failures: Mapping[Mesh, Mapping[str, Any]] = field(default_factory=dict)
    #: jobs that failed (`failures.Failure`), in the order of the line; None while a run is planned
    failed: Sequence[Any] | None = None
    #: output of a checkpoint of Snakemake, by its rule and wildcards, for which a run waits; None: as it lies there
    waited_for: Callable[..., str] | None = None
    #: names of the cases that a run is asked for; None: all
    chosen: frozenset[str] | None = None

    # --- what is asked for ---------------------------------------------------------------------------------------

    @property
    def config(self) -> Config:
        """Configuration of the line."""
        return self.settings[""]

    @property
    def raw(self) -> Path:
        """The dataset that is meshed, or the folder of the cohort sheet."""
        return self.config.cohort.dataset or self.config.cohort.sheet.parent

    @cached_property
    def layout(self) -> Layout:
        """Names of all files."""
        return Layout(self.config.output.as_posix())

    @cached_property
    def cases(self) -> dict[str, Case]:
        """The included cases by name."""
        return {case.name: case for case in self.sheet if case.include}

    @cached_property
    def resolutions(self) -> list[int]:
        """Cell sizes of cases that have none of their own, µm."""
        return [round(1000 * size) for size in self.config.generate.cell_size]

    def resolutions_of(self, case: Case) -> list[int]:
        """Cell sizes of a case, µm: its own one, or those of the configuration."""
        return [round(1000 * case.cell_size)] if case.cell_size else self.resolutions

    def meshes(self) -> list[Mesh]:
        """Meshes of all included cases that are asked for, at each cell size and by each mesher."""
        return [
            (case.name, res, mesher)
            for case in self.cases.values()
            if self.chosen is None or case.name in self.chosen
            for res in self.resolutions_of(case)
            for mesher in self.config.generate.meshers
        ]

    def job(self, mesh: Mesh) -> dict[str, str]:
        """Wildcards of the jobs on a mesh of the line."""
        case, res, mesher = mesh
        return {"folder": self.cases[case].folder, "case": case, "res": str(res), "mesher": mesher, "setting": ""}

    def file(self, pattern: str, mesh: Mesh) -> str:
        """The file of a pattern for a mesh of the line."""
        return pattern.format(**self.job(mesh))

    def each_case(self, pattern: str) -> dict[Mesh, str]:
        """The file of a pattern for each of `meshes`."""
        return {mesh: self.file(pattern, mesh) for mesh in self.meshes()}

    def certificates(self) -> dict[Mesh, Path]:
        """Certificates of all meshes, whether or not they are there."""
        return {mesh: Path(path) for mesh, path in self.each_case(self.layout.certificate).items()}

    def exports(self, mesh: Mesh) -> list[Path]:
        """Files of a mesh for solvers that are asked for."""
        patterns = self.layout.solver_files(self.config.export.formats, self.config.export.ten_nodes)
        return [Path(self.file(pattern, mesh)) for pattern in patterns]

    def other_exports(self, mesh: Mesh) -> list[Path]:
        """Files of a mesh for solvers that an earlier run may have been asked for."""
        patterns = self.layout.solver_files({*FORMATS} - {*self.config.export.formats})
        return [Path(self.file(pattern, mesh)) for pattern in patterns]

    def final_files(self, mesh: Mesh) -> dict[str, str]:
        """The last mesh, the files for solvers and their sidecars -> the rule of each; a deleted one is made again."""
        last = self.file(self.layout.mesh(LABELS["solver_ready"]), mesh)
        sidecars = [f"{self.file(one, mesh)}.json" for one in self.layout.solver_files(self.config.export.formats)]
        return {last: "solver_ready", **dict.fromkeys([*map(str, self.exports(mesh)), *sidecars], "export")}

    def solver_files(self) -> list[str]:
        """Last meshes, files for solvers with their sidecars, and certificates of all meshes."""
        final = [path for mesh in self.meshes() for path in self.final_files(mesh)]
        return [*final, *self.each_case(self.layout.certificate).values()]

    def measured_stages(self) -> list[str]:
        """Labels of the stages that the table of stages shows."""
        return [LABELS[stage] for stage in _TABLED if self.config.enabled(stage)]

    def quality_records(self) -> list[str]:
        """Quality records of all meshes."""
        patterns = [self.layout.mesh(label, "quality.json") for label in self.measured_stages()]
        return [path for pattern in patterns for path in self.each_case(pattern).values()]

    # --- one case ------------------------------------------------------------------------------------------------

    def case(self, job: Job) -> Case:
        """The case that a job is about."""
        return self.cases[job["case"]]

    def setting(self, job: Job) -> Config:
        """Configuration of the setting that a job works in."""
        return self.settings[job.get("setting", "")]

    def line(self, job: Job) -> list[Stage]:
        """The stages of a case in the setting of a job; all settings mesh the surfaces of the line."""
        case = self.case(job)
        of_case = {"nested": bool(case.inner), "registered": self.is_resampled(job), "aged": case.scan_age is not None}
        surface = [stage for stage in stages_of(self.config, **of_case) if stage.gives == "surface"]
        return [*surface, *(stage for stage in stages_of(self.setting(job), **of_case) if stage.gives == "mesh")]

    def is_resampled(self, job: Job) -> bool:
        """Whether the line of a case begins with its resampling onto the common mesh."""
        return self.config.enabled("resample") and self.case(job).sphere is not None

    def placement(self, job: Job) -> float | None:
        """Factor from the coordinates of a case to mm; None if nobody states their unit, which is then mm."""
        case = self.case(job)
        return None if case.is_phantom else self.config.placement(case.unit)

    def about(self, job: Job) -> About:
        """What is known of the surface or mesh of a job."""
        case, inner = self.case(job), inner_of(job)
        return About(
            cell_size=int(job["res"]) / 1000 if job.get("res") else None,
            mesher=job.get("mesher"),
            gestational_age=case.scan_age,
            hemi=case.hemi,
            to_mm=self.placement(job),
            inside=bool(inner),
            source=self.source(job),
            sphere_file=str(case.sphere) if case.sphere else None,
            inner={} if inner else {name: str(path) for name, path in case.inner.items()},
        )

    def steps(self, stages: Sequence[str], job: Job) -> dict[str, Values]:
        """What each of some stages of a job depends on, if the line has it; if it changes, the job runs again."""
        about = self.about(job)
        return {
            stage.name: {
                "settings": stage.settings_of(self._config_of(stage, job), about),
                "about": stage.about_of(about).model_dump(exclude=LOCATIONS, exclude_defaults=True),
                "version": version_of(f"stages.{stage.name}"),
            }
            for stage in self.line(job)
            if stage.name in stages
        }

    def locations(self, job: Job) -> Values:
        """Names of the user's surfaces of a job, for messages and reports."""
        return self.about(job).model_dump(include=LOCATIONS, exclude_defaults=True)

    def phantom_arguments(self, job: Job) -> dict[str, Any]:
        """Keyword arguments of `phantoms.phantom`."""
        case, section = self.case(job), self.config.phantom
        of_case = {"gestational_age": case.scan_age, "hemisphere": case.hemi}
        return {"subdivisions": section.subdivisions, "seed": section.seed, **of_case}

    def stages_before(self, stage: str, job: Job) -> list[str]:
        """The stages of the line of a job that come before a stage: a job runs again if one is left out or added."""
        names = [one.name for one in self.line(job)]
        return names[: names.index(stage)] if stage in names else names

    def recorded_line(self, job: Job) -> dict[str, Values]:
        """What the stages of a setting and the certificate depend on: if it changes, a certificate is made again."""
        about = self.about(job)
        done = {stage.name: stage.record(self._config_of(stage, job), about) for stage in self.line(job)}
        return {**done, "certify": certify_record(self.setting(job), int(job["res"]) / 1000)}

    def _config_of(self, stage: Stage, job: Job) -> Config:
        """The configuration of a stage; those that all settings share use that of the line."""
        return self.config if stage.shared_by_settings or stage.gives == "surface" else self.setting(job)

    def source(self, job: Job) -> str:
        """The user's file of the surface that a job is about."""
        return str(self._given_surface(job))

    def column(self, job: Job) -> str:
        """The column of the sheet that names that file."""
        return column_of(inner_of(job))

    # --- the user's files ----------------------------------------------------------------------------------------

    def paths(self, job: Job) -> dict[str, str]:
        """The user's files from which a job makes its result, by their columns in the sheet, without fields.

        A job on one surface has the files of that surface, a job on a mesh those of all surfaces of the case.
        """
        case = self.case(job)
        named: dict[str, Any] = {"surface": case.surface} | {f"inner_{name}": path for name, path in case.inner.items()}
        if not job.get("res"):
            own = f"inner_{inner_of(job)}" if inner_of(job) else "surface"
            named = {own: named[own]}
        if self.is_resampled(job):
            named |= {"sphere": case.sphere, "template": self._template(case)}
        return {name: str(path) for name, path in named.items() if path not in (None, PHANTOM)}

    def field_paths(self, job: Job) -> dict[str, str]:
        """The files of the fields of a case, by name."""
        return {name: str(path) for name, path in self.case(job).fields.items()}

    def all_paths(self, job: Job) -> dict[str, str]:
        """All files of a case, by their columns in the sheet."""
        return self.paths(job) | {f"field_{name}": path for name, path in self.field_paths(job).items()}

    def volume_paths(self, job: Job) -> dict[str, str]:
        """The files of the volumes of a case and of the names of their labels, by column."""
        files = {f"volume_{name}": volume_file(text) for name, text in self.case(job).volumes.items()}
        tables = {f"{name}_names": str(table) for name, file in files.items() if (table := label_table(file))}
        return files | tables

    def given_surfaces(self, job: Job) -> dict[str, str]:
        """The user's surfaces of a case by region; empty for a phantom."""
        case = self.case(job)
        named = by_region(case.surface, case.inner)
        return {region: str(path) for region, path in named.items() if path != PHANTOM}

    def kind_of_surface(self, job: Job) -> str | None:
        """Which surface of the cortex is given, white or pial; None if its file does not say, or cannot be read."""
        case = self.case(job)
        return None if case.is_phantom else _kind_of(case.surface)

    def input_sha256(self, job: Job) -> dict[str, str | None]:
        """Hashes of `paths`. Editing a file reruns its whole case; touching it reruns nothing."""
        return content(self.paths(job))

    # --- what jobs read ------------------------------------------------------------------------------------------

    def surface(self, job: Job) -> str | list[str]:
        """The surface that a job is about as it is given."""
        return _given(self._given_surface(job), filled(self.layout.each_surface("phantom"), job))

    def _given_surface(self, job: Job) -> Path | str | None:
        case, inner = self.case(job), inner_of(job)
        return case.inner.get(inner) if inner else case.surface

    def sphere(self, job: Job) -> str | list[str]:
        """The sphere of a case that is resampled; empty for other cases, and if the file is missing."""
        sphere = self.case(job).sphere if self.is_resampled(job) else None
        return _given(sphere, self.layout.surface("phantom", "sphere.surf.gii"))

    def template(self, job: Job) -> str | list[str]:
        """The common sphere that a case is resampled to; empty if that is the icosphere."""
        return existing(self._template(self.case(job)) if self.is_resampled(job) else None)

    def _template(self, case: Case) -> str | None:
        """The common sphere of a case; None if it depends on an unknown hemisphere, which the job reports."""
        try:
            return self.config.resample.template_of(case.hemi)
        except InputError:
            return None

    def first_surface(self, job: Job) -> str | list[str]:
        """The first surface of the line, for the region of the job; on the common mesh if the case has a sphere."""
        if self.is_resampled(job):
            return self.layout.each_surface(STAGES["resample"].label)
        return self.surface(job)

    def mesh_with_volumes(self, job: Job) -> str:
        """The mesh at the end of the line, with what its volumes hold if the case has some."""
        suffix = "volumes.vtu" if self.case(job).volumes else "tetmesh.vtu"
        return filled(self.layout.mesh("Solver", suffix), job)

    def tissues(self, job: Job) -> list[str]:
        """The table of the labels of a mesh, and the picture of its slices; none if it has no volumes."""
        if not self.case(job).volumes:
            return []
        return [filled(self.layout.mesh("Solver", suffix), job) for suffix in ("volumes.tsv", "slices.png")]

    def fields(self, job: Job) -> str | list[str]:
        """The file of the case's fields; empty if it has none."""
        return self.layout.surface("fields") if self.case(job).fields else []

    def meshed_surface(self, job: Job) -> str:
        """The surface that is meshed, and that every later stage measures against."""
        return self.layout.surface(self._last_of_surface(job))

    def inner_surfaces(self, job: Job) -> list[str]:
        """The inner surfaces of a case as S1 meshes them."""
        return self._inner(self.layout.separated(), job)

    def inner_before_separating(self, job: Job) -> list[str]:
        """The inner surfaces of a case as they are before `separate`."""
        return self._inner(self.layout.each_surface(self._last_of_surface(job)), job)

    def _inner(self, pattern: str, job: Job) -> list[str]:
        return [filled(pattern, job, region=region_wildcard(name)) for name in self.case(job).inner]

    def _last_of_surface(self, job: Job) -> str:
        """Label of the last stage that changes the surface of a case, or each of its inner ones, by itself."""
        stages = stages_of(self.config, aged=self.case(job).scan_age is not None)
        return [stage.label for stage in stages if stage.gives == "surface"][-1]

    def mesh_before(self, stage: str, job: Job) -> str:
        """The mesh of the last enabled stage before `stage`. A bypassed stage does not occur."""
        order = list(STAGES)
        meshes = [one for one in stages_of(self.setting(job)) if one.gives == "mesh"]
        earlier = [one for one in meshes if order.index(one.name) < order.index(stage)]
        return filled(self.layout.mesh(earlier[-1].label), job)

    def reports(self, job: Job) -> dict[str, str]:
        """Files of the reports of a setting's stages, by stage."""

        def report(stage: Stage) -> str:
            if stage.nested:
                return self.layout.separated("white.json")
            if stage.gives == "surface":
                return self.layout.surface(stage.label, "white.json")
            return self.layout.mesh(stage.label, "tetmesh.json")

        first = next(iter(self.case(job).inner), "")  # each report of `separate` is about all inner surfaces
        return {stage.name: filled(report(stage), job, region=region_wildcard(first)) for stage in self.line(job)}

    def inner_reports(self, job: Job) -> list[str]:
        """Files of the reports on the inner surfaces, of each stage that takes them by themselves."""
        labels = [stage.label for stage in self.line(job) if stage.each_surface]
        patterns = [self.layout.each_surface(label, "white.json") for label in labels]
        return [path for pattern in patterns for path in self._inner(pattern, job)]

    def space(self, job: Job) -> str:
        """The surface in whose space all files of a case are."""
        case = self.case(job)
        return filled(self.layout.surface("phantom"), job) if case.is_phantom else str(case.surface)

    def origin(self, label: str, job: Job) -> dict[str, Any]:
        """Origin of the record that a job writes; `label` is that of the stage that made the mesh or surface."""
        if job.get("mesher"):
            return self.origin_of_mesh(label, job["case"], int(job["res"]), job["mesher"], job.get("setting", ""))
        inner = {"inner": inner_of(job)} if inner_of(job) else {}
        return {"case": job["case"], "stage": label, **inner}

    def origin_of_mesh(self, label: str, case: str, res: int, mesher: str, setting: str = "") -> dict[str, Any]:
        """Origin of a record of a mesh."""
        name = None if label in SHARED else self.settings[setting].setting
        return {"case": case, "stage": label, "cell_size_mm": res / 1000, "mesher": mesher, "setting": name}

    # --- what jobs take ------------------------------------------------------------------------------------------

    def tets(self, job: Job) -> float:
        """Expected tetrahedra: from the volume that the gate measured, else from the age; 0 for a job on a surface."""
        if not job.get("mesher"):
            return 0
        case = self.case(job)
        try:
            gated = filled(self.layout.surface(STAGES["gate"].label, "white.json"), job)
            volume = json.loads(Path(gated).read_text(encoding="utf-8"))["volume_ml"]
        except (OSError, ValueError):
            volume = expected_volume_ml(case.scan_age, whole=case.hemi is None)
        return expected_tets(volume, int(job["res"]) / 1000, job["mesher"])

    def megabytes(self, rule: str, job: Job, attempt: int) -> int:
        """Memory that a job asks for, MB: more after each time it was killed."""
        return memory_to_ask_mb(cost(rule, job.get("mesher", "")).memory_mb(self.tets(job)), attempt)

    def minutes(self, rule: str, job: Job) -> int:
        """Time limit that a job asks for."""
        return minutes_to_ask(cost(rule, job.get("mesher", "")).cpu_seconds(self.tets(job)))


def existing(path: str | Path | None) -> str | list[str]:
    """The file if it exists: the job reports a missing file, so that other cases continue."""
    return str(path) if path and os.path.isfile(path) else []  # noqa: PTH113, false of names that are too long


def _given(path: str | Path | None, of_phantom: str) -> str | list[str]:
    """A file that the sheet names: that of the phantom, which is made, or one that exists."""
    return of_phantom if path == PHANTOM else existing(path)


def existing_of(paths: Callable[[Job], Mapping[str, str]]) -> Callable[[Job], list[str]]:
    """An input function: those files of a job that exist."""
    return lambda job: [path for path in paths(job).values() if existing(path)]


@cache
def _kind_of(path: str | Path) -> str | None:
    from cortet.formats.gifti import kind_of  # loads what most jobs do without

    try:
        return kind_of(path)
    except InputError:
        return None
