"""The per-vertex fields of a case on the vertices that the gate lets in."""

from _job import start

job = start(snakemake)

from cortet.formats import gifti
from cortet.solver_files.fields import with_fields
from cortet.stages.gate import gate

surface = with_fields(gifti.read_surface(job.input.surface), job.params.files)
surface, _ = gate(surface, **job.arguments)
gifti.write_surface(surface, job.output.surface)
