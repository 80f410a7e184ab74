"""S6: put the boundary of one mesh back onto the surface."""

from dataclasses import asdict

from _job import parameters, snakemake

from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.stages.snap import snap

mesh, report = snap(vtu.read(snakemake.input.mesh), gifti.read_surface(snakemake.input.surface), **parameters())
vtu.write(mesh, snakemake.output.mesh)
write_json(asdict(report), snakemake.output.report)
