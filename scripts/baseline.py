"""S1 by another mesher; where it fails, the mesh has no elements and its records say why."""

import logging
from dataclasses import asdict
from typing import Any

import numpy as np
from _job import start

job = start(snakemake)

from cortet.errors import StageError
from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.measure.quality import summarise
from cortet.meshes import TetMesh
from cortet.stages.generate import generate

try:
    mesh, made = generate(
        gifti.read_surface(job.input.surface),
        mesher=job.wildcards.mesher,
        cell_size=int(job.wildcards.res) / 1000,
        time_limit=job.params.time_limit,
    )
    report: dict[str, Any] = asdict(made)
    quality: dict[str, Any] = asdict(summarise(mesh))
except StageError as error:
    logging.getLogger("cortet").warning("%s", error)
    mesh = TetMesh(np.empty((0, 3)), np.empty((0, 4), np.int32))
    report = {"mesher": job.wildcards.mesher, "failure": str(error)}
    quality = {"failure": str(error)}
vtu.write(mesh, job.output.mesh)
write_json(job.record(report), job.output.report)
write_json(job.record(quality), job.output.quality)
