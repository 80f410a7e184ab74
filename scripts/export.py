"""Write one mesh for a solver, with its sets and a sidecar, if it is certified."""

import json
from pathlib import Path

from _job import start

job = start(snakemake)

import numpy as np

from cortet.formats import gifti, vtu
from cortet.formats.volumes import label_names, volume_file
from cortet.meshes import OUTERMOST
from cortet.solver_files.export import export
from cortet.solver_files.fields import field_sources
from cortet.solver_files.meshed import made_from
from cortet.solver_files.sets import named_sets
from cortet.solver_files.volumes import sources as sources_of_volumes

sources = field_sources(job.params.paths, job.params.units)
job.require_unchanged_input()
labels = {name: source.labels for name, source in sources.items()}
surface = gifti.read_nested(job.input.surface, job.input.inner)
mesh = vtu.read(job.input.mesh)
tissues = {
    name: label_names(volume_file(file))
    for name, file in job.params.volumes.items()
    if np.issubdtype(mesh.cell_data[name].dtype, np.integer)
}
names = labels | tissues
mesh = named_sets(mesh, **job.params.sets, label_names=names, inner=list(surface.inner), tissues=tissues)
certificate = json.loads(Path(job.input.certificate).read_text(encoding="utf-8"))
inner = dict(zip(job.params.inner, map(Path, job.input.inner), strict=True))
target = Path(job.output.mesh)
export(
    mesh,
    target,
    certificate=certificate,
    made_from={
        **made_from({OUTERMOST: Path(job.input.surface)} | inner, job.params.given, target.parent),
        **({"volumes": sources_of_volumes(job.params.volumes)} if job.params.volumes else {}),
    },
    frame=surface.frame,
    sources=sources,
    **job.arguments,
)
