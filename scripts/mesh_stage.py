"""One of the stages that make a mesh, but for the last one."""

from dataclasses import asdict, replace

from _job import start

job = start(snakemake)

from cortet.formats import carp, vtu
from cortet.formats.atomic import write_json
from cortet.measure.electrodes import around_contacts
from cortet.measure.quality import summarise

state = job.state()
state, reports = job.through(state, contacts=around_contacts(job.contacts(state.surface), state.surface))
vtu.write(state.mesh, job.output.mesh)
if files := job.output.get("carp"):
    carp.write(replace(state.mesh, point_data={}), files[0])
write_json(job.record(reports[snakemake.rule]), job.output.report)
write_json(job.record(asdict(summarise(state.mesh))), job.output.quality)
