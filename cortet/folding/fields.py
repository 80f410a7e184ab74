"""Names of point data of a mesh, or columns of a sheet, that replace defaults of a fold."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cortet.errors import InputError
from cortet.meshes import FloatArray, TetMesh, TriSurface

#: share of the growth; thickness of the cortex, mm; region of the law of growth
MASK_FIELD, THICKNESS_FIELD, LABEL_FIELD = "growth", "thickness", "label"
#: growth that was measured up to an age: one of these and the age in weeks, with _ for the point
GROWTH_FIELD, CORE_GROWTH_FIELD = "growth_to_", "core_growth_to_"
_GROWTH = re.compile(re.escape(GROWTH_FIELD) + r"(\d+(?:[._]\d+)?)")


def growth_field(age: float, *, core: bool = False) -> str:
    """The name of the field with growth up to an age, of the cortex or of the core."""
    return f"{CORE_GROWTH_FIELD if core else GROWTH_FIELD}{age:g}".replace(".", "_")


def age_of_growth(name: str) -> float | None:
    """The age in weeks up to which a field of this name holds growth; None if it is not such a field."""
    found = _GROWTH.fullmatch(name)
    return float(found[1].replace("_", ".")) if found else None


def check_age(name: str, own_name: str, file: str | Path) -> None:
    """Raise InputError for growth that is named for another age than the one up to which it was measured."""
    wanted, measured = age_of_growth(name), age_of_growth(own_name)
    if wanted is not None and measured is not None and wanted != measured:
        raise InputError(
            f"holds growth up to {measured:g} weeks, but the field is named {name}",
            file=file,
            remedy=f"name it {own_name}",
        )


def node_field(mesh: TetMesh | TriSurface, name: str) -> FloatArray | None:
    """The point data of this name, (n,) float64; None if the mesh or surface has none."""
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
