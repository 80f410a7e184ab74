"""VTU (VTK XML unstructured grid): the interchange file between stages.

Binary, zlib-compressed, float64: every array comes back bit for bit, fields included, and ParaView opens the file at
every stage. Sets of nodes and tetrahedra are arrays of 0 and 1, and `region` is 1 in the core and 2 in the cortex;
there are no faces, so none in sets. Read and written by meshio; format: https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
import zlib
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import members, region_tags
from cortet.mesh import IntArray, MeshSets, TetMesh

#: what the names of arrays begin with that hold a set, as 0 and 1
_NODE_SET, _CELL_SET = "node_set_", "cell_set_"

#: what meshio lets through when a file is cut off or damaged
_DAMAGED = (
    meshio.ReadError,
    ET.ParseError,
    zlib.error,
    AssertionError,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
)


def read(path: str | Path) -> TetMesh:
    """Read a tetrahedral mesh.

    Raises
    ------
    InputError
        the file is missing, is not a complete VTU file, holds cells that are not tetrahedra, or indexes nodes it lacks
    """
    try:
        mesh = meshio.vtu.read(path)
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}", file=path) from error
    except _DAMAGED as error:
        raise InputError(f"is not a readable VTU file: {error}", file=path, remedy="delete it and run again") from error
    kinds = sorted({block.type for block in mesh.cells})
    if kinds != ["tetra"]:
        raise InputError(f"holds cells of type {', '.join(kinds) or 'none'}, not only tetrahedra", file=path)
    cells = np.concatenate([block.data for block in mesh.cells])
    if cells.min() < 0 or cells.max() >= len(mesh.points):
        raise InputError(f"has node indices outside 0..{len(mesh.points) - 1}", file=path)
    point_data = dict(mesh.point_data)
    cell_data = {name: np.concatenate(blocks) for name, blocks in mesh.cell_data.items()}
    nodes, named = _taken(point_data, _NODE_SET), _taken(cell_data, _CELL_SET)
    return TetMesh(mesh.points, cells, point_data, cell_data, MeshSets(nodes, {}, named))


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `mesh` losslessly; the file appears under `path` only when complete."""
    node_sets = {f"{_NODE_SET}{name}": members(len(mesh.points), nodes) for name, nodes in mesh.sets.nodes.items()}
    cell_sets = {f"{_CELL_SET}{name}": members(len(mesh.cells), cells) for name, cells in mesh.sets.cells.items()}
    regions = {"region": region_tags(mesh)} if mesh.sets.cells else {}
    cell_data = {**mesh.cell_data, **regions, **cell_sets}
    grid = meshio.Mesh(
        mesh.points,
        [("tetra", mesh.cells)],
        point_data={**mesh.point_data, **node_sets},
        cell_data={name: [values] for name, values in cell_data.items()},
    )
    with atomic_path(path) as temporary:
        meshio.vtu.write(temporary, grid)


def _taken(fields: dict[str, NDArray[Any]], prefix: str) -> dict[str, IntArray]:
    """Sets by name, from the arrays whose name begins with `prefix`; these are taken out of `fields`."""
    names = [name for name in fields if name.startswith(prefix)]
    return {name.removeprefix(prefix): np.flatnonzero(fields.pop(name)).astype(np.int32) for name in names}
