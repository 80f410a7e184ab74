"""S1: fill one surface with tetrahedra."""

from dataclasses import asdict

from _job import parameters, snakemake

from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.stages.generate import generate

mesh, report = generate(gifti.read_surface(snakemake.input.surface), **parameters())
vtu.write(mesh, snakemake.output.mesh)
write_json(asdict(report), snakemake.output.report)
