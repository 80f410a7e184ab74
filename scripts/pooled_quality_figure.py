"""Pooled per-element quality of the meshes of one cell size."""

from _job import parameters, snakemake

from cortet.experiments import draw_pooled

draw_pooled(snakemake.input, snakemake.output, **parameters())
