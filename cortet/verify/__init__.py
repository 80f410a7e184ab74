"""Check a written solver file against the conventions of its solver, from the bytes on disk and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cortet.errors import InputError
from cortet.formats import carp, vtu
from cortet.verify import abaqus, braingrowth
from cortet.verify.conventions import AsRead, broken_conventions

#: solver -> reads a file as that solver does
SOLVERS: dict[str, Callable[[Path], AsRead]] = {
    "braingrowth": braingrowth.as_read,
    "abaqus": abaqus.as_read,
    "carp": lambda path: AsRead(carp.read(path), lists_faces=False),
    "vtu": lambda path: AsRead(vtu.read(path), lists_faces=False),
}


def verify(path: str | Path, solver: str) -> list[str]:
    """Name every convention of a solver that the file breaks; an empty list means it may be run.

    Parameters
    ----------
    solver : a key of `SOLVERS`
    """
    try:
        file = SOLVERS[solver](Path(path))
    except InputError as error:
        return [error.what]
    return broken_conventions(file)
