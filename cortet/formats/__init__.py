"""File formats of tetrahedral meshes and of their boundary by name: one module each, none of which knows another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.errors import InputError
from cortet.formats import abaqus, braingrowth, carp, febio, fenics, gifti, msh, stl, vtu


@dataclass(frozen=True)
class Format:
    """How a format is written and read."""

    #: with the dot, of the file it is known by
    suffix: str
    #: file -> TetMesh, or the boundary as a TriSurface
    read: Callable[..., Any]
    #: (TetMesh, or TriSurface, file) -> None
    write: Callable[..., None]
    #: whether reading and writing take a `unit` of the coordinates, mm or um, that the file does not state
    has_unit: bool = False
    #: whether it holds the boundary alone, as a TriSurface
    is_surface: bool = False


FORMATS = {
    "vtu": Format(".vtu", vtu.read, vtu.write),
    "braingrowth": Format(".mesh", braingrowth.read, braingrowth.write),
    "abaqus": Format(".inp", abaqus.read, abaqus.write),
    "febio": Format(".feb", febio.read, febio.write),
    "fenics": Format(".xdmf", fenics.read, fenics.write),
    "gmsh": Format(".msh", msh.read, msh.write),
    "carp": Format(".pts", carp.read, carp.write, has_unit=True),
    "carp_binary": Format(".bpts", carp.read_binary, carp.write_binary, has_unit=True),
    "stl": Format(".stl", stl.read, stl.write, is_surface=True),
    "gifti": Format(".surf.gii", gifti.read_surface, gifti.write_surface, is_surface=True),
}


def format_of(path: Path) -> str:
    """Name of the format that the end of a file's name stands for.

    Raises
    ------
    InputError
        it stands for none
    """
    for name, form in FORMATS.items():
        if path.name.endswith(form.suffix):
            return name
    endings = ", ".join(form.suffix for form in FORMATS.values())
    raise InputError("is of no known mesh format", file=path, remedy=f"use a name ending in {endings}")
