"""Fast reading and writing of numbers as text: the solvers' formats are long tables."""

from __future__ import annotations

from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

#: rows formatted at a time, to bound memory
_CHUNK = 100_000


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
