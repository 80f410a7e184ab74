"""The per-vertex fields of a case on the vertices that the gate lets in."""

from _job import start

job = start(snakemake)

from cortet.formats import gifti
from cortet.formats.placement import placed
from cortet.solver_files.fields import with_fields
from cortet.stages import STAGES

repairs = job.params.repair is not None
surface = with_fields(gifti.read_surface(job.input.surface, finite=not repairs), job.params.files)
surface = placed(surface, job.params.to_mm)
if job.input.sphere:
    sphere = gifti.read_surface(job.input.sphere)
    surface, _ = STAGES["resample"].run(surface, sphere, **job.params.resample, sphere_file=job.input.sphere)
if repairs:
    surface, _ = STAGES["repair"].run(surface, **job.params.repair, source=job.input.surface)
surface, _ = STAGES["gate"].run(surface, **job.arguments)
job.require_unchanged_input()
gifti.write_surface(surface, job.output.surface)
