"""Predict the later surfaces of one series in one way; a fold that stops is a result, not a failure."""

import logging
from pathlib import Path

from _job import start

job = start(snakemake)

import numpy as np

from cortet.config import load
from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.formats.placement import placed
from cortet.measure.surface_growth import through_spheres
from cortet.pipeline import mesh_surface
from cortet.simulation.state import Settings
from cortet.study.prediction import cortex_of, predict, series_of, write_run

folder, config = Path(job.output.record).parent, load(job.params.line)
surfaces = [placed(gifti.read_surface(path), config.placement()) for path in job.input.surfaces]
spheres = [gifti.read_surface(path) for path in job.input.spheres]
if spheres and any(not np.array_equal(surface.faces, surfaces[0].faces) for surface in surfaces):
    surfaces = [through_spheres(surface, sphere, spheres[0]) for surface, sphere in zip(surfaces, spheres, strict=True)]
settings, first = Settings(**job.arguments), surfaces[0]
by_age = dict(zip(job.params.ages, surfaces, strict=True))
series = series_of(by_age, cortex_of(first, settings.hemisphere), spheres[0] if spheres else None)
made = mesh_surface(first, config, gestational_age=min(by_age), source=job.input.surfaces[0])
prediction = predict(
    series,
    made.mesh,
    job.wildcards.kind,
    folder,
    settings=settings,
    say=logging.getLogger("cortet").info,
    **job.params.options,
)
write_json(job.record({"series": job.wildcards.case, **write_run(prediction, series, folder)}), job.output.record)
