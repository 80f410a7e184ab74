"""XDMF files of other programs, as meshio writes them: one grid, its arrays in the text or in a `.h5` file beside it.

XDMF and HDF5 may both lead to any other file, so all arrays are checked to lie there. meshio then reads the XML and the
data files that were checked, from a folder of their own: it would follow a link of the `.xdmf` to another folder.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import meshio
import numpy as np

from cortet.errors import DamagedFileError, InputError
from cortet.formats.untrusted import check_file, content_is_elsewhere, sound
from cortet.meshes import TetMesh

#: cells of surfaces, lines and points, which may accompany tetrahedra
_FLAT = {"vertex", "line", "line3", "triangle", "triangle6", "quad", "quad8", "quad9"}
#: most bytes that zlib makes of one
_MOST_UNPACKED = 1032
_REMEDY = "write one mesh of tetrahedra: meshio.write(FILE, mesh)"
#: errors that meshio and h5py raise for files that are damaged or hold something else
_DAMAGED = (
    *(meshio.ReadError, OSError, RuntimeError, ValueError, TypeError, AttributeError, LookupError),
    *(AssertionError, MemoryError, ElementTree.ParseError),
)


def read(path: Path, root: ElementTree.Element) -> TetMesh:
    """The tetrahedra of a file with their fields; cells of surfaces, lines and points are left out.

    Parameters
    ----------
    root : its XML

    Raises
    ------
    InputError
        it has no tetrahedra, or other cells of a volume; its `.h5` file is missing; arrays lie elsewhere; meshio cannot
        read it, as series of times
    """
    try:
        sources = {source for item in root.iter("DataItem") if (source := _beside(item, path))}
        with tempfile.TemporaryDirectory(prefix="cortet-xdmf-") as folder:
            for source in sources:
                (Path(folder) / source.name).symlink_to(source.resolve())
            ElementTree.ElementTree(root).write(Path(folder) / path.stem)
            found = meshio.xdmf.read(Path(folder) / path.stem)
    except _DAMAGED as error:
        told = f"{type(error).__name__}: {error}"
        raise InputError(f"is no XDMF file that meshio reads ({told})", file=path, remedy=_REMEDY) from error
    kinds = [block.type for block in found.cells]
    if other := sorted({*kinds} - _FLAT - {"tetra"}):
        raise InputError(f"holds cells of type {other[0]}, not only tetrahedra", file=path, remedy=_REMEDY)
    if "tetra" not in kinds:
        raise InputError(f"holds no tetrahedra, but {', '.join(kinds) or 'nothing'}", file=path, remedy=_REMEDY)

    def of_tetrahedra(blocks: list[Any]) -> Any:
        return np.concatenate([block for block, kind in zip(blocks, kinds, strict=True) if kind == "tetra"])

    of_cells = {name: of_tetrahedra(blocks) for name, blocks in found.cell_data.items()}
    cells = of_tetrahedra([block.data for block in found.cells])
    return sound(path, found.points, cells, found.point_data, of_cells)


def _beside(item: ElementTree.Element, path: Path) -> Path | None:
    """The HDF5 file beside it that holds the array of a DataItem; None if its text does. Elsewhere is an InputError."""
    form = "another array" if "Reference" in item.attrib else item.get("Format", "XML")
    if form == "XML":
        return None
    if form != "HDF":
        raise InputError(f"has an array from {form}, not from a .h5 file beside it", file=path, remedy=_REMEDY)
    file, _, key = (item.text or "").strip().partition(":")
    source = path.with_name(Path(file).name or path.name)
    if file != source.name:
        raise InputError(f"names the data file `{file}`, not one beside it", file=path, remedy=_REMEDY)
    if not source.exists() and not content_is_elsewhere(source):
        raise InputError(f"lacks its data file {file}", file=path, remedy=f"put {file} beside it; both were written")
    check_file(source)
    with h5py.File(source, "r") as data:
        _require_stored(data, key, source)
    return source


def _require_stored(data: h5py.File, key: str, source: Path) -> None:
    """Raise InputError unless the file itself stores the numbers of a dataset, and as many as it declares."""
    at: Any = data
    for part in key.strip("/").split("/"):
        link = at.get(part, getlink=True) if isinstance(at, h5py.Group) else None
        if not isinstance(link, h5py.HardLink):
            raise DamagedFileError(f"has no dataset {key}", file=source)
        at = at[part]
    if not isinstance(at, h5py.Dataset) or at.dtype.kind not in "iuf" or at.external or at.is_virtual:
        raise DamagedFileError(f"{key} is not an array of numbers", file=source)
    if at.nbytes > at.id.get_storage_size() * (_MOST_UNPACKED if at.compression else 1):
        raise DamagedFileError(f"{key} declares {at.nbytes:,} bytes, which the file does not hold", file=source)
