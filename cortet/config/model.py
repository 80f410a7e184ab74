"""The whole configuration: keys of a run, a section for each stage, and one for what comes before and after them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import field_validator

from cortet.config.fold import Fold
from cortet.config.section import Positive, Section, Setting
from cortet.config.sections import Certify, Cohort, Experiments, Export, Phantom
from cortet.config.stages import (
    Clean,
    Gate,
    Generate,
    Reconnect,
    Regions,
    Relocate,
    Repair,
    Resample,
    SmoothBoundary,
    SmoothSurface,
    Snap,
    Transfer,
)
from cortet.formats.placement import UNITS


class Config(Section):
    """The whole configuration."""

    setting: Setting = "default"
    """Preset of stage parameters: `default` (lattice mesher, no Gmsh), `folding` (the same, with fine cells in the
    cortex and coarse ones in the core), `cgal` (the paper's mesher and Gmsh, then our stages) or `published` (all
    choices of the CORTET paper). Keys below override it."""
    output: Path = Path("derivatives/cortet")
    """Output folder (BIDS derivative)."""
    keep_intermediates: bool = True
    """false deletes the mesh of every stage except the last once no later stage needs it. That saves 40 % of the disk,
    but a changed parameter of any stage then reruns all stages from S1. `snakemake --delete-temp-output` deletes the
    intermediate meshes of earlier runs."""
    time_limit: Positive | None = 1440.0
    """Longest run time of a job, minutes. A job that takes longer is stopped and its case fails. null: no limit."""
    cohort: Cohort = Cohort()
    phantom: Phantom = Phantom()
    resample: Resample = Resample()
    repair: Repair = Repair()
    gate: Gate = Gate()
    smooth_surface: SmoothSurface = SmoothSurface()
    regions: Regions = Regions()
    generate: Generate = Generate()
    transfer: Transfer = Transfer()
    relocate: Relocate = Relocate()
    clean: Clean = Clean()
    reconnect: Reconnect = Reconnect()
    smooth_boundary: SmoothBoundary = SmoothBoundary()
    snap: Snap = Snap()
    certify: Certify = Certify()
    export: Export = Export()
    fold: Fold = Fold()
    experiments: Experiments = Experiments()

    @field_validator("output")
    @classmethod
    def _without_braces(cls, output: Path) -> Path:
        if {"{", "}"} & set(str(output)):
            raise ValueError("braces in the name of the output folder are wildcards to Snakemake: use another name")
        return output

    @property
    def target(self) -> float | None:
        """Worst q at which the line stops to improve a mesh; None without S4+, which alone reaches it."""
        return self.reconnect.threshold if self.reconnect.enabled else None

    def enabled(self, stage: str) -> bool:
        """Whether the line contains `stage`."""
        return bool(getattr(getattr(self, stage, None), "enabled", True))

    def export_arguments(self, solver: str) -> dict[str, Any]:
        """Arguments of `export` for one format, plain values."""
        export = self.export
        return {"solver": solver, "uncertified": export.uncertified, "unit": export.carp_unit}

    def placement(self, unit: str | None = None) -> float | None:
        """Factor from stored coordinates to mm; None if nobody states their unit, which is then mm.

        Parameters
        ----------
        unit : of one case; None: as `gate.unit` says
        """
        named = unit or self.gate.unit
        return None if named is None else UNITS[named]
