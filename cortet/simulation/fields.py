"""Point data of a mesh that a fold uses: one finite number per node, or refused before anything is computed."""

from __future__ import annotations

import numpy as np

from cortet.errors import InputError
from cortet.mesh import FloatArray, TetMesh


def node_field(mesh: TetMesh, name: str) -> FloatArray | None:
    """The point data of this name, (n,) float64; None where the mesh has none.

    Raises
    ------
    InputError : it has more than one number per node, or one that is not finite
    """
    if name not in mesh.point_data:
        return None
    values = mesh.point_data[name]
    remedy = f"give the mesh another field {name}, or none"
    if values.ndim > 1 and values.shape[1:] != (1,):
        shape = " x ".join(map(str, values.shape))
        raise InputError(f"the field {name} has {shape} values, not one per node", remedy=remedy)
    numbers = values.reshape(len(values)).astype(float)
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        raise InputError(
            f"the field {name} is {numbers[bad[0]]:g} at node {bad[0]}, and at {len(bad)} in all", remedy=remedy
        )
    return numbers
