"""Gmsh `.msh` 4.1, binary: a mesh with physical groups, written and read by Gmsh itself (https://gmsh.info/doc/texinfo).

Nodes have the tags 1 to n in the order of the mesh, tetrahedra the tags 1 to m. Each set of faces or tetrahedra is a
physical group of its name. Where sets overlap, Gmsh wants an entity for every combination of sets, which belongs to
several groups. Sets of nodes are not written: the nodes of a part of the surface follow from its faces, and the nodes
of a label from the field. Fields are post-processing views in the same file (`$NodeData`, `$ElementData`) of 1, 3 or 9
components. A field of another number k of components becomes k fields `<name>_1` to `<name>_k`. Fields are read as real
numbers.
"""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gmsh
import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import child, gmsh_reader
from cortet.formats.atomic import atomic_path
from cortet.formats.components import in_components
from cortet.formats.gmsh_reader import FIELDS, KINDS, TETRAHEDRON, TRIANGLE, session
from cortet.formats.numbering import indices
from cortet.formats.surface_sets import REGION_TAGS, SURFACE_TAGS, listed_faces, with_surface
from cortet.formats.untrusted import check_file, sound
from cortet.geometry.topology import packed
from cortet.meshes import IntArray, MeshSets, TetMesh

__all__ = ["TISSUE", "check_version", "read", "session", "write"]

#: group of all tetrahedra of a mesh without regions
TISSUE = "tissue"
#: bytes of address space and seconds of processor time that Gmsh may take, and more for a larger file
_MEMORY, _MEMORY_PER_BYTE = 2**32, 100
_SECONDS, _BYTES_PER_SECOND = 30, 500_000


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path`, complete or not at all."""
    mesh = with_surface(mesh)
    faces, face_groups = listed_faces(mesh), _face_groups(mesh)
    cell_groups = _cell_groups(mesh)
    with session(), atomic_path(path) as temporary:
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.option.setNumber("PostProcessing.SaveMesh", 0)
        gmsh.model.add("mesh")
        placed = np.zeros(len(mesh.points), bool)
        first_tag = len(mesh.cells) + 1
        surfaces = _add_entities(2, TRIANGLE, mesh, faces, first_tag, face_groups, placed, [])
        _add_entities(3, TETRAHEDRON, mesh, mesh.cells, 1, cell_groups, placed, surfaces)
        gmsh.write(str(temporary))
        for kind, fields in (("NodeData", mesh.point_data), ("ElementData", mesh.cell_data)):
            for name, values in in_components(fields, (1, 3, 9)).items():
                _append_field(temporary, kind, name, values)


def _face_groups(mesh: TetMesh) -> dict[str, NDArray[np.bool_]]:
    """Name -> which of the listed faces belong to it: parts of the surface by order, other sets by their nodes."""
    parts = [name for name in SURFACE_TAGS if name in mesh.sets.faces]
    faces = listed_faces(mesh)
    part = np.full(len(faces), -1)
    count = [len(mesh.sets.faces[name]) for name in parts]
    part[: sum(count)] = np.repeat(np.arange(len(parts)), count)
    groups = {name: part == number for number, name in enumerate(parts)}
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
    """Add a discrete entity for each combination of groups, with the nodes that none has yet (`placed`); their tags."""
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

    Gmsh runs in a process of its own, in an empty folder: it would also read `<name>.msh.opt`, which may hold commands.

    Raises
    ------
    InputError
        the file is missing, Gmsh cannot read it or crashes, it holds no tetrahedra, or it names nodes that it lacks
    """
    check_version(path)
    arrays, names = _read_by_gmsh(path)
    order = np.argsort(arrays["node_tags"])
    tags = arrays["node_tags"][order].astype(np.int64)
    if len(tags) == 0:
        raise InputError("holds no nodes", file=path)
    (face_tags, faces), (cell_tags, cells) = (_elements(kind, arrays, tags, path) for kind in KINDS)
    if len(cells) == 0:
        raise InputError("holds no tetrahedra", file=path)
    groups = {
        kind: {
            name: indices(tags_of, known, kind, path)
            for name, tags_of in _groups(kind, arrays, names[kind]).items()
            if name != TISSUE
        }
        for kind, known in (("triangle", face_tags), ("tetrahedron", cell_tags))
    }
    fields = {
        kind: {name: _field(arrays[f"{kind}_{number}"]) for number, name in enumerate(names[kind])} for kind in FIELDS
    }
    sets = MeshSets(faces={name: faces[rows] for name, rows in groups["triangle"].items()}, cells=groups["tetrahedron"])
    return sound(path, arrays["coordinates"][order], cells, fields["NodeData"], fields["ElementData"], sets)


def check_version(path: str | Path) -> None:
    """Raise InputError unless the file begins like a Gmsh file of version 4.1."""
    check_file(path)
    try:
        with Path(path).open("rb") as file:
            first, second = file.readline(100).strip(), file.readline(100).split()
    except OSError as error:
        raise InputError(f"cannot be opened: {error.strerror}", file=path) from error
    if first != b"$MeshFormat" or second[:1] != [b"4.1"]:
        raise InputError("is not a Gmsh file of version 4.1", file=path, remedy="save it as version 4.1 in Gmsh")


def _read_by_gmsh(path: str | Path) -> tuple[dict[str, NDArray[Any]], dict[str, list[str]]]:
    """Arrays and names of `gmsh_reader.arrays_of`."""
    size = Path(path).stat().st_size
    limits = [str(_MEMORY + _MEMORY_PER_BYTE * size), str(_SECONDS + size // _BYTES_PER_SECOND)]
    with TemporaryDirectory(prefix="cortet-gmsh-") as folder:
        source, target = Path(folder) / "mesh.msh", Path(folder) / "mesh.npz"
        source.symlink_to(Path(path).resolve())
        command = [sys.executable, "-P", gmsh_reader.__file__, str(source), str(target), *limits]
        done = child.run(command, cwd=folder)
        if done.returncode < 0:
            reason = f"Gmsh broke down reading it ({signal.Signals(-done.returncode).name})"
            raise InputError(reason, file=path, remedy="it is damaged: save it again in Gmsh")
        if done.returncode:
            said = (done.stderr.strip() or "no message").splitlines()[-1]
            raise InputError(f"Gmsh cannot read it: {said}", file=path)
        with np.load(target) as arrays:
            found = dict(arrays)
    return found, json.loads(str(found.pop("names")))


def _elements(
    kind: str, arrays: dict[str, NDArray[Any]], node_tags: NDArray[np.int64], path: str | Path
) -> tuple[NDArray[np.int64], IntArray]:
    """Tags, ascending, and nodes of all elements of a kind."""
    tags = arrays[f"{kind}_tags"]
    order = np.argsort(tags)
    nodes = arrays[f"{kind}_nodes"].astype(np.int64).reshape(-1, KINDS[kind][1] + 1)[order]
    return tags[order].astype(np.int64), indices(nodes, node_tags, "node", path)


def _groups(kind: str, arrays: dict[str, NDArray[Any]], names: list[str]) -> dict[str, NDArray[np.int64]]:
    """Tags, ascending, of the elements of each group; groups of the same name are joined."""
    found: dict[str, NDArray[np.int64]] = {}
    for number, name in enumerate(names):
        found[name] = np.union1d(found.get(name, []), arrays[f"{kind}_group_{number}"]).astype(np.int64)
    return found


def _field(rows: NDArray[Any]) -> NDArray[Any]:
    """Values of a view, in the order of tags."""
    return rows[:, 0] if rows.shape[1] == 1 else rows
