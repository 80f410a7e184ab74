"""Types of option values."""

from __future__ import annotations

import argparse
import contextlib
import re
from dataclasses import dataclass
from pathlib import Path

from cortet.geometry.limits import CELL_SIZE_MM, NAME


@dataclass(frozen=True)
class Number:
    """Type of an option: a number within limits, both included."""

    low: float
    high: float
    whole: bool = False
    #: whether `inf` is allowed
    endless: bool = False

    def __call__(self, text: str) -> float:
        """The number in a text; an error names the text and the limits."""
        with contextlib.suppress(ValueError):
            value = int(text) if self.whole else float(text)
            if "_" not in text and (self.low <= value <= self.high or (self.endless and text == "inf")):
                return value
        kind = "a whole number" if self.whole else "a number"
        also = ", or inf" if self.endless else ""
        raise argparse.ArgumentTypeError(f"{text!r} is not {kind} from {self.low:g} to {self.high:.10g}{also}")


def named_file(text: str) -> tuple[str, str]:
    """NAME=FILE."""
    name, equals, file = text.partition("=")
    if not (name and equals and file):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FILE")
    return name, file


def size(text: str) -> tuple[str, float | None]:
    """WHERE=MM, or a volume of cell sizes."""
    from cortet.formats.volumes import is_volume

    where, equals, value = text.rpartition("=")
    if not equals and is_volume(text):
        return text, None
    if not where:
        raise argparse.ArgumentTypeError(f"{text!r} is not REGION=MM, VOLUME:LABELS=MM or a volume of sizes in mm")
    return where, Number(*CELL_SIZE_MM)(value)


def inner_file(text: str) -> tuple[str, str]:
    """[NAME=]FILE of an inner surface."""
    name, equals, file = text.partition("=")
    if not equals or "/" in name:  # the = is part of a path
        return "white", text
    if not (re.fullmatch(NAME, name) and file):
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=FILE, NAME of letters and digits")
    return name, file


class OutputFile(type(Path())):  # type: ignore[misc]
    """A file that a command writes; every other path among its arguments is an input."""


def output_surface(text: str) -> OutputFile:
    """A surface that a command writes: GIfTI."""
    if not text.endswith(".gii"):
        raise argparse.ArgumentTypeError(f"{text!r} is not the name of a GIfTI file; end it in .surf.gii")
    return OutputFile(text)


class CheckedOutput(type(Path())):  # type: ignore[misc]
    """A sheet, or a folder of `cortet run`: the command itself refuses one that cortet did not make."""


class FolderOfFiles(type(Path())):  # type: ignore[misc]
    """A folder in which a command writes some files; each file is guarded separately."""


def output_picture(text: str) -> OutputFile:
    """A file to write that ends in .png."""
    if not text.lower().endswith(".png"):
        raise argparse.ArgumentTypeError(f"{text!r} does not end in .png")
    return OutputFile(text)


WRITTEN = (OutputFile, CheckedOutput, FolderOfFiles)
