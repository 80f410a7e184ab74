"""Predict the later surfaces of one series in one way; a fold that stops is a result, not a failure."""

import json
from pathlib import Path

from prediction import predict
from prediction_tables import error_views, prediction_views, write_run
from series import read_series

import cortet
from cortet.config import load
from cortet.config.fold import Settings
from cortet.report.figures import save

given, output, params = snakemake.input, snakemake.output, snakemake.params
files = dict(zip(params.ages, map(Path, given.surfaces), strict=True))
labels = Path(given.labels) if given.labels else None
series = read_series(files, [*map(Path, given.spheres)], params.hemi, labels)
made = cortet.mesh(
    series.first,
    params.cell_size,
    ga=series.ages[0],
    hemi=params.hemi,
    settings=params.settings,
    progress=False,
)
fold = load({"fold": params.settings.get("fold", {})})
facts = {"gestational_age": series.ages[0], "hemisphere": params.hemi}
folder = Path(output.record).parent
prediction = predict(
    series,
    made.mesh,
    snakemake.wildcards.kind,
    folder,
    settings=Settings(**fold.fold.values(), **facts),
    say=print,
    **params.options,
)
record = {"series": snakemake.wildcards.name, **write_run(prediction, series, folder)}
Path(output.record).write_text(json.dumps(record), encoding="utf-8")
save(prediction_views(series, prediction.points, params.hemi), Path(output.picture))
save(error_views(series, prediction.points, params.hemi), Path(output.errors))
