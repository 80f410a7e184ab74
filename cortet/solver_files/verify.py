"""Verification of a solver file against the conventions of its solver, from its bytes on disk alone."""

from __future__ import annotations

from pathlib import Path

from cortet.errors import InputError
from cortet.formats import FORMATS
from cortet.formats.as_read import AsRead
from cortet.meshes import TriSurface
from cortet.solver_files.conventions import broken_conventions, broken_surface
from cortet.solver_files.sidecar import stale


def verify(path: str | Path, solver: str) -> list[str]:
    """Name every convention of a solver that the file breaks; if the list is empty, the solver may run on it.

    If the file has a sidecar, fields that differ from it count as well.

    Parameters
    ----------
    solver : a key of `formats.FORMATS`
    """
    try:
        file = FORMATS[solver].as_read(Path(path))
        mesh = file if isinstance(file, TriSurface) else file.mesh
        return [*problems(file), *stale(Path(path), mesh)]
    except InputError as error:
        return [error.what]


def problems(file: AsRead | TriSurface, *, body: bool = True) -> list[str]:
    """Name every convention that a file, already read, breaks.

    Parameters
    ----------
    body : whether to check, too, that the tetrahedra of a mesh fill a body
    """
    return broken_surface(file) if isinstance(file, TriSurface) else broken_conventions(file, body=body)
