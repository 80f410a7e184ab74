"""`.mesh` of the BrainGrowth solver (Tallinen et al., Nature Physics 2016; https://github.com/rousseau/BrainGrowth).

Text: the number of nodes and `x y z` each; the number of tetrahedra and `tag a b c d` each; the number of boundary
triangles and `tag a b c` each. Nodes count from 1, surface nodes come first, tetrahedra have **negative** volume,
triangles face outward, all tags are 1. (The solver's loader swaps x with y and c with d; these two mirrors cancel.)
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.text import write_rows
from cortet.mesh import FloatArray, TetMesh
from cortet.topology import boundary_faces, boundary_nodes, compact


class Tables(NamedTuple):
    """The numbers of a file, just as they stand there."""

    #: (n, 3) mm
    points: FloatArray
    #: (m, 5), tag and 1-based nodes
    tetrahedra: NDArray[np.int64]
    #: (k, 4), tag and 1-based nodes
    triangles: NDArray[np.int64]


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write a mesh whose surface nodes come first (`stages.solver_ready`), with coordinates in mm to 1e-9.

    Raises
    ------
    InputError
        the surface nodes do not come first
    """
    surface_nodes = boundary_nodes(mesh)
    if surface_nodes[-1] != len(surface_nodes) - 1:
        raise InputError("surface nodes do not come first", file=path, remedy="run the stage solver_ready before")
    with atomic_path(path) as temporary, temporary.open("w") as file:
        file.write(f"{len(mesh.points)}\n")
        write_rows(file, "%.9f %.9f %.9f\n", mesh.points)
        file.write(f"{len(mesh.cells)}\n")
        write_rows(file, "1 %d %d %d %d\n", mesh.cells[:, [0, 1, 3, 2]] + 1)
        file.write(f"{len(boundary_faces(mesh))}\n")
        write_rows(file, "1 %d %d %d\n", boundary_faces(mesh) + 1)


def read(path: str | Path) -> TetMesh:
    """Read a file that keeps the conventions above (`verify.braingrowth` checks them); unused nodes are left out."""
    tables = read_tables(path)
    nodes = tables.tetrahedra[:, 1:] - 1
    if len(nodes) == 0 or nodes.min() < 0 or nodes.max() >= len(tables.points):
        raise InputError(f"has no tetrahedra, or node indices outside 1..{len(tables.points)}", file=path)
    points, cells, _ = compact(tables.points, nodes[:, [0, 1, 3, 2]].astype(np.int32))
    return TetMesh(points, cells)


def read_tables(path: str | Path) -> Tables:
    """Read the three tables without interpreting them.

    Raises
    ------
    InputError
        the file is missing, incomplete or too long, or a line has another number of fields than its table
    """
    try:
        lines = Path(path).read_text(encoding="ascii").splitlines()
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}", file=path) from error
    except UnicodeDecodeError as error:
        raise InputError("is not a text file", file=path) from error
    start, tables = 0, []
    for kind, fields, dtype in [("node", 3, float), ("tetrahedron", 5, np.int64), ("triangle", 4, np.int64)]:
        try:
            count = int(lines[start])
        except (IndexError, ValueError) as error:
            raise InputError(f"line {start + 1}: the number of {kind} lines is missing", file=path) from error
        rows = [line.split() for line in lines[start + 1 : start + 1 + count]]
        for number, row in enumerate(rows, start=start + 2):
            if len(row) != fields:
                raise InputError(f"line {number}: a {kind} line has {fields} fields, not {len(row)}", file=path)
        if len(rows) != count:
            raise InputError(f"is not complete: {len(rows)} {kind} lines instead of {count}", file=path)
        try:
            tables.append(np.array(rows, dtype=str).reshape(count, fields).astype(dtype))
        except ValueError as error:
            raise InputError(f"{kind} lines from line {start + 2}: {error}", file=path) from error
        start += 1 + count
    if any(line.strip() for line in lines[start:]):
        raise InputError(f"line {start + 1}: more than the three tables", file=path)
    return Tables(*tables)
