"""The whole configuration: what stages and meshers declare, composed with the sections around the line."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import create_model, field_validator

from cortet.config.sections import Cohort, Export, Figures, Phantom, Quality
from cortet.errors import InputError
from cortet.formats import require_holes
from cortet.formats.placement import matrix
from cortet.measure.limits import Certify
from cortet.meshers import MESHERS
from cortet.neighbours import neighbours
from cortet.sections import Positive, Section, Setting
from cortet.stages import STAGES, Stage
from cortet.stages.stage import Step

_PACKAGE = Path(__file__).parents[1]

#: steps that have arguments or a version and are not stages of the line
STEPS: dict[str, Step] = {
    "phantom": Step("phantoms", "phantom", frozenset({"subdivisions", "seed"}), ("gestational_age", "hemisphere")),
    "phantom_inner": Step("phantoms", "phantom", frozenset({"thickness"})),
    "quality": Step("measure.quality", "quality"),
    "certify": Step("measure.certify", "certify", facts=("cell_size",)),
    "export": Step("solver_files.export", "export"),
}
STEPS |= {name: stage.step for name, stage in STAGES.items()}
STEPS |= {name: step for neighbour in neighbours() for name, step in neighbour.steps().items()}


class _BeforeTheLine(Section):
    setting: Setting = "default"
    """Named set of stage parameters: `default` (ours: lattice mesher, no Gmsh), `cgal` (the paper's mesher and Gmsh,
    then ours) or `published` (the CORTET paper's). Keys below override it."""
    output: Path = Path("derivatives/cortet")
    """Folder of everything that is made (BIDS derivative)."""
    keep_intermediates: bool = True
    """false deletes the mesh of every stage but the last as soon as nothing needs it any more. That saves 40 % of the
    disk, but a changed parameter of any stage runs the line from S1 on. `snakemake --delete-temp-output` deletes those
    of earlier runs."""
    write_carp: bool = False
    """true also writes the mesh of S2 as CARP files (.pts, .elem, .lon; um), as the published chain does. For those of
    the final mesh: `export.formats: [carp]`."""
    time_limit: Positive | None = 1440.0
    """Minutes a job may take before it is ended and its case has failed; null: no limit."""
    cohort: Cohort = Cohort()
    phantom: Phantom = Phantom()

    @field_validator("output")
    @classmethod
    def _without_braces(cls, output: Path) -> Path:
        if {"{", "}"} & set(str(output)):
            raise ValueError("braces in the name of the output folder are wildcards to Snakemake: use another name")
        return output


if TYPE_CHECKING:
    from cortet.geometry.label_surface import Handles

    class _WithTheLine(_BeforeTheLine):
        def __getattr__(self, section: str) -> Any: ...  # and of a neighbour

else:  # a section for each stage that declares one, in the order of the line
    _WithTheLine = create_model(
        "_WithTheLine",
        __base__=_BeforeTheLine,
        **{stage.section or stage.name: (stage.parameters, stage.parameters()) for stage in STAGES.values()},
    )


class _AfterTheLine(_WithTheLine):
    certify: Certify = Certify()
    quality: Quality = Quality()
    export: Export = Export()
    figures: Figures = Figures()


def _with_sections(model: type[Section], sections: Mapping[str, type[Section]]) -> type[Section]:
    """A model with further sections; the name of one within another holds a point."""
    own: dict[str, Any] = {}
    for name in dict.fromkeys(name.partition(".")[0] for name in sections):
        inner = {key.partition(".")[2]: kind for key, kind in sections.items() if key.startswith(f"{name}.")}
        section = _with_sections(sections.get(name, Section), inner) if inner else sections[name]
        own[name] = (section, section())
    return create_model(f"_With_{'_'.join(own)}", __base__=model, __doc__=model.__doc__, **own)


if TYPE_CHECKING:
    _WithNeighbours = _AfterTheLine
else:
    _WithNeighbours = _with_sections(
        _AfterTheLine, {name: kind for neighbour in neighbours() for name, kind in neighbour.sections().items()}
    )


class Config(_WithNeighbours):
    """The whole configuration."""

    def section_of(self, stage: Stage) -> Section:
        """The section of a stage, which may be that of another stage."""
        section: Section = getattr(self, stage.section or stage.name)
        return section

    @property
    def target(self) -> float | None:
        """Worst q at which the line stops to improve a mesh; None without S4+, which alone reaches it."""
        return float(self.reconnect.threshold) if self.enabled("reconnect") else None

    def enabled(self, stage: str) -> bool:
        """Whether the line of stages contains `stage`."""
        return bool(getattr(getattr(self, stage, None), "enabled", True))

    def handles(self) -> Handles:
        """What is done about handles of labels, which are mended on the voxels: nothing if `repair` is off."""
        from cortet.geometry.label_surface import AS_THEY_ARE, Handles

        if not self.enabled("repair"):
            return AS_THEY_ARE
        return Handles(self.gate.allow_genus, self.repair.max_volume_change)

    def line(self, *, nested: bool = False, registered: bool = False, aged: bool = True) -> list[Stage]:
        """The stages that run, in order.

        Parameters
        ----------
        nested : whether the surface has inner ones
        registered : whether it has a sphere
        aged : whether its age is known
        """
        return [
            stage
            for stage in STAGES.values()
            if self.section_of(stage).runs(aged=aged)
            and (nested or not stage.nested)
            and (registered or not stage.registered)
        ]

    def require_programs(self) -> None:
        """Raise InputError naming a program that the line calls and that is not installed."""
        for stage in self.line():
            for program, instead in self.section_of(stage).programs().items():
                if shutil.which(program) is None:
                    raise InputError(
                        f"the program {program} is not installed", remedy=f"put it on the PATH, or set {instead}"
                    )

    def require_nesting(self, nested: bool) -> None:
        """Raise InputError if there are inner surfaces and a mesher or a stage knows no interfaces."""
        for stage in self.line(nested=True) if nested else []:
            if key := self.section_of(stage).excludes_inner_surfaces():
                raise InputError(
                    f"{key} does not support inner surfaces",
                    remedy="use the setting `default` for cases that have some",
                )

    def require_workflow(self) -> None:
        """Raise InputError for settings that a single mesh may have but a cohort may not."""
        from cortet.formats.volumes import is_volume

        if volumes := [name for name in self.generate.sizes if is_volume(name)]:
            raise InputError(
                f"generate.sizes: {volumes[0]} is a volume, and all cases would have the same",
                remedy="name regions, or mesh each case with `cortet mesh`",
            )
        if self.export.holes and self.export.ten_nodes:
            raise InputError("export.ten_nodes knows no export.holes", remedy="leave one of the two out")
        for solver in self.export.formats:
            require_holes(self.export.holes, solver)

    def notices(self) -> list[str]:
        """What a user should know before the line runs, in plain words."""
        said = (MESHERS[name].notice(self.generate) for name in self.generate.meshers)
        return [notice for notice in said if notice]

    def arguments(self, step: str, facts: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Plain, JSON-able arguments of a stage (`Stage.run`), or of another step of the workflow.

        Parameters
        ----------
        step : a key of `STEPS`
        facts : what is known about the requested mesh, by the names that the step declares
        """
        return STEPS[step].arguments(self, facts or {})

    def export_arguments(self, solver: str) -> dict[str, Any]:
        """Arguments of `export` for one format, plain values."""
        export = self.export
        return {
            "solver": solver,
            "uncertified": export.uncertified,
            "unit": export.carp_unit,
            "holes": export.holes,
            "map": export.map,
            "interior": self.transfer.interior,
        }

    def placement(
        self, unit: str | None = None, affine: str | Path | None = None
    ) -> tuple[tuple[float, ...], ...] | None:
        """Matrix that maps stored coordinates to mm (`formats.placement.matrix`); None if they are mm.

        Parameters
        ----------
        unit, affine : of one case; None: as `gate.unit` and `gate.affine` say
        """
        return matrix(unit or self.gate.unit, affine or self.gate.affine)

    def record(self, step: str, facts: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The arguments of a step and the version of its code, as certificates record them."""
        placement = (facts or {}).get("placement") if step == "gate" else None
        return {
            **self.arguments(step, facts),
            **({"to_mm": placement} if placement else {}),
            "version": version_of(STEPS[step].module),
        }


@cache
def version_of(module: str) -> int:
    """`VERSION` of a module of cortet (`stages.clean`), read from its source: importing it would load Numba or Gmsh."""
    path = _PACKAGE.joinpath(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if found := re.search(r"^VERSION: int = (\d+)$", path.read_text(encoding="utf-8"), re.MULTILINE):
        return int(found[1])
    raise LookupError(f"{path} declares no VERSION")
