"""Smooth one surface by its age."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.stages import STAGES

surface, report = STAGES["smooth_surface"].run(gifti.read_surface(job.input.surface), **job.arguments)
gifti.write_surface(surface, job.output.surface)
write_json(job.record(asdict(report)), job.output.report)
