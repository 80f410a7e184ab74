"""CARP: `.pts` (nodes), `.elem` (tetrahedra with a region tag) and `.lon` (one fibre direction each), 0-based.

openCARP expects micrometres, meshtool takes millimetres; the files do not say which. Text: openCARP user's manual,
section "Mesh files" (https://opencarp.org/manual). Tags are those of `tags.region_numbers`, and `<name>.regions.tsv`
names them. Fibres come from the cell field `fibre`, else all are the x axis. Each set
of nodes has its own file `<name>.<set>.vtx`, each set of faces `<name>.<set>.surf`, and each field of nodes
`<name>.<field>.dat` (scalars) or `.vec` (three components). A field with any other number k of components becomes k
scalars `<field>_1` to `<field>_k`.
"""

from __future__ import annotations

import io
import logging
import re
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.tags import region_numbers, regions, with_names
from cortet.formats.untrusted import by_library, content, sound
from cortet.formats.values import in_32_bits, in_components, write_rows
from cortet.meshes import REGION, MeshSets, TetMesh

logger = logging.getLogger(__name__)

Unit = Literal["mm", "um"]
_PER_MM = {"mm": 1.0, "um": 1000.0}

#: end of the name of the table of tags
_NAMES = ".regions.tsv"


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


def read(path: str | Path, *, unit: str = "um") -> TetMesh:
    """Read nodes, tetrahedra, tags with their names and, if there are any, fibres; sets and fields are not read."""
    points = _rows(_beside(path, ".pts"), 3, float)
    elements = _rows(_beside(path, ".elem"), 5, np.int64, kind=b"Tt ")
    of_cells = {REGION: in_32_bits(elements[:, 4], "the region of an element", path)}
    if (lon := _beside(path, ".lon")).exists():
        directions = 2 if content(lon).split(None, 1)[:1] == [b"2"] else 1
        if directions == 2:
            logger.warning("%s: of fibre and sheet directions, only those of fibres are read", lon)
        of_cells["fibre"] = _rows(lon, 3 * directions, float, headed=False)[:, :3]
    names = {}
    if (table := _beside(path, _NAMES)).exists():
        with by_library("a table of names", table):
            lines = content(table).decode("ascii", "replace").splitlines()[1:]
            names = {name: int(tag) for tag, name in (line.split("\t") for line in lines)}
    sets = with_names(MeshSets(), of_cells[REGION], names)
    return sound(path, points / _PER_MM[unit], elements[:, :4], {}, of_cells, sets)


def _rows(path: Path, columns: int, dtype: Any, *, kind: bytes = b"", headed: bool = True) -> NDArray[Any]:
    """The rows of a text, each beginning with `kind`; the first line holds their number if `headed`."""
    head, _, body = content(path).partition(b"\n")
    if kind and (other := re.search(rb"^[ \t]*(?!%b)([A-Za-z]\w*)" % kind, body, re.MULTILINE)):
        what = f"has elements of type {other[1].decode()}, but cortet reads tetrahedra (Tt) alone"
        raise InputError(what, file=path, remedy="extract the tetrahedra, for example with meshtool")
    with by_library("a complete CARP element file", path):
        rows = np.loadtxt(io.BytesIO(body.replace(kind, b"")), dtype, ndmin=2)
        if rows.shape != (int(head) if headed else len(rows), columns):
            needed = f"{head.decode()} rows of {columns}" if headed else f"rows of {columns}"
            raise ValueError(f"it has {rows.shape[0]} rows of {rows.shape[1]} numbers, but needs {needed}")
    return rows


def _beside(path: str | Path, suffix: str) -> Path:
    """`path` with the suffix added: a name such as `hemi-L_res-0.6mm` may itself contain a dot."""
    return Path(str(path).removesuffix(".pts") + suffix)
