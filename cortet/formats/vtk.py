"""Legacy VTK (`.vtk`), which programs older than VTU also read.

https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html. Files are written in version 4.2, binary.
They are read in versions up to 5.1, binary or text, if they hold an unstructured grid. Sets are arrays (`set_arrays`).
VTK escapes the characters of names as in web addresses.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.as_read import AsRead
from cortet.formats.atomic import atomic_path
from cortet.formats.set_arrays import Arrays, names_of, with_sets, without_sets
from cortet.formats.untrusted import content, numbers
from cortet.meshes import TetMesh

_TETRAHEDRON = 10
#: types of VTK by name; numbers are big-endian in binary files
_TYPES = {
    "unsigned_char": "u1",
    "char": "i1",
    "unsigned_short": ">u2",
    "short": ">i2",
    "unsigned_int": ">u4",
    "int": ">i4",
    "vtkidtype": ">i4",
    "unsigned_long": ">u8",
    "long": ">i8",
    "float": ">f4",
    "double": ">f8",
    **{f"vtktype{kind}{8 * size}": f">{kind[0]}{size}" for kind in ("int", "uint") for size in (1, 2, 4, 8)},
}
_NAMES = {np.dtype(code): name for name, code in reversed(_TYPES.items())}
#: sections that hold one array whose name and type follow: number of its components
_WIDTHS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9}


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path`, complete or not at all."""
    of_nodes, of_cells = with_sets(mesh)
    corners = np.column_stack([np.full(len(mesh.cells), 4), mesh.cells])
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(b"# vtk DataFile Version 4.2\ncortet\nBINARY\nDATASET UNSTRUCTURED_GRID\n")
        if names := names_of(mesh):
            file.write(f"FIELD FieldData {len(names)}\n".encode())
            for name, tags in names.items():
                _write_values(file, f"{quote(name)} 1 {len(tags)} int", np.array(tags, ">i4"))
        _write_values(file, f"POINTS {len(mesh.points)} double", mesh.points.astype(">f8"))
        _write_values(file, f"CELLS {len(corners)} {corners.size}", corners.astype(">i4"))
        _write_values(file, f"CELL_TYPES {len(corners)}", np.full(len(corners), _TETRAHEDRON, ">i4"))
        for section, arrays, count in (("POINT_DATA", of_nodes, mesh.points), ("CELL_DATA", of_cells, mesh.cells)):
            file.write(f"{section} {len(count)}\nFIELD FieldData {len(arrays)}\n".encode())
            for name, values in arrays.items():
                stored = values.astype(values.dtype.newbyteorder(">"))
                head = f"{quote(name)} {values.size // len(count)} {len(count)} {_NAMES[stored.dtype]}"
                _write_values(file, head, stored)


def _write_values(file: BinaryIO, head: str, values: NDArray[Any]) -> None:
    file.write(f"{head}\n".encode() + values.tobytes() + b"\n")


def read(path: str | Path) -> TetMesh:
    """Read a tetrahedral mesh.

    Raises
    ------
    InputError
        the file is missing or incomplete, is not an unstructured grid, holds cells other than tetrahedra, indexes nodes
        it lacks, or has a coordinate that is not finite
    """
    try:
        grid = _Grid(content(path))
        return without_sets(path, grid.points, grid.tetrahedra(), grid.arrays["POINT_DATA"], grid.arrays["CELL_DATA"])
    except (ValueError, KeyError, IndexError, OverflowError) as error:
        what = f"is not a readable VTK file: {error}"
        raise InputError(what, file=path, remedy="save it again as an unstructured grid of tetrahedra") from error


