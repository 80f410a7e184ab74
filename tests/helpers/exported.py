"""A small mesh with everything an export can hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from cubes import cube_mesh

from cortet.meshes import TetMesh
from cortet.solver_files.sets import named_sets
from cortet.stages.solver_ready import surface_nodes_first


def full_mesh(n: int = 4, side: float = 8.0) -> TetMesh:
    """A cube with a scalar, a vector and a label field, cortex and core, a medial wall (the bottom), sets of labels."""
    mesh, _ = surface_nodes_first(cube_mesh(n, side=side, jitter=0.2))
    x, y, z = mesh.points.T
    fields = {
        "thickness": 1 + 0.1 * x + 1e-7 * y,
        "normal": mesh.points / side,
        "area": np.where(z < side / 8, 0, np.where(x < side / 2, 3, 12)).astype(np.int32),
    }
    return named_sets(
        replace(mesh, point_data=fields),
        cortex_depth=1.5,
        medial_wall={"area": [0]},
        label_names={"area": {0: "Medial wall", 3: "V1"}},
    )
