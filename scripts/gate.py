"""Repair one surface where it must be, and let it in, or refuse it."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.cohort.user_files import missing_surface, require_hemisphere
from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.formats.placement import placed
from cortet.stages import STAGES

source, repairs = job.arguments["source"], job.params.repair is not None
if not job.input.surface:
    raise missing_surface(source, column=job.params.column)
require_hemisphere(job.input.surface, job.params.hemi)
gifti.require_anatomical(job.input.surface)
surface = placed(gifti.read_surface(job.input.surface, finite=not repairs), job.params.to_mm)
if repairs:
    surface, done = STAGES["repair"].run(surface, **job.params.repair, source=source)
surface, report = STAGES["gate"].run(surface, **job.arguments)
if repairs:
    record = job.record(asdict(done))
    write_json({**record, "origin": {**record["origin"], "stage": STAGES["repair"].label}}, job.output.repair)
gifti.write_surface(surface, job.output.surface)
write_json(job.record(asdict(report)), job.output.report)
