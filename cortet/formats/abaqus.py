"""Abaqus `.inp`, which CalculiX reads too: nodes, C3D4 elements, and the named sets of nodes, elements and faces.

Nodes and elements count from 1 in the order of the mesh, volumes are positive. `*SURFACE` names faces by element and
side: S1 = 1-2-3, S2 = 1-4-2, S3 = 2-4-3, S4 = 3-4-1 (Abaqus Elements Guide, "Three-dimensional solid element library").
There is no material and no step: a job includes the file (`*INCLUDE, INPUT=mesh.inp`) and adds both. Coordinates have
12 significant digits, since CalculiX reads 20 characters of a number.

Fields of nodes are in a separate file, `<name>_fields.inp`, as `*INITIAL CONDITIONS, TYPE=FIELD`. Abaqus reads it,
CalculiX does not. Comments `** region 1: cortex` give the numbers of the sets that are regions (`tags`). A field of k
components takes k variables; a comment before each variable names it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import sides, with_surface
from cortet.formats.tags import regions
from cortet.formats.values import in_32_bits, write_rows, write_wrapped
from cortet.meshes import FloatArray, IntArray, TetMesh

#: names of the sets of all nodes and of all elements
ALL_NODES, ALL_ELEMENTS = "all_nodes", "all_elements"
#: number of the side opposite each corner
_SIDE = np.array([3, 4, 2, 1])
_PER_LINE = 16


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path` and, if the mesh has fields, the file of its fields; each complete or not at all."""
    mesh = with_surface(mesh)
    write_elements(mesh, mesh.points, mesh.cells, mesh.sets.nodes, path)
    if mesh.point_data:
        with atomic_path(fields_path(path)) as temporary, temporary.open("w", encoding="ascii") as file:
            _write_fields(file, mesh.point_data)


def write_elements(
    mesh: TetMesh, points: FloatArray, cells: IntArray, node_sets: Mapping[str, IntArray], path: str | Path
) -> None:
    """Write `path` without fields, complete or not at all, with C3D4 or with C3D10 elements.

    Parameters
    ----------
    mesh : has the sets of elements and faces
    points : (n, 3) mm
    cells : (m, 4), or (m, 10) whose midside nodes are in the order 1-2, 2-3, 3-1, 1-4, 2-4, 3-4
    node_sets : name -> nodes
    """
    kind, numbers = {4: "C3D4", 10: "C3D10"}[cells.shape[1]], ", ".join(["%d"] * (1 + cells.shape[1]))
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write("*HEADING\nTetrahedral mesh, coordinates in mm\n")
        file.write(f"*NODE, NSET={ALL_NODES}\n")
        write_rows(file, "%d, %.12g, %.12g, %.12g\n", np.arange(1, len(points) + 1), points)
        file.write(f"*ELEMENT, TYPE={kind}, ELSET={ALL_ELEMENTS}\n")
        write_rows(file, f"{numbers}\n", np.arange(1, len(cells) + 1), cells + 1)
        for name, nodes in node_sets.items():
            file.write(f"*NSET, NSET={name}\n")
            write_wrapped(file, nodes + 1, _PER_LINE)
        named = {name: number for name, number in regions(mesh).items() if name in mesh.sets.cells}
        file.writelines(f"** region {number}: {name}\n" for name, number in named.items())
        for name, members in mesh.sets.cells.items():
            file.write(f"*ELSET, ELSET={name}\n")
            write_wrapped(file, members + 1, _PER_LINE)
        for name, faces in mesh.sets.faces.items():
            owners, opposite = sides(mesh, faces)
            file.write(f"*SURFACE, TYPE=ELEMENT, NAME={name}\n")
            write_rows(file, "%d, S%d\n", owners + 1, _SIDE[opposite])


def fields_path(path: str | Path) -> Path:
    """The file of the fields beside a mesh file."""
    return Path(path).with_name(Path(path).name.removesuffix(".inp") + "_fields.inp")


def _write_fields(file: IO[str], fields: dict[str, NDArray[Any]]) -> None:
    variable = 0
    for name, values in fields.items():
        columns = values.reshape(len(values), -1)
        kind = "integer" if np.issubdtype(values.dtype, np.integer) else "real"
        number = "%d" if kind == "integer" else "%.12g"
        columns = in_32_bits(columns, f"field `{name}`") if kind == "integer" else columns
        for component, column in enumerate(columns.T, start=1):
            variable += 1
            file.write(f"** variable {variable}: {name}, component {component} of {columns.shape[1]}, {kind}\n")
            file.write(f"*INITIAL CONDITIONS, TYPE=FIELD, VARIABLE={variable}\n")
            write_rows(file, f"%d, {number}\n", np.arange(1, len(values) + 1), column)
