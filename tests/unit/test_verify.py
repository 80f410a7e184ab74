"""Each broken convention of a written file is named, whatever the format, and no other is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported import full_mesh

from cortet.formats import FORMATS
from cortet.formats.hashing import sha256
from cortet.geometry.topology import boundary_surface
from cortet.meshes import MeshSets, TetMesh
from cortet.solver_files.export import export, write
from cortet.solver_files.fields import FieldSource
from cortet.solver_files.sidecar import sidecar_path
from cortet.solver_files.verify import verify

VOLUMES = [name for name, form in FORMATS.items() if not form.is_surface]
#: formats that list boundary faces by their nodes, so that one can face inward, be missing or be listed twice
LISTING_NODES = ["braingrowth", "febio", "fenics", "gmsh", "carp", "carp_binary"]
#: formats that hold fields
WITH_FIELDS = [name for name in FORMATS if name not in ("braingrowth", "nastran", "stl")]
CERTIFIED = {"certified": True, "reasons": []}


def swapped_node_pair(mesh: TetMesh) -> TetMesh:
    cells = mesh.cells.copy()
    cells[4, :2] = cells[4, 1::-1]
    return replace(mesh, cells=cells)


def wrong_sign(mesh: TetMesh) -> TetMesh:
    return replace(mesh, cells=mesh.cells[:, [0, 1, 3, 2]])


def inward_face(mesh: TetMesh) -> TetMesh:
    faces = mesh.sets.faces["cortical_surface"].copy()
    faces[7] = faces[7, ::-1]
    return with_cortical_faces(mesh, faces)


def missing_face(mesh: TetMesh) -> TetMesh:
    return with_cortical_faces(mesh, np.delete(mesh.sets.faces["cortical_surface"], 7, axis=0))


def repeated_face(mesh: TetMesh) -> TetMesh:
    faces = mesh.sets.faces["cortical_surface"]
    return with_cortical_faces(mesh, np.concatenate([faces, faces[:1]]))


def inner_face(mesh: TetMesh) -> TetMesh:
    deepest = next(cell for cell in mesh.cells if len(mesh.points) - 1 in cell)
    return with_cortical_faces(mesh, np.concatenate([mesh.sets.faces["cortical_surface"], [deepest[:3]]]))


def with_cortical_faces(mesh: TetMesh, faces: np.ndarray) -> TetMesh:
    """Only the division of the surface, with other faces of the cortical surface."""
    parts = {"cortical_surface": faces, "medial_wall": mesh.sets.faces["medial_wall"]}
    return replace(mesh, sets=MeshSets({}, parts, {}))


def interior_node_first(mesh: TetMesh) -> TetMesh:
    """The first and the last node change their numbers."""
    number = np.arange(len(mesh.points), dtype=np.int32)
    number[[0, -1]] = number[[-1, 0]]
    return TetMesh(
        mesh.points[number],
        number[mesh.cells],
        {name: values[number] for name, values in mesh.point_data.items()},
        sets=MeshSets(
            {name: np.sort(number[nodes]) for name, nodes in mesh.sets.nodes.items()},
            {name: number[faces] for name, faces in mesh.sets.faces.items()},
            mesh.sets.cells,
        ),
    )


def node_missing_from_a_set(mesh: TetMesh) -> TetMesh:
    nodes = {**mesh.sets.nodes, "cortical_surface": mesh.sets.nodes["cortical_surface"][1:]}
    return replace(mesh, sets=replace(mesh.sets, nodes=nodes))


def element_in_no_region(mesh: TetMesh) -> TetMesh:
    return replace(mesh, sets=replace(mesh.sets, cells={**mesh.sets.cells, "core": mesh.sets.cells["core"][1:]}))


def field_not_finite(mesh: TetMesh) -> TetMesh:
    values = mesh.point_data["thickness"].copy()
    values[3] = np.nan
    return replace(mesh, point_data={**mesh.point_data, "thickness": values})


@pytest.mark.parametrize("solver", FORMATS)
def test_a_whole_file_breaks_nothing(solver, tmp_path):
    assert broken(full_mesh(), solver, tmp_path) == []


@pytest.mark.parametrize("solver", VOLUMES)
@pytest.mark.parametrize(
    ("breakage", "words"),
    [
        (swapped_node_pair, "1 of 384 tetrahedra have no {sign} volume, the first"),
        (wrong_sign, "384 of 384 tetrahedra have no {sign} volume"),
    ],
)
def test_a_swapped_node_pair_and_a_wrong_sign_are_named(solver, breakage, words, tmp_path):
    (found,) = broken(breakage(full_mesh()), solver, tmp_path)
    assert words.format(sign="negative" if solver == "braingrowth" else "positive") in found


@pytest.mark.parametrize("solver", LISTING_NODES)
@pytest.mark.parametrize(
    ("breakage", "words"),
    [
        (inward_face, "1 triangles face inward, the first"),
        (missing_face, "1 boundary faces are missing from the triangles"),
        (repeated_face, "1 triangles are listed more than once"),
        (inner_face, "1 triangles are not boundary faces, the first"),
    ],
)
def test_a_wrong_list_of_faces_is_named(solver, breakage, words, tmp_path):
    found = broken(breakage(full_mesh()), solver, tmp_path)
    assert len(found) == 1 and words in found[0], found


def test_abaqus_names_a_missing_face_too(tmp_path):
    (found,) = broken(missing_face(full_mesh()), "abaqus", tmp_path)
    assert found == "1 boundary faces are missing from the triangles"


@pytest.mark.parametrize("solver", [name for name in VOLUMES if name != "braingrowth"])  # whose writer refuses it
def test_an_interior_node_first_is_named(solver, tmp_path):
    (found,) = broken(interior_node_first(full_mesh()), solver, tmp_path)
    assert found == "the 98 surface nodes are not the first nodes: they reach up to node 125"


@pytest.mark.parametrize("solver", ["abaqus", "febio", "fenics", "carp", "carp_binary"])
def test_a_set_that_differs_from_its_faces_is_named(solver, tmp_path):
    (found,) = broken(node_missing_from_a_set(full_mesh()), solver, tmp_path)
    assert found == "node set cortical_surface differs from the nodes of its faces in 1 nodes"


@pytest.mark.parametrize("solver", ["abaqus", "fenics", "vtu"])
def test_an_element_in_no_region_is_named(solver, tmp_path):
    (found,) = broken(element_in_no_region(full_mesh()), solver, tmp_path)
    assert found == "1 tetrahedra are in no region, or in two"


@pytest.mark.parametrize("solver", ["vtu", "fenics", "gmsh", "abaqus", "febio", "carp", "carp_binary"])
def test_a_value_that_is_not_finite_is_named(solver, tmp_path):
    (found,) = broken(field_not_finite(full_mesh()), solver, tmp_path)
    assert found == "field thickness has 1 values that are not finite"


@pytest.mark.parametrize("solver", ["stl", "gifti"])
def test_a_boundary_that_is_open_or_faces_inward_is_named(solver, tmp_path):
    surface, _ = boundary_surface(full_mesh())
    path = tmp_path / f"m{FORMATS[solver].suffix}"
    FORMATS[solver].write(replace(surface, faces=surface.faces[1:]), path)
    assert verify(path, solver) == ["the surface has 3 open edges (in one face only)"]
    FORMATS[solver].write(replace(surface, faces=surface.faces[:, ::-1]), path)
    assert verify(path, solver) == ["192 of 192 triangles face inward"]
    turned = surface.faces.copy()
    turned[5] = turned[5, ::-1]
    FORMATS[solver].write(replace(surface, faces=turned), path)
    assert verify(path, solver) == ["the surface has 3 edges between inconsistently oriented faces"]


@pytest.mark.parametrize("solver", WITH_FIELDS)
def test_a_stale_field_is_named(solver, tmp_path):
    """The values are those of before the nodes were renumbered, or the source has changed since."""
    source = tmp_path / "thickness.shape.gii"
    source.write_text("as it was")
    path = tmp_path / f"m{FORMATS[solver].suffix}"
    sources = {"thickness": FieldSource(str(source), sha256(source), "mm", "scalar", {})}
    mesh = full_mesh()
    export(mesh, path, solver=solver, certificate=CERTIFIED, sources=sources, interior="nearest")
    assert verify(path, solver) == []

    source.write_text("as it is now")
    assert verify(path, solver) == [f"field thickness is stale: {source} has changed since"]
    source.unlink()
    assert verify(path, solver) == []

    old = replace(mesh, point_data={**mesh.point_data, "thickness": mesh.point_data["thickness"][::-1]})
    write(old, path, solver=solver)
    assert verify(path, solver) == ["field thickness is stale: its values are not those that the sidecar records"]


@pytest.mark.parametrize("solver", FORMATS)
def test_fields_of_other_nodes_are_named(solver, tmp_path):
    path = tmp_path / f"m{FORMATS[solver].suffix}"
    mesh = full_mesh()
    export(mesh, path, solver=solver, certificate=CERTIFIED)
    write(replace(mesh, points=mesh.points * 1.001), path, solver=solver)
    assert "the nodes are not those that the sidecar records: the fields belong to other nodes" in verify(path, solver)


def test_a_field_that_the_sidecar_has_and_the_file_has_not_is_named(tmp_path):
    path = tmp_path / "m.vtu"
    export(full_mesh(), path, solver="vtu", certificate=CERTIFIED)
    record = json.loads(sidecar_path(path).read_text())
    record["fields"]["growth"] = record["fields"].pop("thickness")
    sidecar_path(path).write_text(json.dumps(record))
    assert verify(path, "vtu") == [
        "field thickness is not in the sidecar: its source is not known",
        "field growth of the sidecar is missing",
    ]


def broken(mesh: TetMesh, solver: str, folder: Path) -> list[str]:
    """What `verify` says of a file without a sidecar."""
    path = folder / f"m{FORMATS[solver].suffix}"
    write(mesh, path, solver=solver)
    return verify(path, solver)
