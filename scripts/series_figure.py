"""Meshes of several ages side by side."""

from _job import snakemake

from cortet.series import draw_series

draw_series(snakemake.params.brains, snakemake.output)
