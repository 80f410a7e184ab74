"""What the volumes of a case hold inside each tetrahedron of its mesh."""

import logging

from _job import start

job = start(snakemake)

from cortet.formats import gifti, vtu
from cortet.formats.tables import write_table
from cortet.formats.volumes import TISSUE_COLUMNS
from cortet.report.slices import slices
from cortet.solver_files.volumes import backgrounds, read_volumes, with_volumes

volumes = read_volumes(job.params.volumes)
job.require_unchanged_input()
surface = gifti.read_nested(job.input.surface, job.input.inner)
background = backgrounds(volumes, surface)
for one in background:
    logging.info("%s", one.sentence)
mesh, rows = with_volumes(vtu.read(job.input.mesh), volumes, frame=surface.frame, background=background)
vtu.write(mesh, job.output.mesh)
write_table(TISSUE_COLUMNS, rows, job.output.table, job.output.sidecar)
slices(mesh, *next(iter(volumes.items())), job.output.picture, surface.frame)
