"""cortet's formats in other programs: PyVista finds its reader by an entry point, meshio after it is registered.

Both get a mesh with the fields and sets of a VTU file of cortet.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from cortet.formats import FORMATS, format_of, vtu
from cortet.formats.untrusted import check_file

if TYPE_CHECKING:
    import meshio
    import pyvista

#: formats that meshio lacks, or reads without what cortet keeps in them
_FOR_MESHIO = ("braingrowth", "febio", "carp", "carp_binary")

#: bytes of a file within which its first word must stand
_BEGINNING = 10_000

T = TypeVar("T")


def read_with_pyvista(path: str | Path, **_: Any) -> pyvista.DataObject:
    """A mesh in a format of cortet as a PyVista grid; meshio still reads `.mesh` files of Medit, as without cortet.

    Raises
    ------
    InputError : the file cannot be read
    """
    import pyvista

    if Path(path).name.endswith(FORMATS["braingrowth"].suffix) and _is_of_medit(Path(path)):
        return pyvista.read_meshio(path)
    return _as_vtu(Path(path), pyvista.read)


def register_with_meshio() -> None:
    """Let `meshio.read` open BrainGrowth's `.mesh`, FEBio's `.feb` and CARP files; Medit's `.mesh` stays as it is."""
    import meshio

    def read(path: str) -> meshio.Mesh:
        return _as_vtu(Path(path), meshio.read)  # no ReadError here: meshio answers its own by ending the program

    for name in _FOR_MESHIO:
        meshio.register_format(f"cortet-{name}", [FORMATS[name].suffix], read, {})


def _is_of_medit(path: Path) -> bool:
    """Whether a file begins like one of Medit, perhaps after comments; for any other, meshio would end the program."""
    check_file(path)
    with path.open("rb") as file:
        lines = [line.strip() for line in file.read(_BEGINNING).splitlines()]
    words = [line for line in lines if line and not line.startswith(b"#")]
    return bool(words) and words[0].startswith(b"MeshVersionFormatted")


def _as_vtu(path: Path, read: Callable[[str], T]) -> T:
    """The result of another reader for a mesh that is written as VTU."""
    mesh = format_of(path).read(path)
    with tempfile.TemporaryDirectory() as folder:
        vtu.write(mesh, file := Path(folder) / "mesh.vtu")
        return read(str(file))
