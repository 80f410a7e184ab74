"""S4: move vertices of one mesh until its worst tetrahedra are good."""

from dataclasses import asdict

from _job import parameters, snakemake

from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.stages.clean import clean

mesh, report = clean(vtu.read(snakemake.input.mesh), gifti.read_surface(snakemake.input.surface), **parameters())
vtu.write(mesh, snakemake.output.mesh)
write_json(asdict(report), snakemake.output.report)
