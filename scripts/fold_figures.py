"""Figures and film of one run."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.folding.fold_figures import draw

real = {float(age): Path(path) for age, path in job.params.files.items()}
draw(Path(job.input.series).parent, job.params.hemisphere, real)
