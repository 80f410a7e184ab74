"""The faces a file lists as the surface of a mesh: its named parts, or all boundary faces of a mesh without any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.topology import TET_FACES, boundary, boundary_faces, packed
from cortet.mesh import IntArray, MeshSets, TetMesh

#: the two parts of the boundary; every boundary face belongs to one of them
CORTICAL_SURFACE, MEDIAL_WALL = "cortical_surface", "medial_wall"
#: the two parts of the tissue; every tetrahedron belongs to one of them
CORTEX, CORE = "cortex", "core"
#: tags where a format numbers parts instead of naming them
SURFACE_TAGS = {CORTICAL_SURFACE: 1, MEDIAL_WALL: 2}
REGION_TAGS = {CORE: 1, CORTEX: 2}


def with_surface(mesh: TetMesh) -> TetMesh:
    """The mesh itself if its surface is named; otherwise with all boundary faces and nodes as `cortical_surface`."""
    if SURFACE_TAGS.keys() & mesh.sets.faces.keys():
        return mesh
    faces = boundary_faces(mesh)
    sets = MeshSets(
        {**mesh.sets.nodes, CORTICAL_SURFACE: np.unique(faces)},
        {**mesh.sets.faces, CORTICAL_SURFACE: faces},
        mesh.sets.cells,
    )
    return replace(mesh, sets=sets)


def surface_faces(mesh: TetMesh) -> IntArray:
    """Faces of the parts of the surface, one part after the other: (k, 3)."""
    faces = with_surface(mesh).sets.faces
    return np.concatenate([faces[name] for name in SURFACE_TAGS if name in faces])


def region_tags(mesh: TetMesh) -> IntArray:
    """`REGION_TAGS` of each tetrahedron: (m,) int32, 0 where it is in none of the named regions."""
    tags = np.zeros(len(mesh.cells), np.int32)
    for name, tag in REGION_TAGS.items():
        tags[mesh.sets.cells.get(name, [])] = tag
    return tags


def members(count: int, indices: IntArray) -> NDArray[np.uint8]:
    """A set as an array of 0 and 1: (count,)."""
    flags = np.zeros(count, np.uint8)
    flags[indices] = 1
    return flags


def sides(mesh: TetMesh, faces: IntArray) -> tuple[IntArray, IntArray]:
    """The tetrahedron that each boundary face belongs to, and its corner that is opposite: (k,), (k,) int32.

    Raises
    ------
    InputError
        a face is no boundary face
    """
    found = boundary(mesh)
    key = packed(np.concatenate([found.faces, faces]))
    known, asked = key[: len(found.faces)], key[len(found.faces) :]
    order = np.argsort(known)
    place = order[np.minimum(np.searchsorted(known, asked, sorter=order), len(known) - 1)]
    if (known[place] != asked).any():
        raise InputError(f"face {faces[np.argmax(known[place] != asked)].tolist()} is no boundary face")
    cells = found.cells[place]
    on_face = (mesh.cells[cells][:, :, None] == faces[:, None, :]).any(axis=2)
    return cells, on_face.argmin(axis=1).astype(np.int32)


def faces_of_sides(cells: IntArray, owners: IntArray, opposite: IntArray) -> IntArray:
    """The faces of tetrahedra `cells[owners]` that are opposite to these corners, outward for positive volume."""
    return np.take_along_axis(cells[owners], TET_FACES[opposite], axis=1).astype(np.int32)
