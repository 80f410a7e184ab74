"""CARP: `.pts` (nodes), `.elem` (tetrahedra with a region tag) and `.lon` (one fibre direction each), 0-based.

openCARP expects micrometres, meshtool takes millimetres; the files do not say which. Text: openCARP user's manual,
section "Mesh files" (https://opencarp.org/manual). Tags are those of `tags.region_numbers`, and `<name>.regions.tsv`
names them. Fibres come from the cell field `fibre`, else all are the x axis. Each set
of nodes has its own file `<name>.<set>.vtx`, each set of faces `<name>.<set>.surf`, and each field of nodes
`<name>.<field>.dat` (scalars) or `.vec` (three components). A field with any other number k of components becomes k
scalars `<field>_1` to `<field>_k`.

Binary files (`.bpts`, `.belem`, `.blon`) have a text header of 1024 bytes and then float32 or int32 in little-endian
order, as meshtool and openCARP write them; this rounds coordinates to 24 bits.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError
from cortet.formats.as_read import AsRead
from cortet.formats.atomic import atomic_path
from cortet.formats.components import in_components
from cortet.formats.numbering import in_32_bits
from cortet.formats.tags import named_once, region_numbers, regions, with_names
from cortet.formats.text import BadRowError, read_rows, write_rows
from cortet.formats.untrusted import content, in_range, sound
from cortet.meshes import REGION, MeshSets, TetMesh

Unit = Literal["mm", "um"]
_PER_MM = {"mm": 1.0, "um": 1000.0}

_HEADER_BYTES = 1024
#: end of a binary header, after the counts: little-endian, and a number that identifies the file to readers
_ENDIANNESS_AND_CHECKSUM = "0 666"
#: end of the name of the table of tags
_NAMES = ".regions.tsv"
#: number of the tetrahedron's element type in binary files
_TETRAHEDRON = 0


def write(mesh: TetMesh, path: str | Path, *, unit: Unit = "um") -> None:
    """Write `path`.pts, .elem and .lon (an extension .pts of `path` is ignored), each complete or not at all.

    Parameters
    ----------
    unit : unit of the coordinates in the file; ``mm`` keeps every bit
    """
    with ExitStack() as files:
        pts, elem, lon = (_opened(files, _beside(path, suffix)) for suffix in (".pts", ".elem", ".lon"))
        pts.write(f"{len(mesh.points)}\n")
        write_rows(pts, "%.17g %.17g %.17g\n", mesh.points * _PER_MM[unit])
        elem.write(f"{len(mesh.cells)}\n")
        write_rows(elem, "Tt %d %d %d %d %d\n", mesh.cells, region_numbers(mesh))
        lon.write("1\n")
        write_rows(lon, "%.9g %.9g %.9g\n", _fibres(mesh))
        _write_sets_and_fields(files, mesh, path)


def write_binary(mesh: TetMesh, path: str | Path, *, unit: Unit = "um") -> None:
    """Write `path`.bpts, .belem and .blon (an extension .bpts of `path` is ignored), each complete or not at all."""
    elements = np.column_stack([np.full(len(mesh.cells), _TETRAHEDRON), mesh.cells, region_numbers(mesh)])
    files_of: dict[str, tuple[str, NDArray[Any]]] = {
        ".bpts": (f"{len(mesh.points)}", (mesh.points * _PER_MM[unit]).astype("<f4")),
        ".belem": (f"{len(mesh.cells)}", elements.astype("<i4")),
        ".blon": (f"1 {len(mesh.cells)}", _fibres(mesh).astype("<f4")),
    }
    with ExitStack() as files:
        for suffix, (counts, values) in files_of.items():
            temporary = files.enter_context(atomic_path(_beside(path, suffix)))
            header = f"{counts} {_ENDIANNESS_AND_CHECKSUM}".encode().ljust(_HEADER_BYTES, b"\0")
            temporary.write_bytes(header + values.tobytes())
        _write_sets_and_fields(files, mesh, path)


def _write_sets_and_fields(files: ExitStack, mesh: TetMesh, path: str | Path) -> None:
    names = "".join(f"{number}\t{name}\n" for name, number in regions(mesh).items())
    _opened(files, _beside(path, _NAMES)).write(f"tag\tname\n{names}")
    for name, nodes in mesh.sets.nodes.items():
        file = _opened(files, _beside(path, f".{name}.vtx"))
        file.write(f"{len(nodes)}\nextra\n")
        write_rows(file, "%d\n", nodes)
    for name, faces in mesh.sets.faces.items():
        file = _opened(files, _beside(path, f".{name}.surf"))
        file.write(f"{len(faces)}\n")
        write_rows(file, "Tr %d %d %d\n", faces)
    for name, values in in_components(mesh.point_data, (1, 3)).items():
        number = "%d" if np.issubdtype(values.dtype, np.integer) else "%.17g"
        suffix = ".vec" if values.shape[1] == 3 else ".dat"
        write_rows(
            _opened(files, _beside(path, f".{name}{suffix}")), " ".join([number] * values.shape[1]) + "\n", values
        )


def _opened(files: ExitStack, path: Path) -> IO[str]:
    """A text file that appears under `path` when the stack ends without error."""
    return files.enter_context(files.enter_context(atomic_path(path)).open("w", encoding="ascii"))


def _fibres(mesh: TetMesh) -> NDArray[Any]:
    return np.asarray(mesh.cell_data.get("fibre", np.broadcast_to([1.0, 0.0, 0.0], (len(mesh.cells), 3))))


def read(path: str | Path, *, unit: Unit = "um") -> TetMesh:
    """Read what `write` writes; tetrahedra are returned as they are in the file, positive or not.

    The cell field `region` holds the tags; those that `<name>.regions.tsv` names are sets of tetrahedra, too.

    Raises
    ------
    InputError
        a file is missing or incomplete, holds elements that are not tetrahedra or coordinates that are not finite, or
        names nodes it lacks
    """
    points = _text(_beside(path, ".pts"), 3, float)
    elements = _text(_beside(path, ".elem"), 5, np.int64, kind=b"Tt")
    cells = in_range(elements[:, :4], len(points), "node", _beside(path, ".elem"))
    fibres = _text(_beside(path, ".lon"), 3, float, rows=len(elements))
    return _mesh(path, points / _PER_MM[unit], cells, elements[:, 4], fibres)


def read_binary(path: str | Path, *, unit: Unit = "um") -> TetMesh:
    """Read what `write_binary` writes, as `read` does."""
    points = _values(_beside(path, ".bpts"), "<f4", 3)
    elements = _values(_beside(path, ".belem"), "<i4", 6)
    fibres = _values(_beside(path, ".blon"), "<f4", 3)
    if (elements[:, 0] != _TETRAHEDRON).any():
        raise DamagedFileError("holds elements that are not tetrahedra", file=_beside(path, ".belem"))
    cells = in_range(elements[:, 1:5], len(points), "node", _beside(path, ".belem"))
    if len(fibres) != len(elements):
        raise DamagedFileError(f"has {len(fibres)} fibres for {len(elements)} elements", file=_beside(path, ".blon"))
    return _mesh(path, points / _PER_MM[unit], cells, elements[:, 5], fibres.astype(float))


def _mesh(
    path: str | Path, points: NDArray[Any], cells: NDArray[Any], tags: NDArray[Any], fibres: NDArray[Any]
) -> TetMesh:
    """The mesh with the sets and fields in the files beside it."""
    node_sets = {name: _text(file, 1, np.int32, skip=1)[:, 0] for name, file in _siblings(path, ".vtx")}
    face_sets = {name: _text(file, 3, np.int32, kind=b"Tr") for name, file in _siblings(path, ".surf")}
    fields: dict[str, NDArray[Any]] = {}
    for columns, suffix in ((1, ".dat"), (3, ".vec")):
        for name, file in _siblings(path, suffix):
            values = _text(file, columns, float, rows=len(points), headed=False)
            fields[name] = values[:, 0] if columns == 1 else values
    return sound(
        path,
        points,
        cells,
        fields,
        {REGION: in_32_bits(tags, "the region of an element", path), "fibre": fibres},
        with_names(MeshSets(node_sets, face_sets), tags, _names(_beside(path, _NAMES))),
    )


def _names(file: Path) -> dict[str, int]:
    """Name -> tag of each region, from the table beside a mesh; empty if there is none."""
    if not file.exists():
        return {}
    rows = [line.split("\t") for line in content(file).decode("ascii", "replace").splitlines()[1:]]
    try:
        return named_once([(name, int(tag)) for tag, name in rows], file)
    except ValueError as error:
        raise DamagedFileError(f"is not a table of tags and names: {error}", file=file) from error


def _beside(path: str | Path, suffix: str) -> Path:
    """`path` with the suffix added: a name such as `hemi-L_res-0.6mm` may itself contain a dot."""
    return Path(str(path).removesuffix(".bpts").removesuffix(".pts") + suffix)


def _siblings(path: str | Path, suffix: str) -> list[tuple[str, Path]]:
    """Name and file of the sets or fields beside a mesh."""
    stem = _beside(path, ".")
    files = [file for file in stem.parent.glob(f"*{suffix}") if file.name.startswith(stem.name)]
    names = [(file.name.removeprefix(stem.name).removesuffix(suffix), file) for file in sorted(files)]
    return [(name, file) for name, file in names if "." not in name]


def _text(
    path: Path,
    columns: int,
    dtype: Any,
    *,
    kind: bytes = b"",
    rows: int | None = None,
    skip: int = 0,
    headed: bool = True,
) -> NDArray[Any]:
    """The lines of a text file, each beginning with `kind`.

    The first line holds their number, unless `rows` gives it. `headed` says whether there is such a line, and `skip`
    how many lines come between it and the table.
    """
    text = content(path)
    if headed:
        head, _, text = text.partition(b"\n")
        try:
            expected = int(head) if rows is None else rows
        except ValueError as error:
            raise DamagedFileError(
                "is not a CARP file: its first line is not the number of its rows", file=path
            ) from error
    else:
        expected = rows or 0
    for _ in range(skip):
        text = text.partition(b"\n")[2]
    if kind:
        count = text.count(b"\n" + kind + b" ") + text.startswith(kind + b" ")
        lines = text.count(b"\n") + (len(text) > 0 and not text.endswith(b"\n"))
        if count != lines:
            raise DamagedFileError(f"holds elements of other types than {kind.decode()}", file=path)
        text = text.replace(kind, b"")
    try:
        table = read_rows(text, columns, dtype)
    except BadRowError as error:
        raise DamagedFileError(
            f"is not a CARP file: line {error.row + 1 + headed + skip} {error}", file=path
        ) from error
    if len(table) != expected:
        raise DamagedFileError(f"is not complete: {len(table)} lines instead of {expected}", file=path)
    return table


def _values(path: Path, dtype: str, columns: int) -> NDArray[Any]:
    """The numbers of a binary file."""
    data = content(path)
    words = data[:_HEADER_BYTES].split(b"\0")[0].split()
    if len(data) < _HEADER_BYTES or len(words) < 3 or not all(word.isdigit() for word in words):
        raise DamagedFileError("is not a binary CARP file", file=path)
    count = int(words[-3])
    values = np.frombuffer(data, np.uint8, offset=_HEADER_BYTES)
    expected = count * columns * np.dtype(dtype).itemsize
    if len(values) != expected:
        raise DamagedFileError(f"is not complete: {len(values)} bytes instead of {expected}", file=path)
    return values.view(dtype).reshape(count, columns)


def as_read(path: Path) -> AsRead:
    """The file as openCARP sees it. Surfaces are in separate files, which may be missing."""
    return _as_read(read(path))


def as_read_binary(path: Path) -> AsRead:
    """The binary file as openCARP sees it."""
    return _as_read(read_binary(path))


def _as_read(mesh: TetMesh) -> AsRead:
    return AsRead(mesh, lists_faces=bool(mesh.sets.faces))
