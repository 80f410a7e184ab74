"""Move the inner surfaces of one case inward, and write one of them."""

from _job import start

job = start(snakemake)

from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.stages.stage import State

state, reports = job.through(State(gifti.read_nested(job.input.surface, job.input.inner)))
gifti.write_surface(state.surface.inner[job.params.inner], job.output.surface)
write_json(job.record(reports["separate"]), job.output.report)
