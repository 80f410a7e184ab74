"""Check a written solver file against the conventions of its solver, from the bytes on disk and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cortet.errors import InputError
from cortet.formats import carp, fenics, gifti, msh, stl, vtu
from cortet.mesh import TetMesh, TriSurface
from cortet.verify import abaqus, braingrowth, febio
from cortet.verify.conventions import AsRead, broken_conventions, broken_surface
from cortet.verify.sidecar import stale


def _carp(mesh: TetMesh) -> AsRead:
    return AsRead(mesh, lists_faces=bool(mesh.sets.faces))


#: format of a solver -> reads a file as that solver does
SOLVERS: dict[str, Callable[[Path], AsRead | TriSurface]] = {
    "vtu": lambda path: AsRead(vtu.read(path), lists_faces=False),
    "braingrowth": braingrowth.as_read,
    "abaqus": abaqus.as_read,
    "febio": febio.as_read,
    "fenics": lambda path: AsRead(fenics.read(path)),
    "gmsh": lambda path: AsRead(msh.read(path)),
    "carp": lambda path: _carp(carp.read(path)),
    "carp_binary": lambda path: _carp(carp.read_binary(path)),
    "stl": stl.read,
    "gifti": gifti.read_surface,
}


def verify(path: str | Path, solver: str) -> list[str]:
    """Name every convention of a solver that the file breaks; an empty list means it may be run.

    Where the file has a sidecar, fields that are not as it records them count too.

    Parameters
    ----------
    solver : a key of `SOLVERS`
    """
    try:
        file = read_as(path, solver)
        mesh = file if isinstance(file, TriSurface) else file.mesh
        return [*problems(file), *stale(Path(path), mesh)]
    except InputError as error:
        return [error.what]


def read_as(path: str | Path, solver: str) -> AsRead | TriSurface:
    """The file as its solver reads it; raises InputError where that cannot be."""
    return SOLVERS[solver](Path(path))


def problems(file: AsRead | TriSurface) -> list[str]:
    """Name every convention that what was read breaks."""
    return broken_surface(file) if isinstance(file, TriSurface) else broken_conventions(file)
