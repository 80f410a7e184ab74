"""S2: carry the fields of the surface to the nodes of one mesh; write the mesh for openCARP too."""

from dataclasses import asdict, replace

from _job import parameters, snakemake

from cortet.formats import carp, gifti, vtu
from cortet.formats.atomic import write_json
from cortet.stages.transfer import transfer

surface = gifti.read_surface(snakemake.input.surface)
if snakemake.input.fields:
    surface = replace(surface, point_data=gifti.read_surface(snakemake.input.fields).point_data)
mesh, report = transfer(vtu.read(snakemake.input.mesh), surface, **parameters())
vtu.write(mesh, snakemake.output.mesh)
carp.write(replace(mesh, point_data={}), snakemake.output.carp[0])
write_json(asdict(report), snakemake.output.report)
