"""A synthetic cortex of the case's age, and the sphere that it is made of."""

from _job import start

job = start(snakemake)

from cortet.formats.gifti import write_surface
from cortet.phantoms import phantom_with_sphere

for surface, file in zip(phantom_with_sphere(**job.params.arguments), job.output, strict=True):
    write_surface(surface, file)
