"""Figures and film of one run."""

from pathlib import Path

from _job import snakemake

from cortet.simulation.fold_figures import draw

draw(Path(snakemake.input.series).parent, snakemake.params.hemisphere)
