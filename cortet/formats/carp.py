"""CARP: `.pts` (nodes), `.elem` (tetrahedra with a region tag) and `.lon` (one fibre direction each), 0-based text.

openCARP expects micrometres, meshtool takes millimetres. Source: openCARP user's manual, section "Mesh files"
(https://opencarp.org/manual). A region is the cell field `region` (1 without one), a fibre the cell field `fibre`
(the x axis without one).
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.text import write_rows
from cortet.mesh import TetMesh

Unit = Literal["mm", "um"]
_PER_MM = {"mm": 1.0, "um": 1000.0}


def write(mesh: TetMesh, path: str | Path, *, unit: Unit = "um") -> None:
    """Write `path`.pts, .elem and .lon (an extension .pts of `path` is ignored), each complete or not at all.

    Parameters
    ----------
    unit : of the coordinates in the file; ``mm`` keeps every bit of the coordinates
    """
    fibres = mesh.cell_data.get("fibre", np.broadcast_to([1.0, 0.0, 0.0], (len(mesh.cells), 3)))
    regions = mesh.cell_data.get("region", np.ones(len(mesh.cells), np.int32))
    with ExitStack() as files:
        pts, elem, lon = (
            files.enter_context(files.enter_context(atomic_path(_beside(path, suffix))).open("w"))
            for suffix in (".pts", ".elem", ".lon")
        )
        pts.write(f"{len(mesh.points)}\n")
        write_rows(pts, "%.17g %.17g %.17g\n", mesh.points * _PER_MM[unit])
        elem.write(f"{len(mesh.cells)}\n")
        write_rows(elem, "Tt %d %d %d %d %d\n", np.column_stack([mesh.cells, regions]))
        lon.write("1\n")
        write_rows(lon, "%.9g %.9g %.9g\n", np.asarray(fibres))


def read(path: str | Path, *, unit: Unit = "um") -> TetMesh:
    """Read what `write` writes; tetrahedra come as they are in the file, positive or not.

    Raises
    ------
    InputError
        a file is missing or incomplete, or holds elements that are not tetrahedra
    """
    points = _table(_beside(path, ".pts"), columns=(0, 1, 2), dtype=np.float64)
    kinds = np.unique(_table(_beside(path, ".elem"), columns=(0,), dtype="U2"))
    if kinds.tolist() != ["Tt"]:
        raise InputError(f"holds elements of type {', '.join(kinds)}, not only Tt", file=_beside(path, ".elem"))
    elements = _table(_beside(path, ".elem"), columns=(1, 2, 3, 4, 5), dtype=np.int32)
    if elements[:, :4].min() < 0 or elements[:, :4].max() >= len(points):
        raise InputError(f"has node indices outside 0..{len(points) - 1}", file=_beside(path, ".elem"))
    fibres = _table(_beside(path, ".lon"), columns=(0, 1, 2), dtype=np.float64, rows=len(elements))
    return TetMesh(points / _PER_MM[unit], elements[:, :4], cell_data={"region": elements[:, 4], "fibre": fibres})


def _beside(path: str | Path, suffix: str) -> Path:
    """`path` with the suffix added: a name such as `hemi-L_res-0.6mm` may hold points of its own."""
    return Path(str(path).removesuffix(".pts") + suffix)


def _table(path: Path, *, columns: tuple[int, ...], dtype: Any, rows: int | None = None) -> NDArray[Any]:
    """The lines below the first, whose number the first line states where `rows` does not."""
    try:
        with path.open() as file:
            stated = int(file.readline())
            table = np.loadtxt(file, dtype, usecols=columns, ndmin=2)
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}", file=path) from error
    except ValueError as error:
        raise InputError(f"is not a CARP file: {error}", file=path) from error
    expected = stated if rows is None else rows
    if len(table) != expected:
        raise InputError(f"is not complete: {len(table)} lines instead of {expected}", file=path)
    return table
