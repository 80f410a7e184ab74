"""`.mesh` of the BrainGrowth solver (Tallinen et al., Nature Physics 2016; https://github.com/rousseau/BrainGrowth).

Text: the number of nodes and `x y z` each; the number of tetrahedra and `tag a b c d` each; the number of boundary
triangles and `tag a b c` each. Nodes count from 1, surface nodes come first, tetrahedra have **negative** volume,
triangles face outward. Tags, which the solver skips, are those of `tags`: of regions, and of parts of the surface. (The
solver's loader swaps x with y and c with d; these two mirrors cancel.)
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.as_read import AsRead
from cortet.formats.atomic import atomic_path
from cortet.formats.numbering import in_32_bits
from cortet.formats.surface_sets import CORTICAL_SURFACE, SURFACE, with_surface
from cortet.formats.tags import face_tags, region_numbers
from cortet.formats.text import BadRowError, read_rows, write_rows
from cortet.formats.untrusted import check_file, in_range, sound
from cortet.geometry.topology import boundary_nodes, compact
from cortet.meshes import REGION, FloatArray, IntArray, MeshSets, TetMesh


class Tables(NamedTuple):
    """The numbers of a file, uninterpreted."""

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
        write_rows(file, "%d %d %d %d %d\n", region_numbers(mesh), mesh.cells[:, [0, 1, 3, 2]] + 1)
        named = with_surface(mesh)
        parts = {tag: named.sets.faces[name] for name, tag in face_tags(named).items() if name in SURFACE}
        file.write(f"{sum(map(len, parts.values()))}\n")
        for tag, faces in parts.items():
            write_rows(file, f"{tag} %d %d %d\n", faces + 1)


def read(path: str | Path) -> TetMesh:
    """Read a file that keeps the conventions above (`verify.braingrowth` checks them); unused nodes are dropped."""
    tables = read_tables(path)
    points, cells, _ = compact(tables.points, _cells(tables, path))
    return sound(path, points, cells, cell_data=_tags(tables, path))


def read_tables(path: str | Path) -> Tables:
    """Read the three tables without interpreting them.

    Raises
    ------
    InputError
        the file is missing, incomplete or too long, or a line has another number of fields than its table
    """
    start, tables = 1, []
    check_file(path)
    try:
        with Path(path).open(encoding="ascii") as file:
            for kind, fields, dtype in [("node", 3, float), ("tetrahedron", 5, np.int64), ("triangle", 4, np.int64)]:
                stated = file.readline()
                if not re.fullmatch(r"\s*\d{1,12}\s*", stated):
                    raise DamagedFileError(f"line {start}: the number of {kind} lines is missing", file=path)
                count = int(stated)
                try:
                    tables.append(read_rows(file, fields, dtype, rows=count))
                except BadRowError as error:
                    line = f"line {start + 1 + error.row}: a {kind} line {error}"
                    raise DamagedFileError(
                        f"{line} ({count} lines of {fields} fields belong there)", file=path
                    ) from error
                start += 1 + count
            if file.read().strip():
                raise DamagedFileError(f"line {start}: more than the three tables", file=path)
    except OSError as error:
        raise InputError(
            f"cannot be opened: {error.strerror}", file=path, remedy="check the path and its permissions"
        ) from error
    except UnicodeDecodeError as error:
        raise DamagedFileError("is not a text file", file=path) from error
    return Tables(*tables)


def as_read(path: Path) -> AsRead:
    """The file in its own coordinates, with the last two nodes of every tetrahedron swapped.

    Raises InputError if the tables cannot be read, or name nodes that do not exist.
    """
    tables = read_tables(path)
    faces = in_range(tables.triangles[:, 1:] - 1, len(tables.points), "node", path)
    cells = _cells(tables, path)
    first_cell, first_face = len(tables.points) + 3, len(tables.points) + len(cells) + 4
    return AsRead(
        TetMesh(
            tables.points,
            cells,
            cell_data=_tags(tables, path),
            sets=MeshSets(faces={CORTICAL_SURFACE: faces} if len(faces) else {}),
        ),
        sign="negative",
        cell=lambda index: f"on line {first_cell + index}",
        face=lambda index: f"on line {first_face + index}",
    )


def _tags(tables: Tables, path: str | Path) -> dict[str, IntArray]:
    """The regions of the tetrahedra, if there are several."""
    tags = in_32_bits(tables.tetrahedra[:, 0], "the region of an element", path)
    return {REGION: tags} if (tags != 1).any() else {}


def _cells(tables: Tables, path: str | Path) -> IntArray:
    """0-based nodes of the tetrahedra, the last two swapped; InputError if there are none or a node does not exist."""
    nodes = tables.tetrahedra[:, [1, 2, 4, 3]]
    if len(nodes) == 0 or nodes.min() < 1 or nodes.max() > len(tables.points):
        raise DamagedFileError(f"has no tetrahedra, or node indices outside 1..{len(tables.points)}", file=path)
    return (nodes - 1).astype(np.int32)
