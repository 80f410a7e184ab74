"""A synthetic cortex of the case's age."""

from _job import start

job = start(snakemake)

from cortet.formats.gifti import write_surface
from cortet.phantoms import phantom

write_surface(phantom(**job.arguments), job.output.surface)
