"""Put one surface onto the common mesh, through its sphere."""

from dataclasses import asdict

from _job import start

job = start(snakemake)

from cortet.cohort.user_files import missing_surface, require_hemisphere
from cortet.formats import gifti
from cortet.formats.atomic import write_json
from cortet.formats.placement import placed
from cortet.stages import STAGES

if not job.input.surface:
    raise missing_surface(job.params.source, column=job.params.column)
if not job.input.sphere:
    raise missing_surface(job.arguments["sphere_file"], column="sphere")
for file in (job.input.surface, job.input.sphere):
    require_hemisphere(file, job.params.hemi)
gifti.require_anatomical(job.input.surface)
surface = placed(gifti.read_surface(job.input.surface), job.params.to_mm)
surface, report = STAGES["resample"].run(surface, gifti.read_surface(job.input.sphere), **job.arguments)
gifti.write_surface(surface, job.output.surface)
write_json(job.record(asdict(report)), job.output.report)
