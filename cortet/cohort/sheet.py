"""The cohort sheet: which surfaces to mesh, and every file name that follows from a row.

A sheet is a table of tab-separated values, one hemisphere (or whole brain) per row:

    participant_id  session_id  hemi  scan_age  surface  include  exclude_reason  [inner]  [cell_size]  [more]

Missing values are `n/a`, as in BIDS. Labels stay strings: participant `007` is not 7.

Names of written files consist only of `participant_id`, `session_id` and `hemi`, which are therefore ASCII letters and
digits. `surface` and `field_...` name files that are only read. They may be relative or absolute, may lead anywhere the
user can read, and are never part of a command.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cortet.cohort.ages import number
from cortet.errors import InputError
from cortet.formats.placement import UNITS
from cortet.formats.tsv import read_tsv, read_uneven_tsv, refusal, write_tsv
from cortet.geometry.limits import CELL_SIZE_MM, NAME, SCAN_AGES
from cortet.meshes import region_names

COLUMNS = ("participant_id", "session_id", "hemi", "scan_age", "surface", "include", "exclude_reason")
#: value that stands, in column `surface`, for a synthetic cortex of the row's age and hemisphere, in column `inner` for
#: the white surface within it, and in column `sphere` for its sphere
PHANTOM = "phantom"
FIELD_PREFIX = "field_"
#: columns `volume_NAME` name the file of a volume, FILE or FILE:KIND
VOLUME_PREFIX = "volume_"
#: columns of inner surfaces: `inner` names that of the region `white`, `inner_NAME` that of the region NAME
INNER, INNER_PREFIX, WHITE = "inner", "inner_", "white"
#: column of the sphere through which a surface is resampled
SPHERE = "sphere"
#: column of the table of contacts, `*_electrodes.tsv`
ELECTRODES = "electrodes"
#: columns for coordinates that are not mm (`gate.unit`), and for a cell size of its own
UNIT, CELL_SIZE = "unit", "cell_size"
#: columns that name one file
_FILES = ("surface", INNER, SPHERE, ELECTRODES)
#: most characters of a label: a file name holds two labels and more, and has at most 255 characters
LONGEST_LABEL = 40

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")
#: words for a hemisphere, in lower case -> letter in file names
HEMISPHERES = {"l": "L", "left": "L", "lh": "L", "r": "R", "right": "R", "rh": "R"}
MISSING = {"", "n/a"}
#: names of sets that every mesh for a solver has
_STANDING = ("core", "tissue")
#: words of a decision, in lower case
YES, NO = {"yes", "true", "1"}, {"no", "false", "0"}


@dataclass(frozen=True)
class Case:
    """One row of the sheet."""

    #: BIDS label without `sub-`
    participant: str
    #: BIDS label without `ses-`; None where the study has no sessions
    session: str | None
    #: L, R, or None for a whole brain
    hemi: str | None
    #: gestational age at scan, weeks; None if it is not known: the case is then neither smoothed by age nor folded
    scan_age: float | None
    #: GIfTI file, or `PHANTOM`
    surface: Path | str
    include: bool = True
    #: why the row is excluded; empty if it is not
    exclude_reason: str = ""
    #: per-vertex fields, name -> GIfTI file
    fields: dict[str, Path] = field(default_factory=dict)
    #: volumes, name -> FILE or FILE:KIND
    volumes: Mapping[str, str] = field(default_factory=dict)
    #: surfaces inside `surface`: name of the region within -> GIfTI file, or `PHANTOM` for the region `white`
    inner: Mapping[str, Path | str] = field(default_factory=dict)
    #: sphere of `surface`, or `PHANTOM`; None if there is none
    sphere: Path | str | None = None
    #: table of contacts of electrodes; None if there is none
    electrodes: Path | None = None
    #: unit of the coordinates; None: as the configuration says
    unit: str | None = None
    #: cell size, mm; None: those of the configuration
    cell_size: float | None = None
    #: further columns of the sheet, carried through
    extra: dict[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """File name prefix, e.g. sub-01_ses-02_hemi-L."""
        parts = (("sub", self.participant), ("ses", self.session), ("hemi", self.hemi))
        return "_".join(f"{key}-{value}" for key, value in parts if value is not None)

    @property
    def folder(self) -> str:
        """Folder below the output folder, e.g. sub-01/ses-02."""
        return f"sub-{self.participant}" + (f"/ses-{self.session}" if self.session is not None else "")

    @property
    def files(self) -> list[Path]:
        """All surfaces, fields and contacts that the row names."""
        named = [self.surface, self.sphere, self.electrodes, *self.inner.values(), *self.fields.values()]
        return [file for file in named if isinstance(file, Path)]

    @property
    def is_phantom(self) -> bool:
        """Whether the surface is generated rather than read."""
        return self.surface == PHANTOM


def read_sheet(path: Path) -> list[Case]:
    """The rows of a cohort sheet, excluded ones too.

    Parameters
    ----------
    path : the sheet; relative file names in it are relative to its folder

    Raises
    ------
    InputError : lists the problems of the sheet, each with its line, column, value and remedy
    """
    if not os.path.lexists(path):
        raise InputError("no such sheet", file=path, remedy=f"create the sheet: cortet cohort scan DATASET -o {path}")
    table, miscounted = read_uneven_tsv(path)
    _check_header(list(table.columns), path)
    found: list[str] = [] if len(table) else ["no rows below the header (add one row per hemisphere)"]
    lines: dict[str, int] = {}
    cases: list[Case] = []
    for line, row in zip(table.index, table.to_dict("records"), strict=True):
        wrong = [miscounted[line]] if line in miscounted else list(_row_problems(row))
        if not wrong:
            cases.append(_case(row, path.parent))
            wrong += _region_problems(cases[-1])
            name = cases[-1].name
            if (other := lines.setdefault(name.lower(), line)) != line:
                wrong.append(
                    f"columns participant_id, session_id, hemi: {name} is already in line {other} "
                    "(give every hemisphere one row, and a label that differs in more than case)"
                )
        found += [f"line {line}, {problem}" for problem in wrong]
    if found:
        raise refusal(found, path)
    return cases


def _region_problems(case: Case) -> list[str]:
    """What is wrong with the names of the regions of a case, together."""
    try:
        region_names(case.inner)
    except InputError as error:
        return [f"column {INNER}: {error}"]
    return []


def read_header(path: Path) -> list[str]:
    """The columns of a cohort sheet."""
    header = list(read_uneven_tsv(path)[0].columns)
    _check_header(header, path)
    return header


def _check_header(header: Sequence[str], path: Path) -> None:
    remedy = "the first line must name, separated by tabs: " + ", ".join(COLUMNS)
    if absent := [name for name in COLUMNS if name not in header]:
        raise InputError(f"line 1: no column {', '.join(absent)}", file=path, remedy=remedy)
    if "" in header:
        raise InputError(f"line 1: column {header.index('') + 1} has no name", file=path, remedy=remedy)
    if len(set(header)) < len(header):
        raise InputError("line 1: two columns have the same name", file=path, remedy=remedy)
    if {INNER, INNER_PREFIX + WHITE} <= {*header}:
        what = f"line 1: columns {INNER} and {INNER_PREFIX}{WHITE} name the same region"
        raise InputError(what, file=path, remedy="keep only one of them")


def write_sheet(cases: Sequence[Case], path: Path) -> None:
    """Write cases as a cohort sheet, complete or not at all.

    A file below the parent of the sheet's folder gets a name relative to that folder.
    """
    rows = [_row(case, path.parent) for case in cases]
    further = (column for row in rows for column in row)
    write_tsv(rows, list(dict.fromkeys([*COLUMNS, *further])), path)


def add_to_sheet(cases: Sequence[Case], path: Path) -> list[Case]:
    """Append cases to an existing cohort sheet, whose rows stay as they are; returns the new cases.

    A case is new if the sheet has none of its name. It gets `n/a` in columns that it has no value for.
    """
    import pandas as pd

    known = {case.name for case in read_sheet(path)}
    table = read_tsv(path)
    new = [case for case in cases if case.name not in known]
    rows = pd.DataFrame([_row(case, path.parent) for case in new], dtype=object)
    write_tsv(pd.concat([table, rows]), list(dict.fromkeys([*table.columns, *rows.columns])), path)
    return new


def _row(case: Case, folder: Path) -> dict[str, str | float | None]:
    """The row of a case in a sheet in `folder`; None for a missing value."""
    files = {
        "surface": case.surface,
        **{column_of(name): file for name, file in case.inner.items()},
        **({SPHERE: case.sphere} if case.sphere else {}),
        **({ELECTRODES: case.electrodes} if case.electrodes else {}),
        **{FIELD_PREFIX + name: file for name, file in case.fields.items()},
        **{VOLUME_PREFIX + name: file for name, file in case.volumes.items()},
    }
    return {
        "participant_id": f"sub-{case.participant}",
        "session_id": f"ses-{case.session}" if case.session is not None else None,
        "hemi": case.hemi,
        "scan_age": case.scan_age,
        "include": "yes" if case.include else "no",
        "exclude_reason": case.exclude_reason,
        **{column: _relative(file, folder) for column, file in files.items()},
        **({UNIT: case.unit} if case.unit else {}),
        **({CELL_SIZE: case.cell_size} if case.cell_size else {}),
        **case.extra,
    }


def _row_problems(row: Mapping[str, str]) -> Iterator[str]:
    """What is wrong with one row, each as `column NAME: VALUE ... (remedy)`."""
    for column, prefix in (("participant_id", "sub-"), ("session_id", "ses-")):
        label = row[column].removeprefix(prefix)
        if column == "participant_id" or label not in MISSING:
            yield from _name_problems(column, label, "BIDS label", "[A-Za-z0-9]+")
    if row["hemi"].lower() not in HEMISPHERES and row["hemi"] not in MISSING:
        yield f"column hemi: {row['hemi']!r} is not a hemisphere (use L, R, or n/a for a whole brain)"
    if row["include"].lower() not in YES | NO:
        yield f"column include: {row['include']!r} is neither yes nor no (use yes or no)"
    if row["include"].lower() in NO and row["exclude_reason"] in MISSING:
        yield f"column exclude_reason: {row['exclude_reason']!r} is not a reason for the exclusion (give a reason)"
    if row["surface"] in MISSING:
        yield f"column surface: {row['surface']!r} is not a file (give a GIfTI surface, or {PHANTOM})"
    youngest, oldest = SCAN_AGES
    if row["scan_age"] not in MISSING and not youngest <= (number(row["scan_age"]) or math.nan) <= oldest:
        yield (
            f"column scan_age: {row['scan_age']!r} is not an age in gestational weeks "
            f"(use a number from {youngest:g} to {oldest:g}, or n/a if the age is unknown; "
            "the surface is then not smoothed by age)"
        )
    for column, value in row.items():
        yield from _value_problems(column, value)
        yield from _phantom_problems(column, value, row["surface"])


def _name_problems(column: str, name: str, what: str, pattern: str = NAME) -> Iterator[str]:
    """What is wrong with a label, or with the name of a region or a volume."""
    if not re.fullmatch(pattern, name):
        yield f"column {column}: {name!r} is not a {what} (use letters and digits only)"
    if len(name) > LONGEST_LABEL:
        yield f"column {column}: {len(name)} characters are too long (use at most {LONGEST_LABEL})"


def _value_problems(column: str, value: str) -> Iterator[str]:
    """What is wrong with a column, or with its value, whatever the other columns hold."""
    region = _region(column)
    if region is not None:
        yield from _name_problems(column, region, "name of a region")
    if column.startswith(VOLUME_PREFIX):
        yield from _name_problems(column, column.removeprefix(VOLUME_PREFIX), "name of a volume")
    if region in _STANDING and value not in MISSING:
        yield f"column {column}: {region!r} is a reserved name in every mesh (use another name)"
    if column == "affine" and value not in MISSING:
        yield "column affine: is no longer supported (map the coordinates to mm first: see CHANGELOG.md)"
    if column == UNIT and value not in (*UNITS, *MISSING):
        yield f"column {column}: {value!r} is not a unit (use {', '.join(UNITS)})"
    if column == CELL_SIZE and value not in MISSING and not _is_cell_size(number(value)):
        smallest, largest = CELL_SIZE_MM
        yield (
            f"column {column}: {value!r} is not a cell size (use a number from {smallest:g} to {largest:g}, mm, a "
            "multiple of 0.001, or n/a for the sizes of the configuration)"
        )
    if _names_files(column) and not is_file_name(value):
        yield (
            f"column {column}: {value!r} cannot be a file name here "
            "(avoid braces, wildcards, control characters and long names)"
        )
    elif _CONTROL.search(value):
        yield f"column {column}: {value!r} holds a control character (delete it)"


def _phantom_problems(column: str, value: str, surface: str) -> Iterator[str]:
    """What a phantom lacks, or has that only a file can have, and the reverse."""
    if surface == PHANTOM and column in ("hemi", "scan_age") and value in MISSING:
        use = "L or R" if column == "hemi" else "a number, gestational weeks"
        yield f"column {column}: {value!r}, but a {PHANTOM} needs a hemisphere and an age (use {use})"
    both = column in (INNER, SPHERE) and value == surface
    if (column == SPHERE or _region(column)) and PHANTOM in (value, surface) and value not in MISSING and not both:
        use = PHANTOM if column in (INNER, SPHERE) else "files"
        yield (
            f"column {column}: {value!r} cannot be combined with {surface!r} in the column surface "
            f"(use {use} in both columns, or n/a here)"
        )


def _names_files(column: str) -> bool:
    """Whether the values of a column are names of files."""
    return column in _FILES or column.startswith((INNER_PREFIX, FIELD_PREFIX, VOLUME_PREFIX))


def _region(column: str) -> str | None:
    """The region whose surface a column names; None for other columns."""
    if column == INNER:
        return WHITE
    return column.removeprefix(INNER_PREFIX) if column.startswith(INNER_PREFIX) else None


def column_of(region: str) -> str:
    """The column that names the surface of a region; of the outer surface, if that is empty."""
    return (INNER if region == WHITE else INNER_PREFIX + region) if region else "surface"


def _is_cell_size(value: float | None) -> bool:
    """Whether a number is a cell size that names of files can tell, mm."""
    if value is None or not CELL_SIZE_MM[0] <= value <= CELL_SIZE_MM[1]:
        return False
    return abs(1000 * value - round(1000 * value)) < 1e-6


def is_file_name(text: str) -> bool:
    """Whether a file of this name can be an input of the workflow."""
    if re.search(r"[{}*?]", text) or _CONTROL.search(text):
        return False
    name = os.fsencode(text)
    return len(name) < 4096 and max(map(len, name.split(b"/"))) < 256  # what Linux takes


def _case(row: Mapping[str, str], folder: Path) -> Case:
    """The case of a valid row."""
    given = {column: value for column, value in row.items() if value not in MISSING}

    def located(prefix: str) -> dict[str, Any]:
        """The files of the columns that begin with a prefix, by the rest of their names."""
        own = {column: value for column, value in given.items() if column.startswith(prefix)}
        return {column.removeprefix(prefix): _located(value, folder) for column, value in own.items()}

    inner = {region: _located(value, folder) for name, value in given.items() if (region := _region(name))}
    alone: dict[str, Any] = {name: _located(given[name], folder) for name in _FILES if name in given}
    include = row["include"].lower() in YES
    return Case(
        participant=row["participant_id"].removeprefix("sub-"),
        session=None if row["session_id"].removeprefix("ses-") in MISSING else row["session_id"].removeprefix("ses-"),
        hemi=HEMISPHERES[given["hemi"].lower()] if "hemi" in given else None,
        scan_age=number(row["scan_age"]),
        surface=alone["surface"],
        include=include,
        exclude_reason="" if include else row["exclude_reason"],
        fields=located(FIELD_PREFIX),
        volumes={name: str(file) for name, file in located(VOLUME_PREFIX).items()},
        inner=inner,
        sphere=alone.get(SPHERE),
        electrodes=alone.get(ELECTRODES),
        unit=given.get(UNIT),
        cell_size=number(row.get(CELL_SIZE, "n/a")),
        extra={name: value for name, value in row.items() if not _is_known(name)},
    )


def _is_known(column: str) -> bool:
    """Whether a column has a meaning here; others are carried through."""
    return column in (*COLUMNS, UNIT, CELL_SIZE) or _names_files(column)


def _located(name: str, folder: Path) -> Path | str:
    """A file named in a sheet, from the folder of the sheet, or `PHANTOM`; `a/../b` becomes `b`.

    A file below the working folder has one spelling, relative to it, since Snakemake runs jobs again for another one.
    """
    if name == PHANTOM:
        return PHANTOM
    path = Path(os.path.normpath(folder / name))
    whole, here = Path(os.path.normpath(path.absolute())), Path.cwd()
    return whole.relative_to(here) if whole.is_relative_to(here) else path


def _relative(path: Path | str, folder: Path) -> str:
    """`path` as a sheet in `folder` names it: relative below the folder's parent, absolute elsewhere.

    A link keeps its own name, which says what it is; DataLad keeps content under names that do not.
    """
    if path == PHANTOM:
        return PHANTOM
    target, start = Path(path).parent.resolve() / Path(path).name, folder.resolve()
    return os.path.relpath(target, start) if target.is_relative_to(start.parent) else str(target)