class _Grid:
    """Content of the sections of a file; ValueError, KeyError or IndexError if they are not those of VTK."""

    def __init__(self, text: bytes) -> None:
        self.text, self.at = text, 0
        self.points = np.empty((0, 3))
        self.cells, self.offsets, self.types = (np.empty(0, np.int64) for _ in range(3))
        self.arrays: dict[str, Arrays] = {"POINT_DATA": {}, "CELL_DATA": {}}
        self.rows, self.fields = 0, Arrays()  # at first, those of the file as a whole
        if not self._line().startswith("# vtk DataFile"):
            raise ValueError("it does not begin with `# vtk DataFile`")
        self._line()
        self.binary = {"BINARY": True, "ASCII": False}[self._line().strip().upper()]
        while words := self._words():
            self._section(*words)

    def tetrahedra(self) -> NDArray[Any]:
        """Corners of all cells (m, 4)."""
        if not len(self.types) or (self.types != _TETRAHEDRON).any():
            raise ValueError(f"its cells are of types {np.unique(self.types).tolist()}, not only {_TETRAHEDRON}")
        if len(self.offsets):  # version 5
            if not np.array_equal(self.offsets, 4 * np.arange(len(self.types) + 1)):
                raise ValueError("its offsets are not those of tetrahedra")
            return self.cells.reshape(-1, 4)
        rows = self.cells.reshape(-1, 5)
        if (rows[:, 0] != 4).any() or len(rows) != len(self.types):
            raise ValueError("it has a tetrahedron without four corners")
        return rows[:, 1:]

    def _section(self, word: str, *rest: str) -> None:
        kind = word.upper()
        if kind == "DATASET":
            if rest[0].upper() != "UNSTRUCTURED_GRID":
                raise ValueError(f"it holds {rest[0]}")
        elif kind == "POINTS":
            self.points = self._values(3 * int(rest[0]), rest[1]).reshape(-1, 3)
        elif kind == "CELLS":
            self._read_cells(int(rest[0]), int(rest[1]))
        elif kind == "CELL_TYPES":
            self.types = self._values(int(rest[0]), "int")
        elif kind in self.arrays:
            self.rows, self.fields = int(rest[0]), self.arrays[kind]
        elif kind in ("FIELD", *_WIDTHS, "SCALARS", "LOOKUP_TABLE", "METADATA"):
            self._read_fields(kind, *rest)
        else:
            raise ValueError(f"section {word[:40]!r} is not known")

    def _read_cells(self, first: int, second: int) -> None:
        before = self.at
        words = self._words()
        if words[:1] == ["OFFSETS"]:
            self.offsets = self._values(first, words[1])
            self.cells = self._values(second, self._words()[1])
        else:
            self.at = before
            self.cells = self._values(second, "int")

    def _read_fields(self, kind: str, *rest: str) -> None:
        if kind == "FIELD":
            for _ in range(int(rest[1])):
                while (words := self._words()) == ["METADATA"]:  # of the array before
                    self._skip()
                name, columns, rows, type_of = words
                self._keep(name, self._values(int(columns) * int(rows), type_of), int(columns), int(rows))
        elif kind in _WIDTHS:
            self._keep(rest[0], self._values(_WIDTHS[kind] * self.rows, rest[1]), _WIDTHS[kind], self.rows)
        elif kind == "SCALARS":
            width = int(rest[2]) if len(rest) > 2 else 1
            self._words()  # names a table of colours
            self._keep(rest[0], self._values(width * self.rows, rest[1]), width, self.rows)
        elif kind == "LOOKUP_TABLE":
            self._values(4 * int(rest[1]), "unsigned_char" if self.binary else "float")
        else:
            self._skip()

    def _skip(self) -> None:
        """Go behind METADATA, which end with an empty line."""
        while self._line().strip():
            pass

    def _keep(self, name: str, values: NDArray[Any], width: int, rows: int) -> None:
        if self.rows and rows != self.rows:
            raise ValueError(f"array {name} has {rows} rows, not {self.rows}")
        self.fields[unquote(name)] = values if width == 1 else values.reshape(-1, width)

    def _values(self, count: int, type_of: str) -> NDArray[Any]:
        """The next numbers of the file, in this machine's byte order."""
        dtype = np.dtype(_TYPES[type_of.lower()])
        if self.binary:
            end = self.at + count * dtype.itemsize
            if not self.at <= end <= len(self.text):
                raise ValueError("it ends too early")
            found = np.frombuffer(self.text, dtype, count, self.at)
            self.at = end
            return found.astype(dtype.newbyteorder("="))
        parts = self.text[self.at :].split(None, count) if count else []
        if len(parts) < count:
            raise ValueError("it ends too early")
        rest = parts[count] if len(parts) > count else b""
        self.at = len(self.text) - len(rest)
        return numbers(b" ".join(parts[:count]).decode("ascii"), dtype.newbyteorder("="))

    def _words(self) -> list[str]:
        """Words of the next line that is not empty; none at the end of the file."""
        while self.at < len(self.text):
            if words := self._line().split():
                return words
        return []

    def _line(self) -> str:
        end = self.text.find(b"\n", self.at)
        end = len(self.text) if end < 0 else end
        line = self.text[self.at : end].decode("ascii", errors="replace")
        self.at = end + 1
        return line


def as_read(path: Path) -> AsRead:
    """The file as ParaView sees it: boundary faces are sides of tetrahedra, and only sets of them are listed."""
    mesh = read(path)
    return AsRead(mesh, lists_faces=bool(mesh.sets.faces), directs_faces=False)
