"""Fields with any number of components, for formats that allow only certain numbers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from numpy.typing import NDArray

from cortet.errors import InputError


def in_components(fields: Mapping[str, NDArray[Any]], allowed: Collection[int]) -> dict[str, NDArray[Any]]:
    """The fields as (n, k) arrays with an allowed k; any other field becomes k scalars `<name>_1` to `<name>_k`."""
    result: dict[str, NDArray[Any]] = {}
    for name, values in fields.items():
        columns = values.reshape(len(values), -1)
        if columns.shape[1] in allowed:
            result[name] = columns
        else:
            scalars = {f"{name}_{number}": column[:, None] for number, column in enumerate(columns.T, start=1)}
            if taken := sorted(scalars.keys() & fields.keys()):
                what = f"field {name} would be written as {', '.join(scalars)}, but there already is a field {taken[0]}"
                raise InputError(what, remedy="give one of them another name")
            result |= scalars
    return result
