"""The faces that a file lists as the surface of a mesh: its named parts or, without any, all boundary faces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.topology import TET_FACES, boundary, boundary_faces, packed
from cortet.meshes import INNERMOST, OUTERMOST, IntArray, MeshSets, TetMesh

#: the two parts of the boundary of a brain; every boundary face belongs to one of them
CORTICAL_SURFACE, MEDIAL_WALL = "cortical_surface", "medial_wall"
#: the boundary of a mesh in which other regions lie around the brain
OUTER_SURFACE = "outer_surface"
#: the two parts of a brain
CORTEX, CORE = OUTERMOST, INNERMOST
#: suffix of the name of a set of faces between two regions, counter-clockwise seen from outside the inner region
INTERFACE = "_interface"
#: the sets that divide the boundary of a mesh
SURFACE = (CORTICAL_SURFACE, MEDIAL_WALL, OUTER_SURFACE)


def with_surface(mesh: TetMesh) -> TetMesh:
    """The mesh itself if its surface is named; otherwise all boundary faces and nodes become `cortical_surface`."""
    if mesh.sets.faces.keys() & set(SURFACE):
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
    return np.concatenate([faces[name] for name in SURFACE if name in faces])


def interface_sets(mesh: TetMesh) -> dict[str, IntArray]:
    """The sets of faces between two regions, recognised by the end of their names."""
    return {name: faces for name, faces in mesh.sets.faces.items() if name.endswith(INTERFACE)}


def listed_faces(mesh: TetMesh) -> IntArray:
    """Faces of the parts of the surface, then of the interfaces: (k, 3)."""
    return np.concatenate([surface_faces(mesh), *interface_sets(mesh).values()])


def among(faces: IntArray, others: IntArray) -> NDArray[np.bool_]:
    """Which faces (k, 3) are among others, whatever the order of their nodes: (k,)."""
    keys = packed(np.concatenate([faces, others]))
    return np.isin(keys[: len(faces)], keys[len(faces) :])


def members(count: int, indices: IntArray) -> NDArray[np.uint8]:
    """A set as an array of 0 and 1: (count,)."""
    flags = np.zeros(count, np.uint8)
    flags[indices] = 1
    return flags


def sides(mesh: TetMesh, faces: IntArray) -> tuple[IntArray, IntArray]:
    """The tetrahedron that each face belongs to, and its corner opposite the face: (k,), (k,) int32.

    A face inside the mesh belongs to the tetrahedron from whose outside it is counter-clockwise.
    """
    found = boundary(mesh)
    cells, missing = _owners(found.faces, found.cells, faces)
    if missing.any():
        near = np.flatnonzero(np.isin(mesh.cells, faces[missing]).sum(axis=1) >= 3)
        every = mesh.cells[near][:, TET_FACES].reshape(-1, 3)
        turned = np.roll(every, 1, axis=1), np.roll(every, 2, axis=1)
        all_turns = np.concatenate([every, *turned])
        cells[missing], strange = _owners(all_turns, np.tile(np.repeat(near, 4), 3), faces[missing], directed=True)
        if strange.any():
            raise InputError(f"face {faces[missing][np.argmax(strange)].tolist()} is not a face of a tetrahedron")
    on_face = (mesh.cells[cells][:, :, None] == faces[:, None, :]).any(axis=2)
    return cells, on_face.argmin(axis=1).astype(np.int32)


def _owners(
    known: IntArray, owners: IntArray, asked: IntArray, *, directed: bool = False
) -> tuple[IntArray, NDArray[np.bool_]]:
    """The owner of each `asked` face, looked up among the `known` faces, and which `asked` faces are not known."""
    both = np.concatenate([known, asked])
    key = np.unique(both, axis=0, return_inverse=True)[1].ravel() if directed else packed(both)
    order = np.argsort(key[: len(known)], kind="stable")
    place = np.searchsorted(key[: len(known)], key[len(known) :], sorter=order)
    place = order[np.minimum(place, len(known) - 1)]
    return owners[place].astype(np.int32), key[place] != key[len(known) :]


def faces_of_sides(cells: IntArray, owners: IntArray, opposite: IntArray) -> IntArray:
    """The faces of tetrahedra `cells[owners]` that are opposite to these corners, outward for positive volume."""
    return np.take_along_axis(cells[owners], TET_FACES[opposite], axis=1).astype(np.int32)
