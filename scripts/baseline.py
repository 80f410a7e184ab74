"""S1 by another mesher; where it fails, the mesh has no elements and the report says why."""

from dataclasses import asdict

import numpy as np
from _job import logger, parameters, snakemake

from cortet.errors import StageError
from cortet.formats import gifti, vtu
from cortet.formats.atomic import write_json
from cortet.mesh import TetMesh
from cortet.stages.generate import generate_with_baseline

try:
    mesh, made = generate_with_baseline(gifti.read_surface(snakemake.input.surface), **parameters())
    report = asdict(made)
except StageError as error:
    logger.warning("%s", error)
    mesh = TetMesh(np.empty((0, 3)), np.empty((0, 4), np.int32))
    report = {"mesher": parameters()["mesher"], "failure": str(error)}
vtu.write(mesh, snakemake.output.mesh)
write_json(report, snakemake.output.report)
