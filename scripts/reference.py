"""Element quality of one reference mesh."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.formats import braingrowth
from cortet.formats.atomic import write_json
from cortet.measure.quality import summarise

write_json(job.record(asdict(summarise(braingrowth.read(job.input.mesh)))), job.output.record)
