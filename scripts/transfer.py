"""S2: carry the fields of the surface to the nodes of one mesh; on request write the mesh for openCARP too."""

from dataclasses import asdict, replace

from _job import start

job = start(snakemake)

from cortet.formats import carp, gifti, vtu
from cortet.formats.atomic import write_json
from cortet.measure.quality import summarise
from cortet.stages import STAGES

surface = gifti.read_nested(job.input.surface, job.input.inner, job.input.get("fields"))
mesh, report = STAGES["transfer"].run(vtu.read(job.input.mesh), surface, **job.arguments)
vtu.write(mesh, job.output.mesh)
if job.output.carp:
    carp.write(replace(mesh, point_data={}), job.output.carp[0])
write_json(job.record(asdict(report)), job.output.report)
write_json(job.record(asdict(summarise(mesh))), job.output.quality)
