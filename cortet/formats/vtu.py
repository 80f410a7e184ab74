"""VTU (VTK XML unstructured grid): the interchange file between stages.

Binary, zlib-compressed, float64: every array, fields included, comes back bit for bit, and ParaView opens the file at
every stage. A VTU file has no sets; arrays stand for them (`set_arrays`).

Files are written in VTK's default form: raw data behind the XML. They are read in every form that VTK writes (text,
base64 or raw, in place or appended, with zlib or not; https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html).
"""

from __future__ import annotations

import base64
import re
import zlib
from pathlib import Path
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.as_read import AsRead
from cortet.formats.atomic import atomic_path
from cortet.formats.set_arrays import names_of, with_sets, without_sets
from cortet.formats.untrusted import content, naming, numbers, xml_root
from cortet.meshes import TetMesh

#: bytes that are compressed at a time
_BLOCK = 1 << 20

_TYPES = {
    name: np.dtype(name.lower())
    for name in ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Float32", "Float64")
}
_TETRAHEDRON = 10
#: names of other types, for the message
_OTHERS = {3: "line", 5: "triangle", 9: "quad", 12: "hexahedron", 13: "wedge", 24: "quadratic tetra"}
_RAW = re.compile(rb"<AppendedData\s[^<>]*encoding\s*=\s*[\"']raw[\"'][^<>]*>\s*_")
_DAMAGED = (zlib.error, ValueError, KeyError, OverflowError)


class _File(NamedTuple):
    """Properties that all arrays of a file share."""

    header: np.dtype[Any]
    byte_order: Literal["<", ">"]
    compressed: bool
    #: appended data: raw bytes, or base64
    appended: bytes
    raw: bool


def read(path: str | Path) -> TetMesh:
    """Read a tetrahedral mesh.

    Raises
    ------
    InputError
        the file is missing, is not a complete VTU file, holds cells that are not tetrahedra, indexes nodes it lacks, or
        has a coordinate that is not finite
    """
    text = content(path)
    raw = _RAW.search(text)
    root = xml_root(text if raw is None else text[: raw.start()] + b"</VTKFile>", path)
    try:
        pieces = [_piece(piece, path, file) for file in [_file(root, text, raw)] for piece in _pieces(root)]
        return _joined(pieces, path)
    except _DAMAGED as error:
        raise InputError(f"is not a readable VTU file: {error}", file=path, remedy="delete it and run again") from error


def _file(root: ElementTree.Element, text: bytes, raw: re.Match[bytes] | None) -> _File:
    if root.tag != "VTKFile" or root.get("type") != "UnstructuredGrid":
        raise ValueError(f"it is <{root.tag} type={root.get('type')}>, not <VTKFile type=UnstructuredGrid>")
    order: Literal["<", ">"] = ">" if root.get("byte_order") == "BigEndian" else "<"
    compressor = root.get("compressor")
    if compressor not in (None, "", "vtkZLibDataCompressor"):
        raise ValueError(f"compressor {compressor} is not known, save it with ZLib")
    appended = text[raw.end() :] if raw else "".join((root.findtext("AppendedData") or "").split()).encode()[1:]
    return _File(
        _TYPES[root.get("header_type", "UInt32")].newbyteorder(order), order, bool(compressor), appended, bool(raw)
    )


def _pieces(root: ElementTree.Element) -> list[ElementTree.Element]:
    found = root.findall("UnstructuredGrid/Piece")
    if not found:
        raise ValueError("it has no <Piece>")
    return found


def _piece(piece: ElementTree.Element, path: str | Path, file: _File) -> TetMesh:
    nodes, cells = int(piece.get("NumberOfPoints", "")), int(piece.get("NumberOfCells", ""))
    arrays = {array.get("Name", ""): array for array in piece.iterfind("Cells/DataArray")}
    kinds = np.unique(_values(arrays["types"], cells, file))
    if kinds.tolist() != [_TETRAHEDRON]:
        names = ", ".join(_OTHERS.get(int(kind), str(kind)) for kind in kinds)
        raise DamagedFileError(f"holds cells of type {names or 'none'}, not only tetrahedra", file=path)
    if not np.array_equal(_values(arrays["offsets"], cells, file), 4 * np.arange(1, cells + 1)):
        raise ValueError("its offsets are not those of tetrahedra")
    corners = _values(arrays["connectivity"], 4 * cells, file)
    (points,) = piece.findall("Points/DataArray")
    point_data, cell_data = (
        {str(array.get("Name", "")): _values(array, count, file) for array in piece.iterfind(f"{place}/DataArray")}
        for place, count in (("PointData", nodes), ("CellData", cells))
    )
    with naming(path):
        return TetMesh(_values(points, nodes, file).reshape(-1, 3), corners.reshape(-1, 4), point_data, cell_data)


