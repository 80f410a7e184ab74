"""One case on the common mesh: its surface, its fields, its distance to the mesh."""

from _job import start

job = start(snakemake)

from cortet.formats import gifti, vtu
from cortet.report.cohort_maps import case_map

meshed = gifti.read_nested(job.input.meshed, job.input.inner, job.input.get("fields"))
surface = case_map(gifti.read_surface(job.input.resampled), meshed, vtu.read(job.input.mesh))
gifti.write_surface(surface, job.output.maps)
