"""Types of arguments and options: what each may say, and what it becomes."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter, Token

from cortet.errors import UsageError
from cortet.formats import FORMATS
from cortet.geometry.limits import CELL_SIZE_MM, MOST_LAYERS, NAME


@dataclass(frozen=True)
class Number:
    """Converter of an option whose values are numbers within limits, both included."""

    low: float
    high: float
    whole: bool = False

    def __call__(self, _: object, tokens: Sequence[Token]) -> Any:
        """The number, or the numbers if there are several."""
        first, *more = [self.read(token.value) for token in tokens]
        return (first, *more) if more else first

    def read(self, text: str) -> float:
        """The number in a text; an error names the text and the limits."""
        with contextlib.suppress(ValueError):
            value = int(text) if self.whole else float(text)
            if "_" not in text and self.low <= value <= self.high:
                return value
        kind = "a whole number" if self.whole else "a number"
        raise ValueError(f"{text!r} is not {kind} from {self.low:g} to {self.high:.10g}")


def number(low: float, high: float, unit: str, *, whole: bool = False) -> Parameter:
    """An option whose value is a number within limits; help shows the unit in its place."""
    return Parameter(converter=Number(low, high, whole), metavar=unit)


def pairs(read: Callable[[str], tuple[Any, Any]], form: str, shown: str | None = None) -> Parameter:
    """An option that may be repeated, as pairs of a name and a value; UsageError if a name comes twice.

    Parameters
    ----------
    read : the pair in a text, or ValueError
    form, shown : of the text, as errors and as help say it
    """

    def read_all(_: object, tokens: Sequence[Token]) -> list[tuple[Any, Any]]:
        found = [read(token.value) for token in tokens]
        names = [name for name, _ in found]
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise UsageError(f"{tokens[0].keyword} names {twice} twice", remedy=f"use two names: {form}")
        return found

    return Parameter(converter=read_all, n_tokens=1, metavar=shown or form)


def named_file(text: str) -> tuple[str, str]:
    """NAME=FILE."""
    name, equals, file = text.partition("=")
    if not (name and equals and file):
        raise ValueError(f"{text!r} is not NAME=FILE")
    return name, file


def size(text: str) -> tuple[str, float]:
    """REGION=MM."""
    region, _, value = text.partition("=")
    if not (region and value):
        raise ValueError(f"{text!r} is not REGION=MM")
    return region, Number(*CELL_SIZE_MM).read(value)


def inner_file(text: str) -> tuple[str, str]:
    """[NAME=]FILE of an inner surface."""
    name, equals, file = text.partition("=")
    if not equals or "/" in name:  # the = is part of a path
        return "white", text
    if not (re.fullmatch(NAME, name) and file):
        raise ValueError(f"{text!r} is not NAME=FILE with a NAME of letters and digits")
    return name, file


def electrode(text: str) -> tuple[str, tuple[float, ...]]:
    """NAME=X,Y,Z[,RADIUS]."""
    name, _, numbers = text.partition("=")
    with contextlib.suppress(ValueError):
        values = tuple(float(value) for value in numbers.split(","))
        if name and len(values) in (3, 4):
            return name, values
    raise ValueError(f"{text!r} is not NAME=X,Y,Z or NAME=X,Y,Z,RADIUS")


class OutputFile(type(Path())):  # type: ignore[misc]
    """A file that a command writes; every other path among its arguments is an input."""


class CheckedOutput(type(Path())):  # type: ignore[misc]
    """A sheet, or the folder of a run or a workflow: the command itself refuses one that cortet did not make."""


class FolderOfFiles(type(Path())):  # type: ignore[misc]
    """A folder in which a command writes some files; each file is guarded separately."""


WRITTEN = (OutputFile, CheckedOutput, FolderOfFiles)


def _written(metavar: str, *endings: str) -> Parameter:
    """A file that a command writes, whose name has one of these endings; messages propose the first."""

    def read(_: object, tokens: Sequence[Token]) -> OutputFile:
        text = tokens[-1].value
        if not text.endswith(endings):
            raise ValueError(f"{text!r} does not end in {endings[0]}")
        return OutputFile(text)

    return Parameter(converter=read, metavar=metavar)


@dataclass(frozen=True)
class Below:
    """A depth, or both ends of a range: mm, or `relative`, parts of the cortex."""

    first: float
    last: float
    relative: bool


def _depth(_: object, tokens: Sequence[Token]) -> Below:
    """MM, or a range FROM:TO; with % at the end parts of the cortex."""
    text = tokens[-1].value
    relative = text.endswith("%")
    ends = [end.removesuffix("%") if relative else end for end in text.split(":")]
    first, *more = [Number(0, 1000 if relative else 100).read(end) for end in ends]
    if len(more) > 1 or first > (last := more[0] if more else first):
        raise ValueError(f"{text!r} must be MM or FROM:TO, with or without a final %")
    scale = 0.01 if relative else 1.0
    return Below(scale * first, scale * last, relative)


def _formats(_: object, tokens: Sequence[Token]) -> list[str]:
    """Names of formats, from their names or the ends of their files, with commas between."""
    known = {form.suffix[1:]: name for name, form in FORMATS.items()} | {name: name for name in FORMATS}
    words = [word.strip().removeprefix(".") for token in tokens for word in token.value.split(",")]
    if (unknown := next((word for word in words if word not in known), None)) is not None:
        known_endings = ", ".join(form.suffix[1:] for form in FORMATS.values())
        raise ValueError(f"{unknown!r} is not a format; use one of {known_endings}")
    return list(dict.fromkeys(known[word] for word in words))


def _layers(_: object, tokens: Sequence[Token]) -> list[float]:
    """The share of each layer, from their number or from shares with commas between."""
    first, *more = tokens[-1].value.split(",")
    if not more:
        return [1.0] * int(Number(1, MOST_LAYERS, whole=True).read(first))
    return [Number(1e-6, 1e6).read(share) for share in (first, *more)]


# Of a docstring help keeps the ends of lines, so longer help stands here.

#: the option `-o`
O = Parameter(alias="-o")  # noqa: E741
SurfaceFile = Annotated[OutputFile, _written("GII", ".surf.gii", ".gii")]
FieldsFile = Annotated[OutputFile, _written("GII", ".func.gii", ".gii")]
Depth = Annotated[
    Below,
    Parameter(
        converter=_depth,
        n_tokens=1,
        accepts_keys=False,
        metavar="MM",
        help="Values at this depth below the surface, or means over a range, 1:3; in % of the cortex, 50% or "
        "0:100%, along the columns of a mesh with a white surface (default: at the surface).",
    ),
]
Layering = Annotated[list[float], Parameter(converter=_layers, n_tokens=1, accepts_keys=False, metavar="N")]
Picture = Annotated[OutputFile, _written("PNG", ".png", ".PNG")]
MeshFile = Annotated[Path, Parameter(name="MESH")]
InputFile = Annotated[Path, Parameter(metavar="FILE")]
CellSize = Annotated[float, number(*CELL_SIZE_MM, "MM")]
Setting = Literal["default", "folding", "cgal", "published"]
Hemisphere = Literal["L", "R"]
Formats = Annotated[
    Sequence[str],
    Parameter(
        converter=_formats,
        n_tokens=1,
        metavar="NAMES",
        help="Files for solvers, by ending: vtu,inp,feb,xdmf,mesh (default: vtu, or those of --config).",
    ),
]
NamedFiles = Annotated[Sequence[tuple[str, str]], pairs(named_file, "NAME=FILE")]
InnerFiles = Annotated[
    Sequence[tuple[str, str]],
    pairs(inner_file, "NAME=FILE", "[NAME=]FILE"),
    Parameter(
        help="Closed surface inside SURFACE that bounds the region NAME (default: white); repeatable.",
    ),
]
Electrodes = Annotated[
    Sequence[tuple[str, tuple[float, ...]]],
    pairs(electrode, "NAME=X,Y,Z[,RADIUS]"),
    Parameter(help="Contact of an electrode, in mm, like the surface; repeatable."),
]
Sizes = Annotated[
    Sequence[tuple[str, float]],
    pairs(size, "REGION=MM"),
    Parameter(help="Smaller cells at the surface of a region, white=0.5; repeatable."),
]
