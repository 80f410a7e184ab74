"""Values as files hold them: labels of 32 bits, numbers of components that a format allows, and long tables of text."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError

#: rows formatted at a time, to bound memory
_CHUNK = 100_000


def in_32_bits(values: NDArray[Any], what: str, path: str | Path | None = None) -> NDArray[np.int32]:
    """Whole numbers as int32. Raises InputError for a fraction, and for a number that would wrap to another one."""
    for bad, why in (
        (~(values == np.floor(values)), "which is not a whole number"),
        (~((values >= -(2**31)) & (values < 2**31)), "and labels have at most 32 bits"),
    ):
        if bad.any():
            what += f" has the label {values[bad].ravel()[0]}, {why}"
            raise InputError(what, file=path, remedy="number the labels from 0 on")
    return values.astype(np.int32)


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


def write_rows(file: IO[str], template: str, *columns: NDArray[Any]) -> None:
    """Write each row of the columns, (n,) or (n, k) side by side, by the %-style `template` of one line.

    Whole chunks go through one %-format: 1 to 2 million lines of integers per second.
    """
    for first in range(0, len(columns[0]), _CHUNK):
        # integers beside floats become floats; %d prints them as integers again
        rows = np.column_stack([column[first : first + _CHUNK] for column in columns])
        file.write(template * len(rows) % tuple(rows.ravel().tolist()))


def write_wrapped(file: IO[str], numbers: NDArray[np.integer], per_line: int) -> None:
    """Write integers separated by commas, `per_line` of them on a line."""
    before_last = max(len(numbers) - 1, 0) // per_line * per_line
    template = ", ".join(["%d"] * per_line) + "\n"
    write_rows(file, template, numbers[:before_last].reshape(-1, per_line))
    file.write(", ".join(map(str, numbers[before_last:].tolist())) + "\n")
