"""What a run is asked for: its configuration, its cases, its meshes, and the names of their files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cortet.cohort.layout import LABELS, SHARED, Layout
from cortet.cohort.selection import ageless_notice
from cortet.cohort.sheet import Case
from cortet.config import Config
from cortet.formats.certificates import OF_SOLVERS, OF_UNCERTIFIED
from cortet.formats.ownership import json_of
from cortet.stages import stages_of

#: a mesh of the line: name of its case, cell size in µm, mesher
Mesh = tuple[str, int, str]

#: stages of the table of stages
_TABLED = ("generate", "relocate", "clean", "solver_ready")


@dataclass(frozen=True)
class Plan:
    """What a run is asked for. `Sources`, `Inputs` and `Jobs` say what its jobs read, `States` what became of it."""

    #: configuration of each setting, by its addition to file names; the line's own adds nothing
    settings: Mapping[str, Config]
    #: rows of the sheet, excluded ones too
    sheet: Sequence[Case]
    #: output of a checkpoint of Snakemake, by its rule and wildcards, for which a run waits; None: as it lies there
    waited_for: Callable[..., str] | None = None
    #: names of the cases that a run is asked for; None: all
    chosen: frozenset[str] | None = None

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

    def certificate(self, mesh: Mesh) -> Path:
        """The certificate of a mesh, whether or not it is there."""
        return Path(self.file(self.layout.certificate, mesh))

    def exports(self, mesh: Mesh) -> list[Path]:
        """Files of a mesh for solvers that are asked for."""
        export, label = self.config.export, self.label_of_exports(mesh)
        patterns = self.layout.solver_files(export.formats, export.ten_nodes, label)
        return [Path(self.file(pattern, mesh)) for pattern in patterns]

    def label_of_exports(self, mesh: Mesh) -> str:
        """What the names of files for solvers say of their mesh; a run waits for the verdict if it exports any mesh."""
        if not self.config.export.uncertified:
            return OF_SOLVERS
        if self.waited_for:
            self.waited_for("verdict", **self.job(mesh))
        certificate = json_of(self.certificate(mesh))  # an edited one is refused by the export
        return OF_SOLVERS if certificate.get("certified", True) else OF_UNCERTIFIED

    def final_files(self, mesh: Mesh) -> dict[str, str]:
        """The last mesh, its report, files for solvers and sidecars -> the rule of each, which makes a deleted one."""
        label = LABELS["solver_ready"]
        last = [self.file(one, mesh) for one in (self.layout.mesh(label), self.layout.mesh(label, "tetmesh.json"))]
        exports = [*map(str, self.exports(mesh))]
        exports += [f"{path}.json" for path in exports if "_tennodes." not in path]
        return dict.fromkeys(last, "solver_ready") | dict.fromkeys(exports, "export")

    def solver_files(self) -> list[str]:
        """Last meshes, files for solvers with their sidecars, and certificates of all meshes."""
        final = [path for mesh in self.meshes() for path in self.final_files(mesh)]
        return [*final, *self.each_case(self.layout.certificate).values()]

    def quality_records(self, meshes: Sequence[Mesh]) -> list[str]:
        """Quality records of some meshes, stage by stage, as the table of stages shows them."""
        labels = [LABELS[stage] for stage in _TABLED if self.config.enabled(stage)]
        return [self.file(self.layout.mesh(label, "quality.json"), mesh) for mesh in meshes for label in labels]

    @property
    def has_volumes(self) -> bool:
        """Whether any case has volumes."""
        return any(case.volumes for case in self.cases.values())

    def mapped(self, hemi: str) -> list[str]:
        """Cases of a hemisphere that are resampled onto the common mesh."""
        resamples = self.config.enabled("resample")
        return [name for name, case in self.cases.items() if case.hemi == hemi and resamples and case.sphere]

    def described(self, mesh: Mesh) -> dict[str, Any]:
        """Case, age, hemisphere, cell size and mesher of a mesh."""
        name, res, mesher = mesh
        case = self.cases[name]
        of_case = {"case": name, "scan_age": case.scan_age, "hemi": case.hemi}
        return {**of_case, "cell_size_mm": res / 1000, "mesher": mesher}

    def notices(self) -> list[str]:
        """What is not done with the cases of unknown age, in plain words; those to be folded by name need one."""
        asked = self.config.fold.cases
        smoothed = stages_of(self.config) != stages_of(self.config, aged=False)
        return ageless_notice([*self.cases.values()], smoothed=smoothed, folded=isinstance(asked, (str, int)))

    def origin_of_mesh(self, label: str, case: str, res: int, mesher: str, setting: str = "") -> dict[str, Any]:
        """Origin of a record of a mesh."""
        name = None if label in SHARED else self.settings[setting].setting
        return {"case": case, "stage": label, "cell_size_mm": res / 1000, "mesher": mesher, "setting": name}

    def maps(self, hemi: str) -> dict[Mesh, str]:
        """Maps of the cases of a hemisphere that are resampled, for the first cell size and the first mesher."""
        first = [
            (name, self.resolutions_of(self.cases[name])[0], self.config.generate.meshers[0])
            for name in self.mapped(hemi)
        ]
        pattern = self.layout.mesh("Solver", "maps.surf.gii")
        return {mesh: self.file(pattern, mesh) for mesh in first if mesh in self.meshes()}

    def files_of_cases(self) -> list[str]:
        """All files of single cases that a whole run makes, without those of folds."""
        return [
            *self.solver_files(),
            *self.quality_records(self.meshes()),
            *self.each_case(self.layout.case_page).values(),
            *(path for hemi in "LR" for path in self.maps(hemi).values()),
        ]
