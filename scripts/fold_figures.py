"""Figures and film of one run."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.folding.fold_figures import draw

real = {float(age): Path(path) for age, path in job.params.files.items()}
maps = {float(week): (Path(surface), Path(values)) for week, (surface, values) in job.params.maps.items()}
draw(Path(job.input.series).parent, job.params.hemisphere, real, maps, job.params.measure)
