"""Ages at scan from the tables of a dataset: which column is read, in which unit, and what is not read.

cortet needs gestational ages, in weeks or, where the table's sidecar says so (`Units`, as in BIDS), in days. The column
`age` of BIDS counts years from birth. A child of two years must not become a fetus of two weeks, so that column is read
only if the configuration names it.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cortet.errors import InputError
from cortet.formats.tsv import read_uneven_tsv
from cortet.formats.untrusted import content
from cortet.geometry.limits import SCAN_AGES

#: a session of a participant: their labels
Session = tuple[str, str | None]
#: column of BIDS for years from birth
_FROM_BIRTH = "age"
#: units as sidecars write them, in lower case -> weeks
_WEEKS = dict.fromkeys(("week", "weeks", "wk", "wks", "w"), 1.0) | dict.fromkeys(("day", "days", "d"), 1 / 7)
#: cells that mean an unknown value
_MISSING = frozenset({"", "n/a", "na", "nan", "none", "null"})
#: most rows that a remark names
_MOST_ROWS = 5


@dataclass(frozen=True)
class _Row:
    """A row of a table."""

    line: int
    #: column -> value
    cells: Mapping[str, str]

    def is_of(self, session: Session) -> bool:
        """Whether the row is about a session, or about its participant."""
        given = zip(("participant_id", "session_id"), session, strict=True)
        return all(_label(self.cells[key]) == value for key, value in given if value and key in self.cells)


@dataclass(frozen=True, eq=False)
class _Table:
    """A table that may hold ages."""

    #: file name, as in the configuration
    name: str
    #: label of the participant, empty where the table names none -> rows
    rows: Mapping[str, Sequence[_Row]]
    #: column of the ages; None without one
    column: str | None
    #: their unit according to the sidecar; empty if it does not say
    unit: str
    #: whether there is a column `age`
    has_age: bool

    @property
    def weeks(self) -> float | None:
        """Weeks in the unit of the ages; None if this is not a unit of gestational ages."""
        return _WEEKS.get(self.unit.lower()) if self.unit else 1.0

    @property
    def source(self) -> tuple[str, str | None, str]:
        """What the tables of several participants have in common."""
        return self.name, self.column, self.unit

    def rows_of(self, session: Session) -> list[_Row]:
        """The rows about a session."""
        rows = [*self.rows.get(session[0], ()), *self.rows.get("", ())]
        return [row for row in rows if row.is_of(session)]


@dataclass(frozen=True)
class _Reading:
    """The age that a table gives for a session."""

    session: Session
    table: _Table
    text: str
    #: None if it is not read, is not a gestational age, or rows contradict each other
    weeks: float | None
    #: whether the row is about all sessions of the participant
    shared: bool


def number(text: str | None) -> float | None:
    """A finite number, or None; Python's own form `2_5` is none."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in str(text) else None


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
    sessions = list(sessions)
    read: dict[Path, _Table] = {}
    readings: list[_Reading] = []
    for session in sessions:
        for name, path in files[session]:
            if path not in read and path.exists():
                read[path] = _read(name, path, columns)
            reading = _reading(session, read[path]) if path in read else None
            readings += [reading] if reading else []
            if reading and reading.weeks is not None:
                break
    found = {reading.session: reading.weeks for reading in readings if reading.weeks is not None}
    tables = {session: [read[path] for _, path in files[session] if path in read] for session in sessions}
    ageless = [table for session in sessions if session not in found for table in tables[session]]
    return found, [*_sources(readings), *_shared(readings), *_from_birth(ageless), *_of_nobody(tables)]


def _reading(session: Session, table: _Table) -> _Reading | None:
    """What a table says of the age of a session; None if it says nothing."""
    if table.column is None:
        return None
    rows = table.rows_of(session)
    label = session[1]
    if label is None and len({row.cells.get("session_id") for row in rows}) > 1:
        return None  # the name of the surface does not say which session it is from
    given = [row for row in rows if row.cells[table.column].strip().lower() not in _MISSING]
    if not given:
        return None
    texts = list(dict.fromkeys(row.cells[table.column] for row in given))
    shared = label is not None and not given[0].cells.get("session_id")
    return _Reading(session, table, " and ".join(texts), _in_weeks(texts, table.weeks), shared)


def _in_weeks(texts: Sequence[str], unit: float | None) -> float | None:
    """The one gestational age that the rows of a session give; None if they give none, or several."""
    values = {number(text) for text in texts}
    value = values.pop() if len(values) == 1 else None
    if value is None or unit is None:
        return None
    weeks = round(value * unit, 2)
    return weeks if SCAN_AGES[0] <= weeks <= SCAN_AGES[1] else None


def _sources(readings: Sequence[_Reading]) -> list[str]:
    """Which columns were read, and what was not read and why, in words."""
    told = []
    for source in dict.fromkeys(reading.table.source for reading in readings):
        own = [reading for reading in readings if reading.table.source == source]
        table = own[0].table
        column = f"column {table.column} of {table.name}"
        if table.weeks is None:
            told.append(f"not read: {column}, in {table.unit} (give a gestational age in weeks or days)")
            continue
        unit = f"in {table.unit}, as its sidecar says" if table.unit else "in weeks"
        if good := [reading.session for reading in own if reading.weeks is not None]:
            told.append(f"ages are from {column}, {unit}: {_counted(good)}")
        if bad := [reading for reading in own if reading.weeks is None]:
            low, high = SCAN_AGES
            told.append(
                f"not read: {len(bad)} of {column}, {unit}, as {bad[0].text} of {_named(bad[0].session)}: "
                f"no age from {low:g} to {high:g} gestational weeks "
                "(give one number, and its unit in the sidecar, as Units: weeks or days)"
            )
    return told


