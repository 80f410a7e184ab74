"""File formats of tetrahedral meshes and of their boundary, by name. Each is one module, and none knows another.

The configuration, the command line, export and verification all read this list. A module loads when its format is first
used, so naming formats costs nothing.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from cortet.errors import InputError

if TYPE_CHECKING:
    from cortet.formats.as_read import AsRead
    from cortet.meshes import TetMesh, TriSurface


@dataclass(frozen=True)
class Format:
    """A format, whose module has the functions `read`, `write` and, if its solver sees more than a mesh, `as_read`."""

    name: str
    #: end of the file name that identifies the format, with the dot
    suffix: str
    #: module in `cortet.formats`
    module: str
    #: suffix of the names of its functions, if the module has several formats
    variant: str = ""
    #: whether `read` and `write` take a `unit` of the coordinates, mm or um, because the file does not state it
    has_unit: bool = False
    #: whether it holds only the boundary, as a TriSurface
    is_surface: bool = False
    #: largest rounding of coordinates and fields, of the largest number
    rounding: float = 1e-9
    #: whether it holds named sets of faces
    names_faces: bool = True
    #: whether its files get q of each tetrahedron, as those that viewers open do
    has_q: bool = False

    def read(self, path: Path, **options: Any) -> Any:
        """The TetMesh of a file, or the boundary as a TriSurface; raises InputError if the file cannot be read."""
        return getattr(self._loaded, f"read{self.variant}")(path, **options)

    def write(self, content: TetMesh | TriSurface, path: Path, **options: Any) -> None:
        """Write a TetMesh, or a TriSurface if the format is that of a surface."""
        getattr(self._loaded, f"write{self.variant}")(content, path, **options)

    def as_read(self, path: Path) -> AsRead | TriSurface:
        """The file as its solver reads it; raises InputError if it cannot be read."""
        from cortet.formats.as_read import AsRead

        own = getattr(self._loaded, f"as_read{self.variant}", None)
        if own is None:
            content = self.read(path)
            return content if self.is_surface else AsRead(content)
        seen: AsRead = own(path)
        return seen

    @property
    def _loaded(self) -> ModuleType:
        return import_module(f"{__name__}.{self.module}")


FORMATS: dict[str, Format] = {
    form.name: form
    for form in (
        Format("vtu", ".vtu", "vtu", has_q=True),
        Format("vtk", ".vtk", "vtk", has_q=True),
        Format("braingrowth", ".mesh", "braingrowth", names_faces=False),
        Format("abaqus", ".inp", "abaqus"),
        Format("febio", ".feb", "febio"),
        Format("fenics", ".xdmf", "fenics", has_q=True),
        Format("gmsh_v2", ".v2.msh", "msh", "_v2"),
        Format("gmsh", ".msh", "msh"),
        Format("nastran", ".bdf", "nastran"),
        Format("carp", ".pts", "carp", has_unit=True),
        Format("carp_binary", ".bpts", "carp", "_binary", has_unit=True, rounding=1e-6),
        Format("stl", ".stl", "stl", is_surface=True, names_faces=False, rounding=1e-6),
        Format("gifti", ".surf.gii", "gifti", "_surface", is_surface=True, names_faces=False, rounding=1e-6),
    )
}


def format_of(path: Path) -> Format:
    """The format of a file, by the end of its name.

    Raises
    ------
    InputError
        the name ends like that of no format
    """
    for form in FORMATS.values():
        if path.name.endswith(form.suffix):
            return form
    endings = ", ".join(form.suffix for form in FORMATS.values())
    raise InputError("is of no known mesh format", file=path, remedy=f"use a name ending in {endings}")


def read_mesh(path: Path) -> TetMesh:
    """The mesh of a file, in the format of its suffix; InputError if it holds a surface, or cannot be read."""
    form = format_of(path)
    if form.is_surface:
        raise InputError("holds a surface, not a mesh", file=path, remedy="give a mesh of tetrahedra")
    mesh: TetMesh = form.read(path)
    return mesh


def require_holes(holes: Collection[str], solver: str) -> None:
    """Raise InputError for holes in a format that names no faces, where a hole would be mistaken for a void."""
    if holes and not FORMATS[solver].names_faces:
        able = ", ".join(form.suffix for form in FORMATS.values() if form.names_faces)
        raise InputError(
            f"{FORMATS[solver].suffix} files cannot tell the hole {next(iter(holes))} from a void",
            remedy=f"write a file that ends in {able}, or leave the hole out",
        )
