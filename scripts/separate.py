"""Move the inner surfaces of one case inward, and write one of them."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.stages import STAGES

surface, report = STAGES["separate"].run(gifti.read_nested(job.input.surface, job.input.inner), **job.arguments)
gifti.write_surface(surface.inner[job.params.inner], job.output.surface)
write_json(job.record(asdict(report)), job.output.report)
