"""Gmsh `.msh` 4.1 and 2.2, binary: a mesh with physical groups (https://gmsh.info/doc/texinfo, file formats).

Nodes have the tags 1 to n in the order of the mesh and of the file, triangles and then tetrahedra the tags 1 to m in
the order of the file. All nodes belong to one entity, since meshio, which PyVista uses, takes fields of nodes by their
order. Each region, part of the surface and interface is a physical group of its name, with the number of `tags`. No
element is in two groups, and no number means two groups: dolfinx makes an element of each member of each group, so
elements in two would be doubled. Other sets are not written: the nodes of a part of the surface follow from its faces,
and labels are fields. (meshio 5.3 fails on any file of version 2.2 with a field of elements: give it version 4.1.)

Fields are `$NodeData` and `$ElementData` of 1, 3 or 9 components. A field with any other number k of components becomes
k fields `<name>_1` to `<name>_k`. Fields are read as real numbers. A field of the tetrahedra also has values for the
triangles of the file: those of the tetrahedra behind them. meshio needs one value per element, and tags that rise by
one from the first element of the file to the last. So the tetrahedra of a mesh with several entities change their
order; the field `number_in_mesh` keeps the old one, and `read` restores it.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import gmsh
import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats import child, gmsh_reader
from cortet.formats.atomic import atomic_path
from cortet.formats.components import in_components
from cortet.formats.gmsh_reader import FIELDS, KINDS, TETRAHEDRON, TRIANGLE, session
from cortet.formats.numbering import indices
from cortet.formats.surface_sets import listed_faces, with_surface
from cortet.formats.tags import face_tags, region_numbers, regions, without_tissue
from cortet.formats.untrusted import check_file, sound
from cortet.geometry.topology import TET_FACES, packed
from cortet.meshes import REGION, IntArray, MeshSets, TetMesh

__all__ = ["check_version", "read", "read_v2", "session", "write", "write_v2"]

#: field of the numbers that tetrahedra had before they changed their order
_NUMBER = "number_in_mesh"
#: numbers of components that the format allows for a field
_WIDTHS = (1, 3, 9)


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path` as version 4.1, complete or not at all."""
    mesh = with_surface(mesh)
    faces, number = listed_faces(mesh), region_numbers(mesh)
    fields = dict(mesh.cell_data) | ({REGION: number} if mesh.sets.cells else {})
    with session(), atomic_path(path) as temporary:
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.model.add("mesh")
        groups = {2: face_tags(mesh), 3: regions(mesh)}
        for dimension, names in groups.items():
            for name, group in names.items():
                # without the surfaces around a volume, whose numbers PyVista, by meshio, takes for those of elements
                gmsh.model.addDiscreteEntity(dimension, group)
                gmsh.model.addPhysicalGroup(dimension, [group], group, _quotable(name))
        tags = np.arange(1, len(mesh.points) + 1)
        gmsh.model.mesh.addNodes(3, int(number.min()), tags, mesh.points.ravel())
        _add_elements(TRIANGLE, faces, _of_faces(mesh), 1)
        _add_elements(TETRAHEDRON, mesh.cells, number, len(faces) + 1)
        gmsh.write(str(temporary))
        order = np.argsort(number, kind="stable")
        if np.any(np.diff(order) < 0):
            fields[_NUMBER] = np.arange(len(mesh.cells))
        with temporary.open("ab") as file:
            faces = faces[np.argsort(_of_faces(mesh), kind="stable")]
            _write_fields(file, mesh.point_data, fields, np.concatenate([_behind(faces, mesh), order]))


def write_v2(mesh: TetMesh, path: str | Path) -> None:
    """Write `path` as version 2.2, complete or not at all."""
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
        file.write(_elements_v2(TRIANGLE, faces, _of_faces(mesh), 1))
        file.write(_elements_v2(TETRAHEDRON, mesh.cells, region_numbers(mesh), len(faces) + 1) + b"\n$EndElements\n")
        _write_fields(file, mesh.point_data, fields, np.concatenate([_behind(faces, mesh), np.arange(len(mesh.cells))]))


def _of_faces(mesh: TetMesh) -> NDArray[np.int64]:
    """The number of the group of each of the listed faces: (k,)."""
    tags = face_tags(mesh)
    return np.repeat(list(tags.values()), [len(mesh.sets.faces[name]) for name in tags])


def _elements_v2(kind: int, elements: IntArray, groups: NDArray[np.integer[Any]], first: int) -> bytes:
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


