"""Gmsh `.msh` 4.1, binary: a mesh with physical groups, written and read by Gmsh itself (https://gmsh.info/doc/texinfo).

Nodes have the tags 1 to n in the order of the mesh, tetrahedra the tags 1 to m. Each set of faces or tetrahedra is a
physical group of its name; where sets overlap, Gmsh wants an entity for every combination of them, which belongs to
several groups. Sets of nodes are not written: those of a part of the surface are the nodes of its faces, and those of a
label are where the field has its value. Fields are post-processing views in the same file (`$NodeData`,
`$ElementData`) of 1, 3 or 9 components; a field of k others becomes k fields `<name>_1` to `<name>_k`. They are read as
real numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.components import in_components
from cortet.formats.numbering import indices
from cortet.formats.surface_sets import REGION_TAGS, SURFACE_TAGS, surface_faces, with_surface
from cortet.mesh import IntArray, MeshSets, TetMesh
from cortet.topology import packed

#: group of all tetrahedra of a mesh without regions
TISSUE = "tissue"
_TRIANGLE, _TETRAHEDRON = 2, 4  # Gmsh's element types


@contextmanager
def session() -> Iterator[None]:
    """An empty Gmsh model that reads no arguments, configuration or signals, is silent and runs on one thread."""
    gmsh.initialize(argv=[], readConfigFiles=False, run=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        yield
    finally:
        gmsh.finalize()


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path`, complete or not at all."""
    mesh = with_surface(mesh)
    faces, face_groups = surface_faces(mesh), _face_groups(mesh)
    cell_groups = _cell_groups(mesh)
    with session(), atomic_path(path) as temporary:
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
        gmsh.model.add("mesh")
        placed = np.zeros(len(mesh.points), bool)
        first_tag = len(mesh.cells) + 1
        surfaces = _add_entities(2, _TRIANGLE, mesh, faces, first_tag, face_groups, placed, [])
        _add_entities(3, _TETRAHEDRON, mesh, mesh.cells, 1, cell_groups, placed, surfaces)
        gmsh.write(str(temporary))
        for kind, fields in (("NodeData", mesh.point_data), ("ElementData", mesh.cell_data)):
            for name, values in in_components(fields, (1, 3, 9)).items():
                _append_field(temporary, kind, name, values)


def _face_groups(mesh: TetMesh) -> dict[str, NDArray[np.bool_]]:
    """Name -> which of the listed faces belong to it; parts of the surface by their place, others by their nodes."""
    parts = [name for name in SURFACE_TAGS if name in mesh.sets.faces]
    part = np.repeat(np.arange(len(parts)), [len(mesh.sets.faces[name]) for name in parts])
    groups = {name: part == number for number, name in enumerate(parts)}
    faces = surface_faces(mesh)
    for name in mesh.sets.faces.keys() - groups.keys():
        key = packed(np.concatenate([faces, mesh.sets.faces[name]]))
        groups[name] = np.isin(key[: len(faces)], key[len(faces) :])
    return {name: groups[name] for name in mesh.sets.faces}


def _cell_groups(mesh: TetMesh) -> dict[str, NDArray[np.bool_]]:
    groups = {}
    for name, cells in mesh.sets.cells.items():
        groups[name] = np.zeros(len(mesh.cells), bool)
        groups[name][cells] = True
    if not REGION_TAGS.keys() & groups.keys():
        groups[TISSUE] = np.ones(len(mesh.cells), bool)
    return groups


def _add_entities(
    dimension: int,
    kind: int,
    mesh: TetMesh,
    elements: IntArray,
    first_tag: int,
    groups: dict[str, NDArray[np.bool_]],
    placed: NDArray[np.bool_],
    boundary: list[int],
) -> list[int]:
    """One discrete entity for each combination of groups, with the nodes that are not `placed` yet; their tags."""
    combination = np.zeros(len(elements), np.int64)
    for belongs in groups.values():
        combination = np.unique(2 * combination + belongs, return_inverse=True)[1]
    entities: dict[str, list[int]] = {name: [] for name in groups}
    count = int(combination.max(initial=-1)) + 1
    for number in range(count):
        tag = number + 1
        mine = np.flatnonzero(combination == number)
        gmsh.model.addDiscreteEntity(dimension, tag, boundary)
        nodes = np.unique(elements[mine])
        nodes = nodes[~placed[nodes]]
        placed[nodes] = True
        gmsh.model.mesh.addNodes(dimension, tag, nodes + 1, mesh.points[nodes].ravel())
        gmsh.model.mesh.addElementsByType(tag, kind, mine + first_tag, elements[mine].ravel() + 1)
        for name, belongs in groups.items():
            if belongs[mine[0]]:
                entities[name].append(tag)
    for name, tags in entities.items():
        if tags:
            gmsh.model.addPhysicalGroup(dimension, tags, name=name)
    return list(range(1, count + 1))


