"""Let one surface in, or refuse it."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.errors import InputError
from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.stages.gate import gate

if not job.input:
    raise InputError(
        "no such file",
        file=job.arguments["source"],
        remedy=f"mend the column {'inner' if job.arguments.get('inside') else 'surface'} of the cohort sheet",
    )
surface, report = gate(gifti.read_surface(job.input.surface), **job.arguments)
gifti.write_surface(surface, job.output.surface)
write_json(job.record(asdict(report)), job.output.report)
