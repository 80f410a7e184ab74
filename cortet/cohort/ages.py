"""Ages at scan from the tables of a dataset: which column is read, in which unit, and what is not read.

cortet needs gestational ages, in weeks or, where the table's sidecar says so (`Units`, as in BIDS), in days. The column
`age` of BIDS counts years from birth. A child of two years must not become a fetus of two weeks, so that column is read
only if the configuration names it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.errors import InputError
from cortet.formats.ownership import json_of
from cortet.formats.tsv import read_uneven_tsv
from cortet.geometry.limits import SCAN_AGES

if TYPE_CHECKING:
    import pandas as pd

#: a session of a participant: their labels
Session = tuple[str, str | None]
#: column of BIDS for years from birth
_FROM_BIRTH = "age"
#: units as sidecars write them, in lower case -> weeks
_WEEKS = dict.fromkeys(("", "week", "weeks", "wk", "wks", "w"), 1.0) | dict.fromkeys(("day", "days", "d"), 1 / 7)
#: cells that mean an unknown value
_MISSING = frozenset({"", "n/a", "na", "nan", "none", "null"})


def number(text: str | None) -> float | None:
    """A finite number, or None; Python's own form `2_5` is none."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in str(text) else None


@dataclass(frozen=True, eq=False)
class _Table:
    """A table that may hold ages."""

    #: file name, as in the configuration
    name: str
    rows: pd.DataFrame
    #: column of the ages; None without one
    column: str | None
    #: their unit according to the sidecar; empty if it does not say
    unit: str

    def age_of(self, session: Session) -> tuple[float | None, str]:
        """The gestational age of a session, weeks, if it is known; and where it is from, or why it is not read.

        The second is empty if the table does not say the age.
        """
        texts = self._texts(session)
        if not texts:
            return None, self._from_birth if self.column is None and _FROM_BIRTH in self.rows else ""
        if self.unit.lower() not in _WEEKS:
            return (
                None,
                f"ages not read: column {self.column} of {self.name} is in {self.unit} (convert it to weeks or days)",
            )
        values = {(number(text) or math.nan) * _WEEKS[self.unit.lower()] for text in texts}
        low, high = SCAN_AGES
        if len(values) == 1 and low <= (weeks := round(values.pop(), 2)) <= high:
            return weeks, f"ages read from {self._heading}"
        return None, (
            f"age not read: {' and '.join(texts)} in {self._heading} must be one gestational age from {low:g} to "
            f"{high:g} weeks (its unit is stated in the sidecar, as Units: weeks or days)"
        )

    @property
    def _heading(self) -> str:
        """The column of the ages and their unit, in words."""
        unit = f"{self.unit}, according to its sidecar" if self.unit else "weeks"
        return f"column {self.column} of {self.name} ({unit})"

    @property
    def _from_birth(self) -> str:
        return (
            f"ages not read: in BIDS, column {_FROM_BIRTH} of {self.name} counts from birth (if its ages are "
            "gestational, name the column in cohort.scan.age_columns)"
        )

    def _texts(self, session: Session) -> list[str]:
        """What its rows about a session say of the age, each value once; empty if they could be of another session."""
        rows = self.rows
        of_one = "{participant}" in self.name
        if self.column is None or not (of_one or "participant_id" in rows):
            return []
        for key, label in zip(("participant_id", "session_id"), session, strict=True):
            if label is not None and key in rows:
                rows = rows[rows[key].str.replace("^(sub|ses)-", "", regex=True) == label]
        if session[1] is None and "session_id" in rows and rows["session_id"].nunique() > 1:
            return []
        return [text for text in dict.fromkeys(rows[self.column]) if text.strip().lower() not in _MISSING]


def ages_at_scan(
    sessions: Iterable[Session], files: Mapping[Session, Sequence[tuple[str, Path]]], columns: Sequence[str]
) -> tuple[dict[Session, float], list[str]]:
    """Gestational ages, weeks, of the sessions that have one; and remarks on their sources and on what is not read.

    Parameters
    ----------
    sessions : participant and session, their labels
    files : name and file of the tables of each session; the first tables count most
    columns : columns that may hold the age; each table uses the first of them that it has
    """
    read: dict[Path, _Table] = {}
    found: dict[Session, float] = {}
    remarks: dict[str, list[Session]] = {}
    for session in sessions:
        for name, path in files[session]:
            if session in found or not path.exists():
                continue
            table = read[path] = read.get(path) or _read(name, path, columns)
            weeks, remark = table.age_of(session)
            if weeks is not None:
                found[session] = weeks
            if remark:
                remarks.setdefault(remark, []).append(session)
    return found, [f"{remark}: {_counted(own)}" for remark, own in remarks.items()]


def _counted(sessions: Sequence[Session]) -> str:
    participant, label = sessions[0]
    first = f"sub-{participant}" + (f" ses-{label}" if label else "")
    return f"{first} and {len(sessions) - 1} more" if len(sessions) > 1 else first


def _read(name: str, path: Path, columns: Sequence[str]) -> _Table:
    table, _ = read_uneven_tsv(path)
    if len(table.columns) == 1 and (other := re.search(r"[;,]|\s+", table.columns[0])):
        what = f"line 1: {other[0]!r} instead of a tab separates the column names in {table.columns[0]!r}"
        raise InputError(what, file=path, remedy="separate values by tabs")
    column = next((one for one in columns if one in table.columns), None)
    return _Table(name, table, column, _unit(column, name, path) if column else "")


def _unit(column: str, name: str, path: Path) -> str:
    """The Units of a column, by the sidecar of its table or, for sessions tables, by the one of the dataset."""
    root = Path(*path.parts[: len(path.parts) - len(Path(name).parts)])
    for file in (path.with_suffix(".json"), root / (path.stem.rpartition("_")[2] + ".json")):
        entry = json_of(file).get(column)
        if isinstance(entry, dict) and "Units" in entry:
            return str(entry["Units"]).strip()
    return ""
