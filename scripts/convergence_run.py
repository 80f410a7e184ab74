"""Mesh and fold one realisation; a fold that stops is a result, not a failure."""

import logging
from dataclasses import asdict, replace
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.config import load
from cortet.folding.carried import carried
from cortet.folding.fold import fold
from cortet.folding.journal import SERIES, per_percent, series
from cortet.folding.section import Settings
from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.pipeline import mesh_surface
from cortet.solver_files.fields import with_fields

folder, config = Path(job.output.record).parent, load(job.params.line)
surface = with_fields(gifti.read_surface(job.input.surface, finite=not config.enabled("repair")), job.params.files)
made = mesh_surface(
    surface,
    config,
    gestational_age=job.params.age,
    source=job.input.surface,
    sphere=gifti.read_surface(job.input.sphere) if job.input.sphere else None,
    sphere_source=job.input.sphere or None,
)
verdict = fold(
    made.mesh,
    folder,
    Settings(**job.arguments),
    per_percent(logging.getLogger("cortet").info),
)
last = vtu.read(series(folder / SERIES)[-1][0])
gifti.write_surface(made.surface, job.output.start)
folded = carried(made.surface.points, made.mesh, last.points)
gifti.write_surface(replace(made.surface, points=folded), job.output.folded)
write_json(job.record(asdict(verdict)), job.output.record)
