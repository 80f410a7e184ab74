"""VTU (VTK XML unstructured grid): the interchange file between stages.

Binary, zlib-compressed, float64: every array, fields included, comes back bit for bit, and ParaView opens the file at
every stage. A VTU file has no sets; arrays stand for them (`set_arrays`).

Files are written in VTK's default form: raw data behind the XML
(https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html). meshio reads those of other programs.
"""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cortet.formats.atomic import atomic_path
from cortet.formats.set_arrays import names_of, with_sets, without_sets
from cortet.formats.untrusted import by_library, content, unreadable
from cortet.meshes import TetMesh

#: bytes that are compressed at a time
_BLOCK = 1 << 20
#: bytes in which a file of cortet says how many nodes it has, after the names of its sets
_BEGIN = 1 << 16

_TYPES = {
    name: np.dtype(name.lower())
    for name in ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Float32", "Float64")
}
_TETRAHEDRON = 10
#: how the files of cortet begin, and what stands before their data
_HEAD = (
    '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
    'header_type="UInt32" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
)
_DATA = '</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'
#: how they end
_END = b"\n</AppendedData>\n</VTKFile>\n"


def read(path: str | Path) -> TetMesh:
    """Read a tetrahedral mesh, with `by_meshio` if another program wrote it."""
    head, mark, data = content(path).partition(_DATA.encode())
    if not (head.startswith(_HEAD.encode()) and mark):
        from cortet.formats import by_meshio  # loads what the files between stages do without

        return by_meshio.read(Path(path))
    with by_library("a complete VTU file", path):
        root = ElementTree.fromstring(head + b"</UnstructuredGrid></VTKFile>")
        arrays = {
            section: {str(one.get("Name")): _values(one, data) for one in root.iterfind(f".//{section}/DataArray")}
            for section in ("Points", "Cells", "PointData", "CellData")
        }
        corners = arrays["Cells"]["connectivity"].reshape(-1, 4)
        return without_sets(path, arrays["Points"]["Points"], corners, arrays["PointData"], arrays["CellData"])


def counts(path: str | Path) -> tuple[int, int] | None:
    """Numbers of nodes and tetrahedra of a file of cortet, by its first bytes; None for another file or half of one.

    Raises InputError if it cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            begin = file.read(_BEGIN)
            file.seek(max(file.seek(0, os.SEEK_END) - len(_END), 0))
            is_whole = file.read() == _END
    except OSError as error:
        raise unreadable(path, error) from error
    found = re.search(rb'NumberOfPoints="(\d+)" NumberOfCells="(\d+)"', begin)
    return (int(found[1]), int(found[2])) if found and is_whole else None


def _values(array: ElementTree.Element, data: bytes) -> NDArray[Any]:
    """The values of a <DataArray>.

    They are compressed in blocks, after a header: the number of blocks, sizes of a block and of the last one, and the
    size of each block as it is stored.
    """
    at = int(array.get("offset", ""))
    count = int(np.frombuffer(data, "<u4", 1, at)[0])
    sizes = np.frombuffer(data, "<u4", count, at + 12).tolist()
    start, parts = at + 12 + 4 * count, []
    for size in sizes:
        parts.append(zlib.decompress(data[start : start + size]))
        start += size
    dtype = _TYPES[array.get("type", "")]
    values = np.frombuffer(b"".join(parts), dtype.newbyteorder("<")).astype(dtype)
    width = array.get("NumberOfComponents")
    return values.reshape(-1, int(width)) if width else values


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `mesh` losslessly; the file appears under `path` only when complete."""
    of_nodes, of_cells = with_sets(mesh)
    count = len(mesh.cells)
    sections: dict[str, dict[str, NDArray[Any]]] = {
        "Points": {"Points": mesh.points},
        "Cells": {
            "connectivity": mesh.cells.ravel(),
            "offsets": 4 * np.arange(1, count + 1, dtype=np.int32),
            "types": np.full(count, _TETRAHEDRON, np.uint8),
        },
        "PointData": of_nodes,
        "CellData": of_cells,
        "FieldData": {name: np.array(tags, np.int32) for name, tags in names_of(mesh).items()},
    }
    heads, stored, offset = [], [], 0
    for section, arrays in sections.items():
        lines = []
        for name, values in arrays.items():
            shape = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
            shape += f' NumberOfTuples="{len(values)}"' if section == "FieldData" else ""
            kind = f'type="{values.dtype.name.capitalize().replace("Ui", "UI")}" Name={quoteattr(name)}{shape}'
            lines.append(f'<DataArray {kind} format="appended" offset="{offset}"/>\n')
            stored.append(_stored(values))
            offset += len(stored[-1])
        heads.append(f"<{section}>\n{''.join(lines)}</{section}>\n" if lines else "")
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(
            f'{_HEAD}{heads[-1]}<Piece NumberOfPoints="{len(mesh.points)}" NumberOfCells="{count}">\n'
            f"{''.join(heads[:-1])}</Piece>\n{_DATA}".encode()
        )
        for data in stored:
            file.write(data)
        file.write(_END)


def _stored(values: NDArray[Any]) -> bytes:
    """An array as a header and compressed blocks; compression levels above 1 take longer and save nothing."""
    raw = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
    blocks = [zlib.compress(raw[at : at + _BLOCK], 1) for at in range(0, len(raw), _BLOCK)]
    header = [len(blocks), _BLOCK, len(raw) % _BLOCK, *map(len, blocks)]
    return np.array(header, "<u4").tobytes() + b"".join(blocks)
