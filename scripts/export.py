"""Write one mesh for a solver, with its sets and a sidecar, if it is certified."""

import json
from pathlib import Path

from _job import parameters, snakemake

from cortet.export import export
from cortet.fields import field_sources
from cortet.formats import gifti, vtu
from cortet.sets import named_sets

sources = field_sources(snakemake.params.fields, snakemake.params.units)
labels = {name: source.labels for name, source in sources.items()}
mesh = named_sets(vtu.read(snakemake.input.mesh), **snakemake.params.sets, label_names=labels)
export(
    mesh,
    Path(snakemake.output.mesh),
    certificate=json.loads(Path(snakemake.input.certificate).read_text()),
    frame=gifti.read_surface(snakemake.input.surface).frame,
    sources=sources,
    **parameters(),
)
