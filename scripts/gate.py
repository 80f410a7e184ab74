"""Let one surface in, or refuse it."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.cohort.surface_files import missing_surface, require_hemisphere
from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.formats.placement import placed
from cortet.stages import STAGES

if not job.input.surface:
    raise missing_surface(job.arguments["source"], column="inner" if job.arguments.get("inside") else "surface")
require_hemisphere(job.input.surface, job.params.hemi)
surface = placed(gifti.read_surface(job.input.surface), job.to_mm)
surface, report = STAGES["gate"].run(surface, **job.arguments)
gifti.write_surface(surface, job.output.surface)
write_json(job.record(asdict(report)), job.output.report)
