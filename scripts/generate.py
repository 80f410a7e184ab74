"""S1: fill one surface with tetrahedra."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.measure.quality import summarise
from cortet.stages import STAGES

surface = gifti.read_nested(job.input.surface, job.input.inner, job.input.get("fields"))
mesh, report = STAGES["generate"].run(surface, **job.arguments)
vtu.write(mesh, job.output.mesh)
write_json(job.record(asdict(report)), job.output.report)
write_json(job.record(asdict(summarise(mesh))), job.output.quality)
