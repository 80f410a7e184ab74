"""Pictures of one prediction beside the real brains."""

from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.folding.longitudinal import read_series
from cortet.folding.prediction_tables import error_views, predicted_surfaces, prediction_views
from cortet.report.figures import save

files = dict(zip(job.params.ages, map(Path, job.input.surfaces), strict=True))
hemisphere = job.params.hemisphere
series = read_series(files, [*map(Path, job.input.spheres)], job.params.placement, hemisphere)
points = predicted_surfaces(Path(job.input.record).parent)
save(prediction_views(series, points, hemisphere), Path(job.output.picture))
save(error_views(series, points, hemisphere), Path(job.output.errors))
