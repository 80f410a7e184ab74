"""Write one mesh for a solver, with its sets and a sidecar, if it is certified."""

import json
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.formats import gifti, vtu
from cortet.solver_files.export import export
from cortet.solver_files.fields import field_sources
from cortet.solver_files.sets import named_sets

sources = field_sources(job.params.fields, job.params.units)
labels = {name: source.labels for name, source in sources.items()}
surface = gifti.read_nested(job.input.surface, job.input.inner)
mesh = named_sets(vtu.read(job.input.mesh), **job.params.sets, label_names=labels, inner=list(surface.inner))
export(
    mesh,
    Path(job.output.mesh),
    certificate=json.loads(Path(job.input.certificate).read_text()),
    frame=surface.frame,
    sources=sources,
    **job.arguments,
)
