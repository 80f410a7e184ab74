"""Gmsh `.msh` of version 2.2, binary: a mesh with physical groups (https://gmsh.info/doc/texinfo, file formats).

Nodes have the tags 1 to n in the order of the mesh, triangles and then tetrahedra the tags 1 to m. Each region, part of
the surface and interface is a physical group of its name, with the number of `tags`. No element is in two groups, and
no number means two groups: dolfinx makes an element of each member of each group, so elements in two would be doubled.
Other sets are not written: the nodes of a part of the surface follow from its faces, and labels are fields.

Fields are `$NodeData` and `$ElementData` of 1, 3 or 9 components. A field with any other number k of components becomes
k fields `<name>_1` to `<name>_k`. A field of the tetrahedra also has values for the triangles of the file: those of the
tetrahedra behind them. (meshio 5.3 fails on a file with a field of elements: give it VTU.)
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import listed_faces, with_surface
from cortet.formats.tags import face_tags, region_numbers, regions
from cortet.formats.values import in_components
from cortet.geometry.topology import TET_FACES, packed
from cortet.meshes import REGION, IntArray, TetMesh

#: Gmsh's types of elements
TRIANGLE, TETRAHEDRON = 2, 4
#: numbers of components that the format allows for a field
_WIDTHS = (1, 3, 9)


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path`, complete or not at all."""
    mesh = with_surface(mesh)
    faces = listed_faces(mesh)
    names = [(2, tag, name) for name, tag in face_tags(mesh).items()]
    names += [(3, tag, name) for name, tag in regions(mesh).items()]
    nodes = np.empty(len(mesh.points), [("tag", "<i4"), ("place", "<f8", 3)])
    nodes["tag"], nodes["place"] = np.arange(1, len(nodes) + 1), mesh.points
    fields = {name: values for name, values in mesh.cell_data.items() if name != REGION}  # the groups say so
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(b"$MeshFormat\n2.2 1 8\n" + np.int32(1).tobytes() + b"\n$EndMeshFormat\n")
        file.write(f"$PhysicalNames\n{len(names)}\n".encode())
        file.writelines(f'{dimension} {tag} "{_quotable(name)}"\n'.encode() for dimension, tag, name in names)
        file.write(f"$EndPhysicalNames\n$Nodes\n{len(nodes)}\n".encode() + nodes.tobytes() + b"\n$EndNodes\n")
        file.write(f"$Elements\n{len(faces) + len(mesh.cells)}\n".encode())
        file.write(_elements(TRIANGLE, faces, _of_faces(mesh), 1))
        file.write(_elements(TETRAHEDRON, mesh.cells, region_numbers(mesh), len(faces) + 1) + b"\n$EndElements\n")
        _write_fields(file, mesh.point_data, fields, np.concatenate([_behind(faces, mesh), np.arange(len(mesh.cells))]))


def _of_faces(mesh: TetMesh) -> NDArray[np.int64]:
    """The number of the group of each of the listed faces: (k,)."""
    tags = face_tags(mesh)
    return np.repeat(list(tags.values()), [len(mesh.sets.faces[name]) for name in tags])


def _elements(kind: int, elements: IntArray, groups: NDArray[np.integer[Any]], first: int) -> bytes:
    """Elements of one kind: their kind, number and two tags; then the tag, group, entity and nodes of each."""
    head = np.array([kind, len(elements), 2], "<i4")
    rows = np.column_stack([np.arange(first, first + len(elements)), groups, groups, elements + 1])
    return head.tobytes() + rows.astype("<i4").tobytes()


def _write_fields(
    file: BinaryIO,
    of_nodes: Mapping[str, NDArray[Any]],
    of_cells: Mapping[str, NDArray[Any]],
    owners: NDArray[np.int64],
) -> None:
    """Write fields; `owners` is the tetrahedron of each element of the file."""
    for name, values in in_components(of_nodes, _WIDTHS).items():
        _write_field(file, "NodeData", name, values)
    for name, values in in_components(of_cells, _WIDTHS).items():
        _write_field(file, "ElementData", name, values[owners])


def _behind(faces: IntArray, mesh: TetMesh) -> NDArray[np.int64]:
    """The tetrahedron behind each face of the mesh, the first one of two: (k,)."""
    keys = packed(np.concatenate([mesh.cells[:, corners] for corners in TET_FACES] + [faces]))
    count = 4 * len(mesh.cells)
    first, place = np.unique(keys[:count], return_index=True)
    return place[np.searchsorted(first, keys[count:])] % len(mesh.cells)


def _quotable(name: str) -> str:
    """A name between quotation marks, within which the format has no others."""
    return name.replace('"', "'")


def _write_field(file: BinaryIO, kind: str, name: str, values: NDArray[Any]) -> None:
    """Write a field, (n, k), of the tags 1 to n: its name, the time 0, its time step, components and length."""
    rows = np.empty(len(values), [("tag", "<i4"), ("values", "<f8", (values.shape[1],))])
    rows["tag"], rows["values"] = np.arange(1, len(values) + 1), values
    head = f'${kind}\n1\n"{_quotable(name)}"\n1\n0\n3\n0\n{values.shape[1]}\n{len(values)}\n'
    file.write(head.encode() + rows.tobytes() + f"\n$End{kind}\n".encode())
