"""What the scripts that write files for solvers share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cortet.formats import gifti, vtu
from cortet.formats.volumes import label_names, volume_file
from cortet.solver_files.fields import FieldSource, field_sources
from cortet.solver_files.sets import named_sets

if TYPE_CHECKING:
    from cortet.meshes import TetMesh, TriSurface


def with_sets(inputs: Any, params: Any) -> tuple[TetMesh, TriSurface, Mapping[str, FieldSource]]:
    """The mesh of a job with its named sets, the surface that was meshed, and where each field came from."""
    sources = field_sources(params.paths, params.units)
    surface = gifti.read_nested(inputs.surface, inputs.inner)
    mesh = vtu.read(inputs.mesh)
    tissues = {
        name: label_names(volume_file(file))
        for name, file in params.volumes.items()
        if np.issubdtype(mesh.cell_data[name].dtype, np.integer)
    }
    names = {name: source.labels for name, source in sources.items()} | tissues
    named = named_sets(mesh, **params.sets, label_names=names, inner=list(surface.inner), tissues=tissues)
    return named, surface, sources