def _shared(readings: Sequence[_Reading]) -> list[str]:
    """Which sessions share the one age of their participant, in words."""
    shared: dict[tuple[str, float], list[str]] = {}
    for reading in readings:
        if reading.shared and reading.weeks is not None:
            participant, label = reading.session
            shared.setdefault((participant, reading.weeks), []).append(f"ses-{label}")
    return [
        f"sub-{participant}: {', '.join(labels)} share the one age of their participant, {weeks:g} weeks "
        "(a sessions table can give each session its own age)"
        for (participant, weeks), labels in shared.items()
        if len(labels) > 1
    ]


def _from_birth(tables: Iterable[_Table]) -> list[str]:
    """Tables of sessions without an age that have the column `age` alone, in words."""
    return [
        f"not read: column {_FROM_BIRTH} of {name}, which counts from birth in BIDS (if its ages are gestational, name "
        "the column in cohort.scan.age_columns)"
        for name in dict.fromkeys(table.name for table in tables if table.column is None and table.has_age)
    ]


def _of_nobody(tables: Mapping[Session, Sequence[_Table]]) -> list[str]:
    """Rows that match no session, of the tables of sessions that have no row, in words."""
    told = []
    lacking = [session for session, own in tables.items() if not any(table.rows_of(session) for table in own)]
    for table in dict.fromkeys(table for session in lacking for table in tables[session]):
        asking = [session for session, own in tables.items() if table in own]
        without = [session for session in lacking if table in tables[session]]
        matched = {row.line for session in asking for row in table.rows_of(session)}
        rows = [row for some in table.rows.values() for row in some if row.line not in matched]
        if rows:
            shown = [f"line {row.line}, {' '.join(row.cells.values())!r}" for row in rows[:_MOST_ROWS]]
            more = [f"and {len(rows) - _MOST_ROWS} more"] * (len(rows) > _MOST_ROWS)
            told.append(
                f"{table.name}: {len(rows)} of its rows match no surface ({'; '.join(shown + more)}), and "
                f"{len(without)} participants or sessions have no row, as {_named(without[0])} (separate values by "
                "tabs; participant_id is the label of the folder, session_id that of the session)"
            )
    return told


def _counted(sessions: Sequence[Session]) -> str:
    return f"{len(sessions)} participants or sessions" if len(sessions) > 1 else _named(sessions[0])


def _named(session: Session) -> str:
    participant, label = session
    return f"sub-{participant}" + (f" ses-{label}" if label else "")


def _read(name: str, path: Path, columns: Sequence[str]) -> _Table:
    """A table; columns that are looked for may be written in another case."""
    table, _ = read_uneven_tsv(path)
    if len(table.columns) == 1 and (other := re.search(r"[;,]|\s+", table.columns[0])):
        what = f"line 1: {table.columns[0]!r} is one column: {other[0]!r} separates its values, not a tab"
        raise InputError(what, file=path, remedy="separate values by tabs")
    wanted = {one.lower(): one for one in (*columns, "participant_id", "session_id")}
    names = [wanted.get(one.lower(), one) for one in table.columns]
    for one in wanted.values():
        if names.count(one) > 1:
            raise InputError(
                f"line 1: {names.count(one)} columns are called {one}", file=path, remedy="keep one of them"
            )
    rows: dict[str, list[_Row]] = {}
    for line, cells in zip(table.index, table.set_axis(names, axis="columns").to_dict("records"), strict=True):
        rows.setdefault(_label(cells.get("participant_id", "")), []).append(_Row(line, cells))
    column = next((one for one in columns if one in names), None)
    return _Table(name, rows, column, _unit(column, name, path) if column else "", _FROM_BIRTH in names)


def _unit(column: str, name: str, path: Path) -> str:
    """The Units of a column, by the sidecar of its table or, for sessions tables, by the one of the dataset."""
    root = Path(*path.parts[: len(path.parts) - len(Path(name).parts)])
    general = root / (path.stem.rpartition("_")[2] + ".json")
    unit = ""
    for file in dict.fromkeys((general, path.with_suffix(".json"))):
        if file.is_file():
            try:
                said = json.loads(content(file).decode("utf-8-sig"))
            except (ValueError, RecursionError) as error:
                raise InputError(f"is not JSON: {error}", file=file, remedy="mend it, or delete it") from None
            if not isinstance(said, dict):
                raise InputError("holds no keys", file=file, remedy="give one key per column of the table")
            entry = next((entry for key, entry in said.items() if key.lower() == column.lower()), None)
            unit = str(entry.get("Units", unit)).strip() if isinstance(entry, dict) else unit
    return unit


def _label(text: str) -> str:
    return re.sub("^(sub|ses)-", "", text)
