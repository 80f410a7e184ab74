"""A synthetic cortex of the case's age."""

from _job import parameters, snakemake

from cortet.formats.gifti import write_surface
from cortet.phantom import phantom

write_surface(phantom(**parameters()), snakemake.output.surface)