def _add_elements(kind: int, elements: IntArray, groups: NDArray[np.integer[Any]], first: int) -> None:
    """Add elements of one kind, each to the entity of its group (k,), in the order of the groups' numbers.

    Parameters
    ----------
    first : tag of the first element
    """
    for group in np.unique(groups).tolist():
        mine = elements[groups == group]
        gmsh.model.mesh.addElementsByType(group, kind, np.arange(first, first + len(mine)), mine.ravel() + 1)
        first += len(mine)


def read(path: str | Path) -> TetMesh:
    """Read a file with Gmsh; tetrahedra are returned as they are in the file, positive or not, in the order of tags.

    Gmsh runs in a separate process, in an empty folder: it would also read `<name>.msh.opt`, which may hold commands.

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
        raise DamagedFileError("holds no nodes", file=path)
    (face_tags, faces), (cell_tags, cells) = (_elements(kind, arrays, tags, path) for kind in KINDS)
    if len(cells) == 0:
        raise DamagedFileError("holds no tetrahedra", file=path)
    groups = {
        kind: {
            name: indices(tags_of, known, kind, path)
            for name, tags_of in without_tissue(_groups(kind, arrays, names[kind])).items()
        }
        for kind, known in (("triangle", face_tags), ("tetrahedron", cell_tags))
    }
    fields = {
        kind: {name: _field(arrays[f"{kind}_{number}"]) for number, name in enumerate(names[kind])} for kind in FIELDS
    }
    sets = MeshSets(faces={name: faces[rows] for name, rows in groups["triangle"].items()}, cells=groups["tetrahedron"])
    of_cells = fields["ElementData"] | _region(arrays["tetrahedron_groups"], groups["tetrahedron"], len(cells))
    cells, of_cells, sets = _in_old_order(cells, of_cells, sets)
    return sound(path, arrays["coordinates"][order], cells, fields["NodeData"], of_cells, sets)


def _region(numbers: NDArray[Any], groups: Mapping[str, IntArray], count: int) -> dict[str, NDArray[Any]]:
    """The number of the group of each tetrahedron, if each is in just one; `numbers` are those of the groups."""
    times, region = np.zeros(count, np.int32), np.zeros(count, np.int32)
    for number, members in zip(numbers.tolist(), groups.values(), strict=False):
        times[members] += 1
        region[members] = number
    return {REGION: region} if len(groups) == len(numbers) and (times == 1).all() else {}


def _in_old_order(
    cells: IntArray, fields: dict[str, NDArray[Any]], sets: MeshSets
) -> tuple[IntArray, dict[str, NDArray[Any]], MeshSets]:
    """Tetrahedra, their fields and their sets in the order that `write` recorded, if it did."""
    noted = fields.get(_NUMBER)
    if noted is None or not np.array_equal(np.sort(noted), np.arange(len(cells))):
        return cells, fields, sets
    old = noted.astype(np.int64)
    order = np.argsort(old)
    others = {name: values[order] for name, values in fields.items() if name != _NUMBER}
    return (
        cells[order],
        others,
        MeshSets(sets.nodes, sets.faces, {name: np.sort(old[part]) for name, part in sets.cells.items()}),
    )


#: a file of version 2.2 is read like any other
read_v2 = read


def check_version(path: str | Path) -> None:
    """Raise InputError unless the file begins like a Gmsh file of version 4.1 or 2.2."""
    check_file(path)
    try:
        with Path(path).open("rb") as file:
            first, second = file.readline(100).strip(), file.readline(100).split()
    except OSError as error:
        raise InputError(
            f"cannot be opened: {error.strerror}", file=path, remedy="check the path and its permissions"
        ) from error
    if first != b"$MeshFormat" or second[:1] not in ([b"4.1"], [b"2.2"]):
        raise InputError("is not a Gmsh file of version 4.1 or 2.2", file=path, remedy="save it as version 4.1 in Gmsh")


def _read_by_gmsh(path: str | Path) -> tuple[dict[str, NDArray[Any]], dict[str, list[str]]]:
    """Arrays and names of `gmsh_reader.arrays_of`."""
    with TemporaryDirectory(prefix="cortet-gmsh-") as folder:
        source, target = Path(folder) / "mesh.msh", Path(folder) / "mesh.npz"
        source.symlink_to(Path(path).resolve())
        command = [sys.executable, "-P", gmsh_reader.__file__, str(source), str(target)]
        done = child.run(command, cwd=folder)
        if done.returncode < 0:
            reason = f"Gmsh broke down reading it ({signal.Signals(-done.returncode).name})"
            raise InputError(reason, file=path, remedy="it is damaged: save it again in Gmsh")
        if done.returncode:
            said = (done.stderr.strip() or "no message").splitlines()[-1]
            raise DamagedFileError(f"Gmsh cannot read it: {said}", file=path)
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
