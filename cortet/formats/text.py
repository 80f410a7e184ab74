"""Numbers as text, fast: the solvers' formats are long tables."""

from __future__ import annotations

from typing import Any, TextIO

from numpy.typing import NDArray

#: rows formatted at a time, which bounds the memory taken
_CHUNK = 100_000


def write_rows(file: TextIO, template: str, rows: NDArray[Any]) -> None:
    """Write each row of a 2-D array by the %-style `template` of one line, newline included."""
    for first in range(0, len(rows), _CHUNK):
        chunk = rows[first : first + _CHUNK]
        file.write(template * len(chunk) % tuple(chunk.ravel().tolist()))
