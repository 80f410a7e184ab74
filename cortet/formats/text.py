"""Fast reading and writing of numbers as text: the solvers' formats are long tables."""

from __future__ import annotations

import io
import re
import warnings
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


class BadRowError(ValueError):
    """A line of a table cannot be read."""

    def __init__(self, row: int, what: str) -> None:
        #: row of the table, counted from 0
        self.row = row
        super().__init__(what)


def read_rows(
    lines: IO[Any] | bytes, columns: int, dtype: Any, *, rows: int | None = None, delimiter: str | None = None
) -> NDArray[Any]:
    """Read the next `rows` lines, or all, as (rows, columns) numbers; blank lines are skipped.

    Raises
    ------
    BadRowError
        a line has another number of fields, or a field that is not a number of `dtype`; or lines are missing
    """
    if rows == 0 or (rows is None and isinstance(lines, bytes) and not lines.strip()):
        return np.empty((0, columns), dtype)
    source = io.BytesIO(lines) if isinstance(lines, bytes) else lines
    if rows is None:
        return _next_rows(source, columns, dtype, None, delimiter, 0)
    # NumPy reserves memory for all rows before it reads any, and a file may state any number of rows
    parts: list[NDArray[Any]] = []
    done = 0
    while done < rows:
        parts.append(_next_rows(source, columns, dtype, min(_CHUNK, rows - done), delimiter, done))
        done += len(parts[-1])
        if done < rows and len(parts[-1]) < _CHUNK:
            raise BadRowError(done, f"is missing: {done} lines instead of {rows}")
    return np.concatenate(parts)


def _next_rows(
    source: IO[Any], columns: int, dtype: Any, most: int | None, delimiter: str | None, done: int
) -> NDArray[Any]:
    """Read at most `most` rows, or all; `done` rows were read before."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the caller reports an empty file
            table = np.loadtxt(source, dtype, comments=None, delimiter=delimiter, max_rows=most, ndmin=2)
    except ValueError as error:
        raise _bad_row(str(error), done) from error
    if len(table) and table.shape[1] != columns:
        raise BadRowError(done, f"has {table.shape[1]} fields instead of {columns}")
    return table.reshape(-1, columns)


def _bad_row(message: str, done: int) -> BadRowError:
    """An error message of NumPy in our words."""
    if found := re.search(r"changed from (\d+) to (\d+) at row (\d+)", message):
        return BadRowError(done + int(found[3]) - 1, f"has {found[2]} fields instead of {found[1]}")
    if found := re.search(r"could not convert string ' *(.*)' to \w+ at row (\d+)", message):
        return BadRowError(done + int(found[2]), f"holds {found[1]!r}, which is not a number of its kind")
    return BadRowError(done, message)
