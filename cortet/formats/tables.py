"""Descriptions of columns, each of which serves the file, its sidecar, printed tables and pages.

The file is a TSV (`cortet.formats.tsv`); the sidecar is a JSON file that explains its columns, as in BIDS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.formats.atomic import write_json
from cortet.formats.tsv import MISSING, cell, read_tsv, write_tsv

if TYPE_CHECKING:
    import pandas as pd

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    #: its name in the file
    name: str
    description: str = ""
    units: str = ""
    #: value -> its meaning, for a column with few possible values
    levels: Mapping[str, str] = field(default_factory=dict)
    #: nested keys under which a record holds the value, joined by dots; empty: the name of the column
    place: str = ""
    #: identifier of the check of it in a certificate, and the limit of that check in words
    check: str = ""
    limit: str = ""
    #: what readers see above the column; a column without a heading is only in the file
    heading: str = ""
    #: how readers see a value: by a number format (`.3f`) or a function of the row; empty: as in the file
    form: str | Callable[[Row], str] = ""

    def text(self, row: Row) -> str:
        """What readers see of a row; `n/a` if it has no value."""
        if callable(self.form):
            return self.form(row)
        number = self.number(row)
        return cell(row.get(self.name)) if number is None else f"{number:{self.form}}"

    def number(self, row: Row) -> float | None:
        """The value of a row as a number; None if it has none, or if the column holds words."""
        try:
            return float(row[self.name]) if self.form and row.get(self.name) is not None else None
        except ValueError:
            return None

    @property
    def entry(self) -> dict[str, Any]:
        """What a sidecar says about the column."""
        said = {"Units": self.units, "Threshold": self.limit, "Levels": dict(self.levels)}
        return {"Description": self.description} | {key: value for key, value in said.items() if value}


def names(columns: Iterable[Column]) -> list[str]:
    """Names of columns, in their order."""
    return [column.name for column in columns]


def sidecar(columns: Iterable[Column]) -> dict[str, dict[str, Any]]:
    """What the JSON file beside a table says about its columns."""
    return {column.name: column.entry for column in columns}


def printed(columns: Iterable[Column], rows: Iterable[Row]) -> str:
    """The columns that have a heading, as text for a terminal, one line per row."""
    seen = headed(columns)
    lines = [[column.heading for column in seen], *([column.text(row) for column in seen] for row in rows)]
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    return "\n".join("  ".join(map(str.rjust, line, widths)).rstrip() for line in lines)


def headed(columns: Iterable[Column], first: Sequence[str] = ()) -> list[Column]:
    """The columns that readers see: those named in `first`, then the others, in their order.

    Of columns of the same name the last one counts.
    """
    seen = {column.name: column for column in columns if column.heading}
    return [seen[name] for name in dict.fromkeys([*(name for name in first if name in seen), *seen])]


def described(entry: Mapping[str, Any], keys: Iterable[str] = ("Units", "Threshold")) -> str:
    """The entry of a sidecar in one line."""
    parts = [str(entry["Description"]), *(f"{key.lower()}: {entry[key]}" for key in keys if key in entry)]
    return "; ".join([*parts, *(f"{level}: {meaning}" for level, meaning in entry.get("Levels", {}).items())])


def read_columns(path: Path) -> tuple[Column, ...]:
    """Columns from a table with one column per line; its header names text fields of `Column`."""
    rows: list[dict[str, str]] = read_tsv(path).replace(MISSING, "").to_dict("records")
    return tuple(Column(**row) for row in rows)  # type: ignore[arg-type]  # `levels` is not text, and not among them


def values(columns: Sequence[Column], records: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """One row per record, with its values under the keys of the columns."""
    import pandas as pd

    found = pd.json_normalize(list(records)).reindex(columns=[column.place or column.name for column in columns])
    return found.set_axis(names(columns), axis="columns")


def write_table(columns: Sequence[Column], rows: pd.DataFrame | Iterable[Row], *paths: str | Path) -> None:
    """Write some columns of a table to each path; its suffix selects the TSV or the JSON file that explains it."""
    for path in map(Path, paths):
        if path.suffix == ".json":
            write_json(sidecar(columns), path)
        else:
            write_tsv(rows, names(columns), path)
