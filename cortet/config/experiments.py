"""The section `experiments` of the configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from cortet.config.section import Cases, CellSize, PositiveInt, Section
from cortet.config.stages import MesherName

#: presets that differ in what follows a mesher
Compared = Literal["default", "cgal", "published"]


class Ablation(Section):
    """Effect of each stage, next to other meshers (Table 1 and Fig. 2 of the paper)."""

    cases: Cases = "all"
    """Cases at the cell sizes of `generate`: all, a number of them spread over the ages, or a list of their names."""
    further: dict[CellSize, Cases] = {}
    """Further cell sizes, mm, and the cases to mesh with each, e.g. {0.6: [sub-01_hemi-L]}."""
    meshers: list[MesherName] = []
    """Further meshers, each followed by the same S3 and S4: lattice, cgal, or with its own defaults tetgen, ftetwild,
    gmsh or netgen. If one of these four fails, the table has a row for the failure. The paper compares cgal and
    tetgen."""
    time_limit: PositiveInt = 60
    """Longest run time of tetgen, ftetwild, gmsh or netgen on one surface, minutes."""


class Resolution(Section):
    """Number and quality of elements by cell size (Table 2 of the paper)."""

    cases: Cases = 3
    """Cases: all, a number of them spread over the ages, or a list of their names."""
    cell_size: list[CellSize] = []
    """Cell sizes h, mm; empty: those of `generate`. The paper compares 0.4, 0.6 and 0.8."""


class Measures(Section):
    """Worst element by three other quality measures."""

    cases: Cases = 3
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names."""


class Series(Section):
    """Pictures of meshes at several ages, on one scale."""

    cases: Cases = 4
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names. Both
    hemispheres are drawn if the sheet has them."""


class Experiments(Section):
    """The experiments of the paper, on this cohort: `snakemake tables figures`."""

    settings: list[Compared] = []
    """Presets to compare with that of the run, from S3 on: default, cgal, published. Each runs on the meshes of its own
    mesher (so `cgal` and `published` share theirs) and on those of tetgen, ftetwild, gmsh and netgen."""
    reference_meshes: list[Path] = []
    """Tetrahedral meshes in BrainGrowth format (Tallinen) to measure next to ours."""
    ablation: Ablation = Ablation()
    resolution: Resolution = Resolution()
    measures: Measures = Measures()
    series: Series = Series()
