"""S4+: reconnect the tetrahedra of one mesh that moving vertices cannot improve."""

from dataclasses import asdict

from _job import parameters, snakemake

from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.stages.reconnect import reconnect

mesh, report = reconnect(vtu.read(snakemake.input.mesh), gifti.read_surface(snakemake.input.surface), **parameters())
vtu.write(mesh, snakemake.output.mesh)
write_json(asdict(report), snakemake.output.report)
