"""S5: carry the fields onto the final positions of one mesh and number its nodes as solvers want them."""

from dataclasses import asdict, replace

from _job import parameters, snakemake

from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.stages.solver_ready import solver_ready
from cortet.stages.transfer import transfer

surface = gifti.read_surface(snakemake.input.surface)
if snakemake.input.fields:
    surface = replace(surface, point_data=gifti.read_surface(snakemake.input.fields).point_data)
mesh, _ = transfer(vtu.read(snakemake.input.mesh), surface, **parameters())
mesh, report = solver_ready(mesh)
vtu.write(mesh, snakemake.output.mesh)
write_json(asdict(report), snakemake.output.report)
