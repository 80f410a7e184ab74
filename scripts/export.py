"""Write one mesh for a solver, with its sets and a sidecar, if it is certified."""

import logging
from pathlib import Path

from _job import start

job = start(snakemake)

from _exported import certificate_as_planned, read_made

from cortet.formats.certificates import OF_UNCERTIFIED
from cortet.meshes import by_region
from cortet.solver_files.export import export_made
from cortet.solver_files.meshed import Origin

job.require_unchanged_input()
mesh, surface, named = read_made(job.input, job.params)
inner = dict(zip(job.params.inner, map(Path, job.input.inner), strict=True))
told = export_made(
    mesh,
    surface,
    Path(job.output.mesh),
    certificate=certificate_as_planned(job.input, job.params),
    uncertified=job.wildcards.label == OF_UNCERTIFIED,
    origin=Origin(
        job.params.given,
        by_region(Path(job.input.surface), inner),
        job.params.paths,
        job.params.volumes,
        age=job.params.age,
    ),
    **named,
    arguments=job.params.arguments,
)
for what in told:
    logging.getLogger("cortet").info("%s", what)
