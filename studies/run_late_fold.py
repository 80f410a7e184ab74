"""Mesh a surface, fold it with one set of changes, and measure the fold by week."""

import json
import time
from pathlib import Path

import numpy as np
from carried import carried
from late import measured, undulation

import cortet
from cortet.folding.fold import SAME_AGE
from cortet.folding.fold_views import simulated_brain
from cortet.folding.journal import SERIES, series
from cortet.folding.measures import weeks_of
from cortet.formats import vtu
from cortet.formats.gifti import read_surface

of, output, params = snakemake.wildcards, snakemake.output, snakemake.params
changes = dict(params.changes)
surface = read_surface(params.brain["surface"])
fields = {}
if waves := changes.pop("undulation", None):
    fields["thickness"] = undulation(surface, **waves)
size = int(of.res) / 1000
made = cortet.mesh(
    surface,
    size,
    ga=params.brain["ga"],
    hemi=params.brain.get("hemi"),
    fields=fields or None,
    settings={**params.settings, "generate": {**params.settings.get("generate", {}), **changes.pop("generate", {})}},
    progress=False,
)
folder = Path(output.record).parent
began = time.process_time()
weeks = weeks_of(params.weeks, params.brain["ga"], max(params.weeks))
fold = {**params.settings.get("fold", {}), **changes, "end": max(weeks), "surfaces": weeks}  # frames of these weeks
folded = cortet.fold(made, folder=folder, progress=False, **fold)
seconds = time.process_time() - began
frames = series(folder / SERIES)
of_weeks = {week: path for week in weeks for path, age in frames if abs(age - week) < SAME_AGE}
rows = [{"week": week, **measured(simulated_brain(path))} for week, path in of_weeks.items()]
positions = [carried(surface.points, made.mesh, vtu.read(path).points) for path in of_weeks.values()]
np.savez(output.carried, start=surface.points, faces=surface.faces, points=np.array(positions, np.float32))
facts = {"brain": of.name, "kind": of.lever, "cell_size_mm": size, "tets": len(made.mesh.cells), "cpu_s": seconds}
record = {"of": facts, "verdict": folded.verdict, "rows": rows}
Path(output.record).write_text(json.dumps(record), encoding="utf-8")
