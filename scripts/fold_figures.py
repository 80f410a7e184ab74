"""Figures and film of one run."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.report.fold_figures import draw

draw(Path(job.input.series).parent, job.params.hemisphere)
