"""Write the sphere of one synthetic cortex."""

from _job import start

job = start(snakemake)

from cortet.formats import gifti
from cortet.phantoms import phantom_with_sphere

gifti.write_surface(phantom_with_sphere(**job.arguments)[1], job.output.sphere)
