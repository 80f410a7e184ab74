"""Contacts of electrodes: tables of BIDS (`*_electrodes.tsv`), tables in memory, and coordinates by name."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cortet.errors import InputError
from cortet.formats.placement import UNITS
from cortet.formats.tsv import MISSING, read_tsv
from cortet.formats.untrusted import by_library, content
from cortet.meshes import CoordinateFrame, FloatArray

#: what the name of a contact must match: it stands in names of fields and sets, which some solvers cut off
NAME = r"[A-Za-z0-9][A-Za-z0-9_'-]{0,39}"
#: largest radius, mm: that of the pads of stimulation
MOST_RADIUS = 100.0
#: what BIDS calls coordinates that are the surface's if whoever wrote them says so, and those of the scanner
_OWN, _SCANNER = "Other", "ScanRAS"
_FORM = "give (x, y, z) or (x, y, z, radius), mm"
_HEADER = "give the columns name, x, y, z, and size in mm2, each once, separated by tabs"


class Contact(NamedTuple):
    """A contact, in the coordinates of the surface."""

    name: str
    #: mm
    point: tuple[float, float, float]
    #: mm; None: a point
    radius: float | None


def contacts_of(given: Any, frame: CoordinateFrame, to_mm: float | None = None) -> tuple[Contact, ...]:
    """Contacts from what a user gives.

    Parameters
    ----------
    given : name -> (x, y, z) or (x, y, z, radius); a frame with columns `name`, `x`, `y`, `z`, and `radius` or `size`;
        or a file of BIDS
    frame : of the surface
    to_mm : as `placement.placed` takes it, for what does not state its unit; a `size` is always in mm2

    Raises
    ------
    InputError : a name or number cannot be, or two contacts have one name
    """
    file = given if isinstance(given, str | Path) else None
    to_surface, scale = np.eye(4), to_mm or 1.0
    if file is not None:
        file = Path(file)
        to_surface, unit = _system(file, frame)
        scale = scale if unit is None else unit
        given = read_tsv(file)
    rows = _rows(given, file, scale) if hasattr(given, "columns") else _of_mapping(given)
    found: dict[str, Contact] = {}
    for name, values, where in rows:
        contact = _contact(name, values, scale, file=where or file)
        if other := found.get(contact.name.lower()):
            named = f"two contacts have the name {other.name} (some solvers ignore case)"
            raise InputError(named, file=where or file, remedy="use two names")
        x, y, z = (to_surface @ [*contact.point, 1.0])[:3].tolist()
        found[contact.name.lower()] = contact._replace(point=(x, y, z))
    if not found:
        raise InputError("there is no contact", file=file, remedy=_FORM)
    return tuple(found.values())


def _of_mapping(given: Any) -> Iterable[tuple[Any, Any, None]]:
    if not isinstance(given, Mapping):
        raise InputError(f"{type(given).__name__} is no table of contacts", remedy='give {"A1": (x, y, z, radius)}')
    return ((name, values, None) for name, values in given.items())


def _rows(table: Any, file: Path | None, scale: float) -> Iterable[tuple[Any, Any, str | None]]:
    """Name, coordinates and radius, in units of `scale` mm, of each row of a table, and its line in the file."""
    wrong = [name for name in ("name", "x", "y", "z") if list(table.columns).count(name) != 1]
    if wrong:
        how = "two columns" if wrong[0] in table.columns else "no column"
        what = f"has {how} {wrong[0]} (its columns: {', '.join(map(str, table.columns))})"
        raise InputError(f"the table of electrodes {what}", file=file, remedy=_HEADER)
    every = table.to_dict("records")
    unknown = [str(row["name"]) for row in every if all(_is_missing(row[axis]) for axis in "xyz")]
    if unknown:
        what = f"contacts without coordinates: {', '.join(unknown)}"
        raise InputError(what, file=file, remedy="give a table without these rows")
    for line, row in zip(table.index, every, strict=True):
        size, radius = row.get("size", MISSING), row.get("radius", MISSING)
        if not _is_missing(size) and _is_missing(radius):
            area = _number(size)
            radius = math.sqrt(area / math.pi) / scale if area > 0 else size
        values = [row["x"], row["y"], row["z"], *([] if _is_missing(radius) else [radius])]
        yield row["name"], values, None if file is None else f"{file}, line {line}"


def _contact(name: Any, values: Any, scale: float, *, file: object) -> Contact:
    """One contact in mm; InputError names it and the value."""
    name = str(name) if isinstance(name, int | np.integer) else name
    if not (isinstance(name, str) and re.fullmatch(NAME, name)):
        what = f"{name!r} cannot be the name of a contact"
        remedy = "use letters, digits, -, _ and ', a letter or digit first, at most 40"
        raise InputError(what, file=file, remedy=remedy)
    if not isinstance(values, list | tuple | np.ndarray) or len(values) not in (3, 4):
        raise InputError(f"electrode {name}: {values!r} are no coordinates", file=file, remedy=_FORM)
    numbers = [scale * _number(value) for value in values[:3]]
    radius = None if len(values) == 3 or values[3] is None else scale * _number(values[3])
    if not all(map(math.isfinite, numbers)):
        what = f"electrode {name} has the coordinates {', '.join(map(str, values[:3]))}"
        raise InputError(what, file=file, remedy="give three numbers, with decimal points, or leave the contact out")
    if radius is not None and not 0 < radius <= MOST_RADIUS:
        what = f"electrode {name} has the radius or size {values[3]}"
        raise InputError(what, file=file, remedy=f"give a radius above 0 and up to {MOST_RADIUS:g} mm, or none")
    x, y, z = numbers
    return Contact(name, (x, y, z), radius)


def _number(value: Any) -> float:
    try:
        return math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        return math.nan


def _is_missing(value: Any) -> bool:
    return value is None or value in ("", MISSING) or (isinstance(value, float) and math.isnan(value))


def coordinate_system(table: Path) -> Path | None:
    """The `*_coordsystem.json` beside a table of BIDS; None without one."""
    if not table.name.endswith(_ENDING):
        return None
    stem = table.name.removesuffix(_ENDING)
    names = dict.fromkeys([stem, re.sub("_space-[^_]+", "", stem)])
    files = (table.with_name(f"{name}_coordsystem.json") for name in names)
    return next((one for one in files if one.is_file()), None)


def _system(table: Path, frame: CoordinateFrame) -> tuple[FloatArray, float | None]:
    """The matrix from the coordinates of a table of BIDS to those of the surface, and the length of their unit, mm.

    The `*_coordsystem.json` beside the table states both. Without it the name of the table may state a space,
    `space-NAME`; else the coordinates are the surface's. The unit is then None.
    """
    file, unit = coordinate_system(table), None
    named = re.search("_space-([^_]+)", table.name) if table.name.endswith(_ENDING) else None
    system: object = named[1] if named else _OWN
    if file is not None:
        with by_library("a coordinate system", file):
            record: Any = json.loads(content(file))
            system, unit = (record.get(f"iEEG{key}") or record.get(f"EEG{key}") for key in _KEYS)
        if not isinstance(unit, str) or unit not in UNITS:
            remedy = f"state one of {', '.join(UNITS)} as iEEGCoordinateUnits"
            raise InputError(f"the coordinates of the electrodes are in the unit {unit}", file=file, remedy=remedy)
    length = UNITS[unit] if unit else None
    if system == _SCANNER and frame.is_placed:
        return np.linalg.inv(frame.to_scanner).astype(np.float64), length
    if system != _OWN:
        why = ", and the surface does not state its location in the scanner" if system == _SCANNER else ""
        raise InputError(
            f"the electrodes are in the space {system}, not in the coordinates of the surface{why}",
            file=file or table,
            remedy=f"transform them to the coordinates of the surface, and call the space {_OWN}",
        )
    return np.eye(4), length


_ENDING = "_electrodes.tsv"
_KEYS = ("CoordinateSystem", "CoordinateUnits")
