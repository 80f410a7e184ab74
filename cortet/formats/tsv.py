"""Tables of tab-separated values (TSV), as in BIDS: a header line, and `n/a` for a missing value.

Nothing is quoted: a quotation mark is an ordinary character. A tab or a line end in a cell is written as a blank.

pandas is imported only where a table is read or written, so that stages start without it.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.errors import InputError, counted
from cortet.formats.atomic import atomic_path
from cortet.formats.untrusted import content

if TYPE_CHECKING:
    import pandas as pd

MISSING = "n/a"

#: most problems that one message lists
_MOST_PROBLEMS = 100


def read_tsv(path: Path) -> pd.DataFrame:
    """The rows of a table, all cells as strings without surrounding white space; `n/a` stays `n/a`.

    The index of the frame holds the line number of each row. Blank lines are skipped.
    """
    frame, wrong = read_uneven_tsv(path)
    if wrong:
        raise refusal([f"line {line}, {problem}" for line, problem in wrong.items()], path)
    return frame


def read_uneven_tsv(path: Path) -> tuple[pd.DataFrame, dict[int, str]]:
    """Like `read_tsv`, for tables not written by cortet: rows with more or fewer values than the header are kept.

    Missing values at the end of such a row are empty; surplus values are dropped.

    Returns
    -------
    frame : all rows
    wrong : line -> what is wrong with the number of its values, and the remedy
    """
    import pandas as pd

    lines = _lines(path)
    header, *rows = ([cell.strip() for cell in text.split("\t")] for _, text in lines)
    while header and not header[-1] and not any("".join(row[len(header) - 1 :]) for row in rows):
        header.pop()  # columns without name and values, as spreadsheets leave them
        rows = [row[: len(header)] for row in rows]
    width = len(header)
    wrong = {
        number: f"all columns: {len(row)} values for {width} columns "
        "(separate values by single tabs and write n/a for missing ones)"
        for (number, _), row in zip(lines[1:], rows, strict=True)
        if len(row) != width
    }
    even = [(row + [""] * width)[:width] for row in rows]
    return pd.DataFrame(even, [number for number, _ in lines[1:]], header, dtype=object), wrong


def write_tsv(rows: pd.DataFrame | Iterable[Mapping[str, Any]], columns: Sequence[str], path: Path) -> None:
    """Write some columns of a table, complete or not at all; `cell` says how values are written.

    Parameters
    ----------
    rows : a frame, or one mapping from column to value per row; columns that a row lacks count as missing
    """
    import pandas as pd

    frame = rows if isinstance(rows, pd.DataFrame) else pd.DataFrame(list(rows), dtype=object)
    frame = frame.reindex(columns=list(columns))
    texts = frame.astype(object).where(frame.notna(), None).map(cell)
    with atomic_path(path) as temporary:
        texts.to_csv(temporary, sep="\t", index=False, quoting=csv.QUOTE_NONE, lineterminator="\n", encoding="utf-8")


def cell(value: Any) -> str:
    """A value as one cell: floating-point numbers with six significant digits, `n/a` for None, NaN and empty text."""
    if isinstance(value, float):
        return MISSING if math.isnan(value) else f"{value:.6g}"
    if value is None:
        return MISSING
    return re.sub(r"\s*[\t\r\n]\s*", " ", str(value)).strip() or MISSING


def refusal(found: Sequence[str], path: Path) -> InputError:
    """One error that lists the problems of a table, cut to a readable number."""
    more = [f"and {len(found) - _MOST_PROBLEMS} more"] if len(found) > _MOST_PROBLEMS else []
    told = "\n  ".join([*found[:_MOST_PROBLEMS], *more])
    return InputError(f"{counted(len(found), 'problem')}\n  {told}", file=path)


def _lines(path: Path) -> list[tuple[int, str]]:
    """Number and text of every line that is not blank."""
    try:
        text = content(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="give a UTF-8 TSV file") from None
    lines = [(n, line) for n, line in enumerate(re.split("\r\n|\n|\r", text), start=1) if line.strip()]
    if not lines:
        raise InputError("is empty", file=path, remedy="give a table with a header line and tab-separated values")
    return lines
