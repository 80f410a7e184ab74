"""What the scripts that write files for solvers share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cortet.formats import gifti, vtu
from cortet.formats.volumes import label_names, volume_file

if TYPE_CHECKING:
    from cortet.meshes import TetMesh, TriSurface


def read_made(inputs: Any, params: Any) -> tuple[TetMesh, TriSurface, dict[str, Any]]:
    """The mesh of a job, the surface that was meshed, and arguments of `solver_files.export.with_sets`."""
    mesh = vtu.read(inputs.mesh)
    labels = {
        name: label_names(volume_file(file))
        for name, file in params.volumes.items()
        if np.issubdtype(mesh.cell_data[name].dtype, np.integer)
    }
    surface = gifti.read_nested(inputs.surface, inputs.inner)
    return mesh, surface, {"sets": params.sets, "labels": labels}
