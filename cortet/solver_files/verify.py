"""Check a written solver file against the conventions of its solver, from the bytes on disk and nothing else."""

from __future__ import annotations

from pathlib import Path

from cortet.errors import InputError
from cortet.formats import FORMATS
from cortet.formats.as_read import AsRead
from cortet.mesh import TriSurface
from cortet.solver_files.conventions import broken_conventions, broken_surface
from cortet.solver_files.sidecar import stale


def verify(path: str | Path, solver: str) -> list[str]:
    """Name every convention of a solver that the file breaks; an empty list means it may be run.

    Where the file has a sidecar, fields that are not as it records them count too.

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
    """Name every convention that what was read breaks.

    Parameters
    ----------
    body : whether to look also for what keeps the tetrahedra of a mesh from filling a body
    """
    return broken_surface(file) if isinstance(file, TriSurface) else broken_conventions(file, body=body)
