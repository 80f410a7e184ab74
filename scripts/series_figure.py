"""Meshes of several ages side by side."""

from _job import start

job = start(snakemake)

from cortet.study.series import draw_series

draw_series(job.params.brains, job.output, cell_size=job.params.h)