def _joined(pieces: list[TetMesh], path: str | Path) -> TetMesh:
    """One mesh of all pieces, with its sets."""
    first = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    points = np.concatenate([piece.points for piece in pieces])
    cells = np.concatenate([piece.cells + start for piece, start in zip(pieces, first[:-1], strict=True)])
    for kind in ("point_data", "cell_data"):
        if any(getattr(piece, kind).keys() != getattr(pieces[0], kind).keys() for piece in pieces):
            raise ValueError(f"its pieces have different fields ({kind})")
    point_data = {name: np.concatenate([piece.point_data[name] for piece in pieces]) for name in pieces[0].point_data}
    cell_data = {name: np.concatenate([piece.cell_data[name] for piece in pieces]) for name in pieces[0].cell_data}
    return without_sets(path, points, cells, point_data, cell_data)


def _values(array: ElementTree.Element, rows: int, file: _File) -> NDArray[Any]:
    """The values of a <DataArray> of `rows` rows; ValueError if it holds fewer or more."""
    stated = array.get("NumberOfComponents")
    shape = (rows, int(stated)) if stated else (rows,)
    dtype = _TYPES[array.get("type", "")]
    size = int(np.prod(shape, dtype=object)) * dtype.itemsize
    if size < 0:
        raise ValueError(f"array {array.get('Name')} would take {size:,} bytes")
    form = array.get("format", "ascii")
    if form == "ascii":
        values = numbers(array.text or "", dtype)
    elif form == "binary":
        values = _decoded("".join((array.text or "").split()).encode(), size, dtype, file, raw=False)
    elif form == "appended":
        offset = int(array.get("offset", ""))
        if not 0 <= offset < len(file.appended):
            raise ValueError(f"array {array.get('Name')} begins outside the data")
        values = _decoded(file.appended[offset:], size, dtype, file, raw=file.raw)
    else:
        raise ValueError(f"format {form} is not known")
    return values.reshape(shape)


def _decoded(data: bytes, size: int, dtype: np.dtype[Any], file: _File, *, raw: bool) -> NDArray[Any]:
    """The `size` bytes after a header at the beginning of the data, as numbers."""
    width = file.header.itemsize
    count = int(np.frombuffer(_bytes(data, width, raw), file.header)[0])
    if file.compressed:
        unpacked = _unpacked(data, count, size, file, raw)
    elif count == size:
        separate = not raw and data[: _length(width, raw)].endswith(b"=")
        unpacked = (
            _bytes(data[_length(width, raw) :], size, raw) if separate else _bytes(data, width + size, raw)[width:]
        )
    else:
        raise ValueError(f"{count:,} bytes instead of {size:,}")
    return np.frombuffer(unpacked, dtype.newbyteorder(file.byte_order)).astype(dtype)


def _unpacked(data: bytes, blocks: int, size: int, file: _File, raw: bool) -> bytes:
    """Content of compressed blocks; the header is (number of blocks, size of a block and of the last, packed sizes)."""
    width = (3 + blocks) * file.header.itemsize
    packed = np.frombuffer(_bytes(data, width, raw), file.header).tolist()[3:]
    body = _bytes(data[_length(width, raw) :], sum(packed), raw)
    parts, start = [], 0
    for length in packed:
        parts.append(zlib.decompress(body[start : start + length]))
        start += length
    if (found := sum(map(len, parts))) != size:
        raise ValueError(f"declares {size:,} bytes, holds {found:,}")
    return b"".join(parts)


def _length(size: int, raw: bool) -> int:
    """Length of `size` bytes as they are stored."""
    return size if raw else (size + 2) // 3 * 4


def _bytes(data: bytes, size: int, raw: bool) -> bytes:
    """The first `size` bytes of data stored raw or in base64; ValueError if there are fewer."""
    stored = data[: _length(size, raw)]
    found = stored if raw else base64.b64decode(stored, validate=True)[:size]
    if len(found) != size:
        raise ValueError(f"ends after {len(found):,} of {size:,} bytes")
    return found


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
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt32" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
            f'{heads[-1]}<Piece NumberOfPoints="{len(mesh.points)}" NumberOfCells="{count}">\n'
            f"{''.join(heads[:-1])}</Piece>\n"
            '</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'.encode()
        )
        for data in stored:
            file.write(data)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def _stored(values: NDArray[Any]) -> bytes:
    """An array as a header and compressed blocks; compression levels above 1 take longer and save nothing."""
    raw = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
    blocks = [zlib.compress(raw[at : at + _BLOCK], 1) for at in range(0, len(raw), _BLOCK)]
    header = [len(blocks), _BLOCK, len(raw) % _BLOCK, *map(len, blocks)]
    return np.array(header, "<u4").tobytes() + b"".join(blocks)


def as_read(path: Path) -> AsRead:
    """The file as ParaView sees it: boundary faces are sides of tetrahedra, and only sets of them are listed."""
    mesh = read(path)
    return AsRead(mesh, lists_faces=bool(mesh.sets.faces), directs_faces=False)
