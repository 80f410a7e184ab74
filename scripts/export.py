"""Write one mesh for a solver, with its sets and a sidecar, if it is certified."""

import json
import logging
from pathlib import Path

from _job import start

job = start(snakemake)

from _exported import with_sets

from cortet.meshes import by_region
from cortet.solver_files.export import export
from cortet.solver_files.meshed import made_from
from cortet.solver_files.volumes import sources as sources_of_volumes

logger = logging.getLogger("cortet")
job.require_unchanged_input()
mesh, surface, sources = with_sets(job.input, job.params)
certificate = json.loads(Path(job.input.certificate).read_text(encoding="utf-8"))
inner = dict(zip(job.params.inner, map(Path, job.input.inner), strict=True))
meshed = by_region(Path(job.input.surface), inner)
target = Path(job.output.mesh)
told = export(
    mesh,
    target,
    certificate=certificate,
    made_from={
        **made_from(meshed, job.params.given, target.parent, job.params.age),
        **({"volumes": sources_of_volumes(job.params.volumes)} if job.params.volumes else {}),
    },
    frame=surface.frame,
    sources=sources,
    **job.arguments,
)
for what in told:
    logger.info("%s", what)
