"""The section `experiments` of the configuration."""

from __future__ import annotations

from pathlib import Path

from cortet.config.section import Cases, CellSize, PositiveInt, Section, Setting
from cortet.config.stages import MesherName


class Ablation(Section):
    """What each stage does (the paper's Table 1, and the pooled quality of its Fig. 2), beside other meshers."""

    cases: Cases = "all"
    """Cases at the cell sizes of `generate`: all, a number of them spread over the ages, or a list of their names."""
    further: dict[CellSize, Cases] = {}
    """Further cell sizes, mm, and the cases that are meshed with each, e.g. {0.6: [sub-01_hemi-L]}."""
    meshers: list[MesherName] = []
    """Further meshers, through the same S3 and S4: lattice, cgal, or with its own defaults one of tetgen, ftetwild,
    gmsh and netgen. Where one of these four fails, a row of the table says so. The paper compares cgal and tetgen."""
    time_limit: PositiveInt = 60
    """Minutes that tetgen, ftetwild, gmsh or netgen may take for one surface."""


class Resolution(Section):
    """Element count and quality against the cell size (the paper's Table 2)."""

    cases: Cases = 3
    """Cases: all, a number of them spread over the ages, or a list of their names."""
    cell_size: list[CellSize] = []
    """Cell sizes h, mm; empty: those of `generate`. The paper compares 0.4, 0.6 and 0.8."""


class Measures(Section):
    """Worst element by three further measures of the literature."""

    cases: Cases = 3
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names."""


class Series(Section):
    """Pictures of meshes over the ages, on one scale."""

    cases: Cases = 4
    """Cases at the first cell size of `generate`: all, a number of them spread over the ages, or their names. Both
    hemispheres are drawn where the sheet has them."""


class Experiments(Section):
    """The experiments of the paper, on this cohort: `snakemake tables figures`."""

    settings: list[Setting] = []
    """Settings to compare with that of the run, from S3 on: default, cgal, published. Each is run on the meshes of its
    own mesher, so `cgal` and `published` on the same ones, and on those of tetgen, ftetwild, gmsh and netgen."""
    reference_meshes: list[Path] = []
    """Tetrahedral meshes in the format of BrainGrowth (Tallinen), measured beside ours."""
    ablation: Ablation = Ablation()
    resolution: Resolution = Resolution()
    measures: Measures = Measures()
    series: Series = Series()
