"""File formats of tetrahedral meshes and of their boundary, by name. Each is one module, and none knows another.

The configuration, the command line and export all read this list. A module loads when its format is first
used, so naming formats costs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.errors import InputError

if TYPE_CHECKING:
    from cortet.meshes import CoordinateFrame, TetMesh

#: what a format may hold beside nodes, tetrahedra and numbers of regions: fields and sets
_ALL = frozenset({"point_data", "cell_data", "nodes", "faces", "cells"})


@dataclass(frozen=True)
class Format:
    """A format, whose module has the function `write`."""

    name: str
    #: end of the file name that identifies the format, with the dot
    suffix: str
    #: module in `cortet.formats`, and its function
    module: str
    function: str = "write"
    #: fields and sets that it holds: names of `_ALL`, and of single fields
    holds: frozenset[str] = frozenset()
    #: whether each element has one group of a name: a region, a part of the surface or an interface
    has_groups: bool = False
    #: whether `write` takes a `unit` of the coordinates, mm or um, because the file does not state it
    has_unit: bool = False
    #: whether it holds only the boundary, as a TriSurface
    is_surface: bool = False
    #: whether its files get q of each tetrahedron, as those that viewers open do
    has_q: bool = False

    def write(self, mesh: TetMesh, path: Path, *, unit: str = "um", frame: CoordinateFrame | None = None) -> None:
        """Write a mesh, or its boundary if the format is that of a surface.

        Parameters
        ----------
        unit : of the coordinates, mm or um, where the file does not state it
        frame : coordinate system, which files of surfaces state
        """
        write = getattr(import_module(f"{__name__}.{self.module}"), self.function)
        if self.is_surface:
            from cortet.geometry.topology import boundary_with_fields  # loads Numba and SciPy

            surface = boundary_with_fields(mesh)
            write(surface if frame is None else replace(surface, frame=frame), path)
        else:
            write(mesh, path, **({"unit": unit} if self.has_unit else {}))


FORMATS: dict[str, Format] = {
    form.name: form
    for form in (
        Format("vtu", ".vtu", "vtu", holds=_ALL, has_q=True),
        Format("braingrowth", ".mesh", "braingrowth"),
        Format("abaqus", ".inp", "abaqus", holds=_ALL - {"cell_data"}),
        Format("febio", ".feb", "febio", holds=_ALL - {"cell_data"}),
        Format("fenics", ".xdmf", "fenics", holds=_ALL, has_q=True),
        Format("gmsh", ".msh", "msh", holds=frozenset({"point_data", "cell_data"}), has_groups=True),
        Format("nastran", ".bdf", "nastran", has_groups=True),
        Format(
            "carp",
            ".pts",
            "carp",
            holds=frozenset({"point_data", "nodes", "faces", "fibre"}),
            has_groups=True,
            has_unit=True,
        ),
        Format("stl", ".stl", "stl", is_surface=True),
        Format("gifti", ".surf.gii", "gifti", "write_surface", holds=frozenset({"point_data"}), is_surface=True),
    )
}


def format_of(path: Path) -> Format:
    """The format in which a file is written, by the end of its name; InputError if that is of no format."""
    for form in FORMATS.values():
        if path.name.endswith(form.suffix):
            return form
    endings = ", ".join(form.suffix for form in FORMATS.values())
    what, remedy = "has a file extension that cortet does not write", f"use a name ending in {endings}"
    raise InputError(what, file=path, remedy=remedy)


def read_mesh(path: Path, *, unit: str = "um") -> TetMesh:
    """The mesh of a file, by the end of its name; InputError if it has no tetrahedra, or cannot be read.

    Parameters
    ----------
    unit : of the coordinates of a CARP file, mm or um
    """
    from cortet.formats import by_meshio, carp, vtu

    if path.name.endswith((".stl", ".gii")):
        raise InputError("has no tetrahedra", file=path, remedy="give a mesh of tetrahedra")
    if path.suffix == ".pts":
        return carp.read(path, unit=unit)
    if path.suffix == ".vtu":
        return vtu.read(path)
    if path.suffix in by_meshio.READERS:
        return by_meshio.read(path)
    remedy = f"give the .vtu of the mesh, or a file that ends in {', '.join(['.pts', *by_meshio.READERS])}"
    raise InputError("has a file extension that cortet does not read as a mesh", file=path, remedy=remedy)
