"""S3: move the nodes of one mesh to better places."""

from dataclasses import asdict

from _job import parameters, snakemake

from cortet.formats import vtu
from cortet.formats.atomic import write_json
from cortet.stages.relocate import relocate

mesh, report = relocate(vtu.read(snakemake.input.mesh), **parameters())
vtu.write(mesh, snakemake.output.mesh)
write_json(asdict(report), snakemake.output.report)
