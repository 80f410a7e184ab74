"""Predict the later surfaces of one series in one way; a fold that stops is a result, not a failure."""

import logging
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.config import load
from cortet.folding.longitudinal import read_series
from cortet.folding.prediction import predict
from cortet.folding.prediction_tables import write_run
from cortet.folding.section import Settings
from cortet.formats.atomic import write_json
from cortet.pipeline import mesh_surface

folder, config = Path(job.output.record).parent, load(job.params.line)
settings = Settings(**job.arguments)
files = dict(zip(job.params.ages, map(Path, job.input.surfaces), strict=True))
labels = Path(job.params.files) if job.params.files else None
series = read_series(files, [*map(Path, job.input.spheres)], config.placement(), settings.hemisphere, labels)
made = mesh_surface(series.first, config, gestational_age=series.ages[0], source=job.input.surfaces[0])
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
