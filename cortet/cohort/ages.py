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
from typing import TYPE_CHECKING, Any

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
#: words of a sidecar for ages that count from birth, and those for ages that do not
_OF_LIFE = re.compile(
    r"\bof life\b|\b(since|from|after) birth\b|\bpost-?natal|\bchronological|\b(corrected|adjusted) age|\bborn\b",
    re.IGNORECASE,
)
_IN_UTERO = re.compile(r"gestation|menstrual|concept", re.IGNORECASE)
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
    #: what the sidecar says of the column if its ages count from birth; empty if they do not
    of_life: str

    def age_of(self, session: Session) -> tuple[float | None, str]:
        """The gestational age of a session, weeks, if it is known; and where it is from, or why it is not read.

        The second is empty if the table does not say the age.
        """
        texts = self._texts(session)
        if not texts:
            return None, self._from_birth if self.column is None and _FROM_BIRTH in self.rows else ""
        if self.of_life:
            what = f"column {self.column} of {self.name} counts from birth: {self.of_life!r}, according to its sidecar"
            return None, f"ages not read: {what} (give gestational ages)"
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
            f"age not read: {' and '.join(texts)} in {self._heading} must be one gestational age with a decimal point, "
            f"from {low:g} to {high:g} weeks (if it is in days, state its Units, days, in the JSON file of the table)"
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

    def of_nobody(self, sessions: Iterable[Session]) -> str:
        """How many of its rows are about none of the sessions that it may tell of, and the first; empty if none is."""
        known = {line for session in sessions for line in self._rows_of(session).index}
        left = [line for line in self.rows.index if line not in known]
        if not left:
            return ""
        first = " ".join(self.rows.loc[left[0]])
        return (
            f"{len(left)} of {len(self.rows)} rows of {self.name} match no surface, the first is line {left[0]}, "
            f"{first!r} (separate values by tabs; participant_id and session_id are the labels of the folders)"
        )

    def _rows_of(self, session: Session) -> pd.DataFrame:
        """Its rows about a session, or about its participant."""
        rows = self.rows
        if not ("{participant}" in self.name or "participant_id" in rows):
            return rows.iloc[:0]
        for key, label in zip(("participant_id", "session_id"), session, strict=True):
            if label is not None and key in rows:
                rows = rows[rows[key].str.replace("^(sub|ses)-", "", regex=True) == label]
        return rows

    def _texts(self, session: Session) -> list[str]:
        """What its rows about a session say of the age, each value once; empty if they could be of another session."""
        rows = self._rows_of(session)
        if self.column is None:
            return []
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
    shared: dict[str, list[str]] = {}
    for session in sessions:
        for name, path in files[session]:
            if session in found or not path.exists():
                continue
            table = read[path] = read.get(path) or _read(name, path, columns)
            weeks, remark = table.age_of(session)
            if weeks is not None:
                found[session] = weeks
                if session[1] and "session_id" not in table.rows:
                    shared.setdefault(session[0], []).append(session[1])
            if remark:
                remarks.setdefault(remark, []).append(session)
    told = [f"{remark}: {_counted(own)}" for remark, own in remarks.items()]
    told += [
        f"sub-{participant}: the sessions {', '.join(labels)} share the one age of their participant (a sessions table "
        "can give each its own)"
        for participant, labels in shared.items()
        if len(labels) > 1
    ]
    for path, table in read.items():
        asking = [session for session in files if path in [file for _, file in files[session]]]
        # where all have their ages, rows of people without a surface are no news
        if any(session not in found for session in asking) and (left := table.of_nobody(asking)):
            told.append(left)
    return found, told


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
    told = _told_of(column, name, path) if column else {}
    about = " ".join(str(told.get(key, "")) for key in ("LongName", "Description")).strip()
    of_life = about if _OF_LIFE.search(about) and not _IN_UTERO.search(about) else ""
    return _Table(name, table, column, str(told.get("Units", "")).strip(), of_life)


def _told_of(column: str, name: str, path: Path) -> dict[str, Any]:
    """What the sidecar of a table and, for sessions tables, the one of the dataset say of a column."""
    root = Path(*path.parts[: len(path.parts) - len(Path(name).parts)])
    entries = [
        json_of(file).get(column)
        for file in (root / (path.stem.rpartition("_")[2] + ".json"), path.with_suffix(".json"))
    ]
    return {key: value for entry in entries if isinstance(entry, dict) for key, value in entry.items()}
