"""Write one mesh for a solver, with its sets and a sidecar, if it is certified."""

import json
from pathlib import Path

from _job import start

job = start(snakemake)

from cortet.formats import gifti, vtu
from cortet.meshes import OUTERMOST
from cortet.solver_files.export import export
from cortet.solver_files.fields import field_sources
from cortet.solver_files.meshed import made_from
from cortet.solver_files.sets import named_sets

sources = field_sources(job.params.paths, job.params.units)
job.require_unchanged_input()
labels = {name: source.labels for name, source in sources.items()}
surface = gifti.read_nested(job.input.surface, job.input.inner)
mesh = named_sets(vtu.read(job.input.mesh), **job.params.sets, label_names=labels, inner=list(surface.inner))
certificate = json.loads(Path(job.input.certificate).read_text(encoding="utf-8"))
inner = dict(zip(job.params.inner, map(Path, job.input.inner), strict=True))
target = Path(job.output.mesh)
export(
    mesh,
    target,
    certificate=certificate,
    made_from=made_from({OUTERMOST: Path(job.input.surface)} | inner, job.params.given, target.parent),
    frame=surface.frame,
    sources=sources,
    **job.arguments,
)
