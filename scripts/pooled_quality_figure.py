"""Pooled per-element quality of the meshes of one cell size."""

from _job import start

job = start(snakemake)

from cortet.study.pooled_quality import draw_pooled

draw_pooled(job.input, job.output, **job.arguments)
