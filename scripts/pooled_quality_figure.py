"""Pooled per-element quality of the meshes of one cell size."""

from _job import start

job = start(snakemake)

from cortet.report.ablation import draw_pooled

draw_pooled(job.input, job.output, **job.arguments)
