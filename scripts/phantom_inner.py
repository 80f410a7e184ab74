"""A synthetic white surface within the cortex of the case."""

from _job import start

job = start(snakemake)

from cortet.formats.gifti import read_surface, write_surface
from cortet.phantoms import inset

write_surface(inset(read_surface(job.input.surface), **job.params.arguments), job.output.surface)
