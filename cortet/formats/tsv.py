"""Tables of tab-separated values, as BIDS has them: a header line, `n/a` where there is no value."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cortet.formats.atomic import atomic_path

MISSING = "n/a"


def read_tsv(path: Path) -> list[dict[str, str]]:
    """Rows of a table of tab-separated values with a header line."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))


def write_tsv(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], path: Path) -> None:
    """Write a table of tab-separated values with a header line; numbers with six significant digits."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, delimiter="\t", lineterminator="\n", quoting=csv.QUOTE_NONE)
        writer.writerow(columns)
        writer.writerows([cell(row.get(column)) for column in columns] for row in rows)


def cell(value: Any) -> str:
    """A value as one cell of a TSV: no tabs, no line ends, never empty."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return " ".join(str(value).split()) if value not in (None, "") else MISSING
