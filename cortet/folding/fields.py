"""Names of point data of a mesh, or columns of a sheet, that replace defaults of a fold."""

from __future__ import annotations

import numpy as np

from cortet.errors import InputError
from cortet.meshes import FloatArray, TetMesh, TriSurface

#: share of the growth; thickness of the cortex, mm; region of the law of growth
MASK_FIELD, THICKNESS_FIELD, LABEL_FIELD = "growth", "thickness", "label"


def node_field(mesh: TetMesh | TriSurface, name: str) -> FloatArray | None:
    """The point data of this name, (n,) float64; None if the mesh or surface has none."""
    if name not in mesh.point_data:
        return None
    values = mesh.point_data[name]
    remedy = f"correct the field {name}, or leave it out"
    if values.ndim > 1 and values.shape[1:] != (1,):
        shape = " x ".join(map(str, values.shape))
        raise InputError(f"the field {name} has {shape} values, not one per node", remedy=remedy)
    numbers = values.reshape(len(values)).astype(float)
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        raise InputError(
            f"the field {name} is {numbers[bad[0]]:g} at node {bad[0]}; {len(bad)} of its values are not finite",
            remedy=remedy,
        )
    return numbers