def _append_field(path: Path, kind: str, name: str, values: NDArray[Any]) -> None:
    view = gmsh.view.add(name)
    tags = np.arange(1, len(values) + 1)
    numbers = values.astype(float).ravel()
    gmsh.view.addHomogeneousModelData(view, 0, "mesh", kind, tags, numbers, numComponents=values.shape[1])
    gmsh.view.write(view, str(path), append=True)
    gmsh.view.remove(view)


def read(path: str | Path) -> TetMesh:
    """Read a file with Gmsh; tetrahedra come as they are in the file, positive or not, in the order of their tags.

    Raises
    ------
    InputError
        the file is missing, Gmsh cannot read it, or it holds no tetrahedra
    """
    check_version(path)
    with session():
        try:
            gmsh.open(str(path))
        except Exception as error:  # what the Gmsh API raises
            raise InputError(f"Gmsh cannot read it: {error}", file=path) from error
        node_tags, coordinates, _ = gmsh.model.mesh.getNodes()
        order = np.argsort(node_tags)
        tags = node_tags[order].astype(np.int64)
        if len(tags) == 0:
            raise InputError("holds no nodes", file=path)
        face_tags, faces = _elements(_TRIANGLE, 3, tags, path)
        cell_tags, cells = _elements(_TETRAHEDRON, 4, tags, path)
        groups = {dimension: _groups(dimension, kind) for dimension, kind in ((2, _TRIANGLE), (3, _TETRAHEDRON))}
        fields = {kind: dict(_fields(kind)) for kind in ("NodeData", "ElementData")}
    if len(cells) == 0:
        raise InputError("holds no tetrahedra", file=path)
    sets = MeshSets(
        faces={name: faces[indices(members, face_tags, "triangle", path)] for name, members in groups[2].items()},
        cells={
            name: indices(members, cell_tags, "tetrahedron", path)
            for name, members in groups[3].items()
            if name != TISSUE
        },
    )
    return TetMesh(coordinates.reshape(-1, 3)[order], cells, fields["NodeData"], fields["ElementData"], sets)


def check_version(path: str | Path) -> None:
    """Raises InputError unless the file begins as one of version 4.1."""
    try:
        with Path(path).open("rb") as file:
            first, second = file.readline().strip(), file.readline().split()
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}", file=path) from error
    if first != b"$MeshFormat" or second[:1] != [b"4.1"]:
        raise InputError("is not a Gmsh file of version 4.1", file=path, remedy="save it as version 4.1 in Gmsh")


def _elements(
    kind: int, corners: int, node_tags: NDArray[np.int64], path: str | Path
) -> tuple[NDArray[np.int64], IntArray]:
    """Tags, ascending, and nodes of all elements of a kind."""
    tags, nodes = gmsh.model.mesh.getElementsByType(kind)
    order = np.argsort(tags)
    return tags[order].astype(np.int64), indices(
        nodes.astype(np.int64).reshape(-1, corners)[order], node_tags, "node", path
    )


def _groups(dimension: int, kind: int) -> dict[str, NDArray[np.int64]]:
    """Name -> tags of its elements, ascending."""
    groups = {}
    for _, number in gmsh.model.getPhysicalGroups(dimension):
        entities = gmsh.model.getEntitiesForPhysicalGroup(dimension, number)
        tags = [gmsh.model.mesh.getElementsByType(kind, entity)[0] for entity in entities]
        name = gmsh.model.getPhysicalName(dimension, number) or str(number)
        groups[name] = np.sort(np.concatenate(tags)).astype(np.int64)
    return groups


def _fields(kind: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """Name and values of the views of a kind, in the order of tags."""
    for view in gmsh.view.getTags():
        found, tags, values, _, components = gmsh.view.getHomogeneousModelData(view, 0)
        if found == kind:
            rows = values.reshape(-1, components)[np.argsort(tags)]
            yield gmsh.view.option.getString(view, "Name"), rows[:, 0] if components == 1 else rows
