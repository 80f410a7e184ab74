"""Named sets as arrays, for formats that hold only arrays: VTU and VTK legacy.

Sets of nodes and tetrahedra are arrays of 0 and 1. A set of faces is an array with one value per tetrahedron, whose bit
k says that the face opposite corner k belongs to the set. `region` has the numbers of `tags.regions`, and a file has,
for each name, the number and the dimension, as meshio has it for groups of Gmsh.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.formats.surface_sets import faces_of_sides, members, sides
from cortet.formats.tags import face_tags, region_numbers, regions
from cortet.formats.untrusted import sound
from cortet.meshes import REGION, FloatArray, IntArray, MeshSets, TetMesh

#: prefixes of the names of arrays that hold a set
NODE_SET, FACE_SET, CELL_SET = "node_set_", "face_set_", "cell_set_"

Arrays = dict[str, NDArray[Any]]


def with_sets(mesh: TetMesh) -> tuple[Arrays, Arrays]:
    """Fields and sets of a mesh as arrays of its nodes and of its tetrahedra, by name."""
    node_sets = {f"{NODE_SET}{name}": members(len(mesh.points), nodes) for name, nodes in mesh.sets.nodes.items()}
    cell_sets = {f"{CELL_SET}{name}": members(len(mesh.cells), cells) for name, cells in mesh.sets.cells.items()}
    numbers = {REGION: region_numbers(mesh)} if mesh.sets.cells and REGION not in mesh.cell_data else {}
    face_sets = {f"{FACE_SET}{name}": _bits(mesh, faces) for name, faces in mesh.sets.faces.items()}
    return {**mesh.point_data, **node_sets}, {**mesh.cell_data, **numbers, **face_sets, **cell_sets}


def holds_set(name: str) -> bool:
    """Whether an array of this name holds a set, or numbers of regions, as `with_sets` makes them."""
    return name == REGION or name.startswith((NODE_SET, FACE_SET, CELL_SET))


def names_of(mesh: TetMesh) -> dict[str, tuple[int, int]]:
    """Name -> number and dimension (3 or 2) of each region and of each part of the surface, if the mesh has any."""
    cells = regions(mesh).items() if mesh.sets.cells else ()
    return {name: (tag, 3) for name, tag in cells} | {name: (tag, 2) for name, tag in face_tags(mesh).items()}


def without_sets(path: str | Path, points: FloatArray, cells: IntArray, of_nodes: Arrays, of_cells: Arrays) -> TetMesh:
    """The mesh with its fields and sets, from the arrays that `with_sets` makes."""
    fields, cell_fields = dict(of_nodes), dict(of_cells)
    sets = MeshSets(
        _indices(_taken(fields, NODE_SET)),
        {name: _faces(cells, bits) for name, bits in _taken(cell_fields, FACE_SET).items()},
        _indices(_taken(cell_fields, CELL_SET)),
    )
    return sound(path, points, cells, fields, cell_fields, sets)


def _taken(fields: Arrays, prefix: str) -> Arrays:
    """The arrays whose name begins with `prefix`, by the rest of their names; they are removed from `fields`."""
    names = [name for name in fields if name.startswith(prefix)]
    return {name.removeprefix(prefix): fields.pop(name) for name in names}


def _indices(flags: Arrays) -> dict[str, IntArray]:
    """Sets by name, from arrays of 0 and 1."""
    return {name: np.flatnonzero(values).astype(np.int32) for name, values in flags.items()}


def _bits(mesh: TetMesh, faces: IntArray) -> NDArray[np.uint8]:
    """A set of boundary faces as bits of their tetrahedra: (m,)."""
    bits = np.zeros(len(mesh.cells), np.uint8)
    owners, opposite = sides(mesh, faces)
    np.bitwise_or.at(bits, owners, np.left_shift(1, opposite).astype(np.uint8))
    return bits


def _faces(cells: IntArray, bits: NDArray[Any]) -> IntArray:
    """The faces that the bits of tetrahedra mark: (k, 3), outward, in the order of their tetrahedra."""
    if (
        bits.ndim != 1
        or not np.issubdtype(bits.dtype, np.integer)
        or bits.min(initial=0) < 0
        or bits.max(initial=0) > 15
    ):
        raise ValueError("a set of faces needs an integer from 0 to 15 for each tetrahedron")
    owners, opposite = np.nonzero(bits[:, None] >> np.arange(4) & 1)
    return faces_of_sides(cells, owners.astype(np.int32), opposite.astype(np.int32))
