"""Ages at scan from the tables of a dataset: which column is read, in which unit, and which columns are not read.

cortet needs gestational ages. A column of that name is read in weeks, or in the unit that the table's sidecar states
(`Units`, as in BIDS). The column `age` of BIDS is in years from birth, unless a sidecar says otherwise. A child of two
years must not become a fetus of two weeks, so this column is read only if its unit is weeks, or if the configuration
names it.
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

#: weeks in a unit of time
WEEKS = {"weeks": 1.0, "days": 1 / 7, "months": 365.25 / 12 / 7, "years": 365.25 / 7}
#: column whose ages count from birth unless a sidecar says otherwise
FROM_BIRTH = "age"
#: a session of a participant: their labels
Session = tuple[str, str | None]

_UNITS = {
    "weeks": r"weeks?|wks?|w",
    "days": r"days?|d",
    "months": r"months?|mo|mos|mths?",
    "years": r"years?|yrs?|y",
}
#: what may stand in Units beside the unit; with anything else, such as a number, nobody knows what is meant
_BESIDE_UNIT = (
    r"gestation(al)?|(post)?menstrual|(post)?concept(ion|ional|ual)|(post)?natal|post|chronological|ages?|pma|ga|scan|"
    r"births?|life|last|period|completed|decimal|in|the|since|from|of|after|at"
)
#: words in a sidecar for ages from birth, and for ages from conception or the last period
_BIRTH = r"\b(birth|born|post-?natal|chronological|of life|(corrected|adjusted) age|ex[ -]?utero|DOL)\b"
_GESTATION = r"gestation|menstrual|concept|\bPMA\b|\bGA\b"
#: why such ages are not read
_AT_BIRTH = "it counts from birth"
#: words for the age of somebody else
_PARENT = r"\b(mothers?|maternal|fathers?|paternal|parents?)\b"
#: cells that mean an unknown value
_MISSING = frozenset({"", "n/a", "na", "nan", "none", "null"})
#: what makes a column be read
_REMEDY = (
    ", and a gestational age is needed. Where it is one: say Units: weeks in the sidecar, call the column scan_age, or "
    "name it in cohort.scan.age_columns"
)

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


#: rows of a table by the participant's label
_RowsByParticipant = dict[str, list[_Row]]


@dataclass(frozen=True)
class Column:
    """How a column of a table is read."""

    #: file name of the table, as in the configuration, and name of the column
    table: str
    name: str
    #: key of `WEEKS`
    unit: str
    #: what states this unit
    source: str
    #: why the column is not read; empty if it is read
    refused: str = ""
    #: what to do about that, where it is not what `_REMEDY` says
    remedy: str = ""


@dataclass(frozen=True)
class _Reading:
    """A value of a column for a session."""

    session: Session
    column: Column
    text: str
    #: None if the column is not read, the value is not a gestational age, or rows contradict each other
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
    sessions: Iterable[Session],
    tables: Mapping[Session, Sequence[tuple[str, Path]]],
    columns: Sequence[str],
    *,
    named: bool = False,
) -> tuple[dict[Session, float], list[str]]:
    """Gestational ages, weeks, of the sessions that have one; and remarks on their sources and on what is not read.

    Parameters
    ----------
    sessions : participant and session, their labels
    tables : name and file of the tables of each session; the first tables count most
    columns : columns that may hold the age; each table uses the first of them that it has
    named : whether the configuration names the columns; their unit is then taken to be weeks
    """
    read: dict[Path, _RowsByParticipant] = {}
    described: dict[Path, Mapping[str, object]] = {}
    found: dict[Session, float] = {}
    readings: list[_Reading] = []
    sessions = list(sessions)
    for session in sessions:
        for table, path in tables[session]:
            if path not in read:
                read[path] = _rows_by_participant(path, columns) if path.exists() else {}
                described[path] = _sidecar(path, table)
            reading = _reading(session, read[path], described[path], table, columns, named=named)
            readings += [reading] if reading else []
            if reading and reading.weeks is not None:
                found[session] = reading.weeks
                break
    return found, _in_words(readings) + _of_nobody(sessions, tables, read)


def _of_nobody(
    sessions: Sequence[Session],
    tables: Mapping[Session, Sequence[tuple[str, Path]]],
    read: Mapping[Path, _RowsByParticipant],
) -> list[str]:
    """Rows that match no session, of the tables of sessions that have no row, in words."""
    told = []
    asking: dict[Path, list[Session]] = {}
    for session in sessions:
        for _, path in tables[session]:
            asking.setdefault(path, []).append(session)
    lacking = [one for one in sessions if not any(_rows_of(one, read.get(path, {})) for _, path in tables[one])]
    for table, path in dict.fromkeys(named for session in lacking for named in tables[session]):
        matched = {row.line for session in asking[path] for row in _rows_of(session, read[path])}
        rows = [row for some in read[path].values() for row in some if row.line not in matched]
        if rows:
            shown = [f"line {row.line}, {' '.join(row.cells.values())!r}" for row in rows[:_MOST_ROWS]]
            more = [f"and {len(rows) - _MOST_ROWS} more"] * (len(rows) > _MOST_ROWS)
            without = [_named(session) for session in lacking if session in asking[path]]
            told.append(
                f"{table}: {len(rows)} of its rows match no surface ({'; '.join(shown + more)}), and {len(without)} "
                f"participants or sessions have no row, as {without[0]} (separate values by tabs; participant_id is "
                "the label of the folder, session_id that of the session)"
            )
    return told


def _rows_of(session: Session, rows: _RowsByParticipant) -> list[_Row]:
    """The rows of a table that are about a session."""
    return [row for row in rows.get(session[0], []) + rows.get("", []) if row.is_of(session)]


def _reading(
    session: Session,
    rows: _RowsByParticipant,
    sidecar: Mapping[str, object],
    table: str,
    columns: Sequence[str],
    *,
    named: bool,
) -> _Reading | None:
    """What a table says of the age of a session; None if it says nothing."""
    known = [row.cells for row in _rows_of(session, rows)]
    label = session[1]
    if label is None and len({row.get("session_id") for row in known}) > 1:
        return None  # the name of the surface does not say which session it is from
    given = [(name, row) for row in known if (name := next((one for one in columns if one in row), None))]
    given = [(name, row) for name, row in given if row[name].strip().lower() not in _MISSING]
    if not given:
        return None
    name = given[0][0]
    texts = list(dict.fromkeys(row[name] for one, row in given if one == name))
    entry = next((entry for key, entry in sidecar.items() if key.lower() == name.lower()), None)
    column = _column(table, name, entry, named=named)
    shared = label is not None and not given[0][1].get("session_id")
    return _Reading(session, column, " and ".join(texts), _weeks(texts, column), shared)


def _weeks(texts: Sequence[str], column: Column) -> float | None:
    """The one gestational age that the rows of a session give; None if they give none, or several."""
    values = {number(text) for text in texts}
    value = values.pop() if len(values) == 1 else None
    if value is None or column.refused:
        return None
    weeks = round(value * WEEKS[column.unit], 2)
    return weeks if SCAN_AGES[0] <= weeks <= SCAN_AGES[1] else None


def _column(table: str, name: str, entry: object, *, named: bool) -> Column:
    """How a column is read, according to its sidecar."""
    said = {key.lower(): str(value) for key, value in entry.items()} if isinstance(entry, Mapping) else {}
    written, description = said.get("units", ""), f"{said.get('longname', '')} {said.get('description', '')}"
    about = f"{description} {written}"
    units = _units_in(written)
    described = _described_units(description)
    parent = re.search(_PARENT, about, re.IGNORECASE)
    born = name == FROM_BIRTH and (parent or not re.search(_GESTATION, about, re.IGNORECASE))
    from_birth = re.search(_BIRTH, about, re.IGNORECASE)
    reason = "it is the age of a parent" if parent else _AT_BIRTH if from_birth else ""
    if written:
        source = f"its sidecar says Units: {written}"
        if not units:
            return Column(table, name, "an unknown unit", source, "these Units are not understood")
        if len(units) > 1:
            return Column(table, name, units[0], source, f"its Units name {' and '.join(units)}")
        if described and units[0] not in described and not reason:
            return Column(
                table,
                name,
                units[0],
                source,
                f"by its description it is in {' or '.join(described)}",
                " (mend the Units or the description in the sidecar)",
            )
        return Column(table, name, units[0], source, reason or (_AT_BIRTH if born and units != ["weeks"] else ""))
    if born and not named:
        return Column(table, name, "years", "BIDS, where no sidecar has Units", reason or _AT_BIRTH)
    if described and "weeks" not in described:
        only = "" if reason else f" (say Units: {described[0]} in the sidecar)"
        return Column(table, name, described[0], "by its description", reason or "a description is not a unit", only)
    return Column(table, name, "weeks", "no sidecar has its Units", reason)


def _units_in(text: str) -> list[str]:
    """The units of time that Units name; none where they hold something else, too."""
    words = re.findall(r"[^\s(),;]+", text.lower().replace("-", " "))
    units = [[unit for unit, names in _UNITS.items() if re.fullmatch(names, word)] for word in words]
    known = all(unit or re.fullmatch(_BESIDE_UNIT, word) for unit, word in zip(units, words, strict=True))
    return list(dict.fromkeys(unit for found in units for unit in found)) if known else []


def _described_units(text: str) -> list[str]:
    """The units of ages that a description names."""
    words = {unit: rf"\b{unit}\b|\bin {unit[:-1]}\b" for unit in WEEKS}
    words["months"] += r"|\b(mos?|mths?)\b"
    words["years"] += r"|\b(yrs?|y)\b"
    words["weeks"] += r"|\bwks?\b"
    return [unit for unit, pattern in words.items() if re.search(pattern, text, re.IGNORECASE)]


def _in_words(readings: Sequence[_Reading]) -> list[str]:
    """Which columns were read, what was not read and why, and which sessions share an age, in words."""
    told = []
    for column in dict.fromkeys(reading.column for reading in readings):
        own = [reading for reading in readings if reading.column == column]
        good = [reading.session for reading in own if reading.weeks is not None]
        which = f"column {column.name} of {column.table}, in {column.unit} ({column.source})"
        if column.refused:
            told.append(f"not read: {which}; {column.refused}{column.remedy or _REMEDY}")
            continue
        if good:
            told.append(f"ages are from {which}: {_counted(good)}")
        if bad := [reading for reading in own if reading.weeks is None]:
            low, high = SCAN_AGES
            told.append(
                f"not read: {len(bad)} of {which}, as {bad[0].text} of {_named(bad[0].session)}: "
                f"no age from {low:g} to {high:g} gestational weeks "
                "(give one number, and its unit in the sidecar, as Units)"
            )
    shared: dict[tuple[str, float], list[str]] = {}
    for reading in readings:
        if reading.shared and reading.weeks is not None:
            participant, label = reading.session
            shared.setdefault((participant, reading.weeks), []).append(f"ses-{label}")
    return told + [
        f"sub-{participant}: {', '.join(labels)} share the one age of their participant, {weeks:g} weeks "
        "(a sessions table can give each session its own age)"
        for (participant, weeks), labels in shared.items()
        if len(labels) > 1
    ]


def _counted(sessions: Sequence[Session]) -> str:
    return f"{len(sessions)} participants or sessions" if len(sessions) > 1 else _named(sessions[0])


def _named(session: Session) -> str:
    participant, label = session
    return f"sub-{participant}" + (f" ses-{label}" if label else "")


def _sidecar(path: Path, table: str) -> Mapping[str, object]:
    """Content of the JSON file beside a table; for sessions tables, also of the one at the root of the dataset."""
    beside = path.with_suffix(".json")
    root = Path(*path.parts[: len(path.parts) - len(Path(table).parts)])
    general = root / (path.stem.rpartition("_")[2] + ".json")
    said: dict[str, object] = {}
    for file in dict.fromkeys((general, beside)):
        if path.exists() and file.is_file():
            try:
                data = json.loads(content(file).decode("utf-8-sig"))
            except (ValueError, RecursionError) as error:
                raise InputError(f"is not JSON: {error}", file=file, remedy="mend it, or delete it") from None
            if not isinstance(data, dict):
                raise InputError("holds no keys", file=file, remedy="give one key per column of the table")
            said |= data
    return said


def _rows_by_participant(path: Path, columns: Sequence[str]) -> _RowsByParticipant:
    """Rows of a table by the participant's label, which is empty if the table has no such column.

    Columns that are looked for may be written in another case.
    """
    table, _ = read_uneven_tsv(path)
    if len(table.columns) == 1 and (other := re.search(r"[;,]|\s+", table.columns[0])):
        what = f"line 1: {table.columns[0]!r} is one column: {other[0]!r} separates its values, not a tab"
        raise InputError(what, file=path, remedy="separate values by tabs")
    wanted = {name.lower(): name for name in (*columns, "participant_id", "session_id")}
    names = [wanted.get(name.lower(), name) for name in table.columns]
    for name in wanted.values():
        if names.count(name) > 1:
            raise InputError(
                f"line 1: {names.count(name)} columns are called {name}", file=path, remedy="keep one of them"
            )
    found: _RowsByParticipant = {}
    rows = table.set_axis(names, axis="columns").to_dict("records")
    for line, cells in zip(table.index, rows, strict=True):
        found.setdefault(_label(cells.get("participant_id", "")), []).append(_Row(line, cells))
    return found


def _label(text: str) -> str:
    return re.sub("^(sub|ses)-", "", text)
