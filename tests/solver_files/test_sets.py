"""Named sets: the division of surface and tissue, and one set per label."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exported import full_mesh
from shapes import ball_mesh

from cortet.errors import InputError
from cortet.geometry.topology import boundary_faces, boundary_nodes
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh
from cortet.solver_files.sets import named_sets, require_same_regions, set_name
from cortet.stages.solver_ready import surface_nodes_first


@pytest.fixture(scope="module")
def ball() -> TetMesh:
    return surface_nodes_first(ball_mesh(3, radius=10.0))[0]


def test_cortex_is_what_lies_within_a_depth(ball):
    cells = named_sets(ball, cortex_depth=3.0).sets.cells
    radius = np.linalg.norm(ball.points[ball.cells].mean(axis=1), axis=1)
    assert np.array_equal(np.sort(np.concatenate([*cells.values()])), np.arange(len(ball.cells)))
    assert radius[cells["cortex"]].min() > 6.8 and radius[cells["core"]].max() < 7.2
    volume = signed_volumes(ball.points, ball.cells)
    assert volume[cells["core"]].sum() / volume.sum() == pytest.approx(0.7**3, rel=0.1)


def test_cortex_by_a_field_is_as_deep_as_the_field_says_there(ball):
    x = ball.points[:, 0]
    mesh = replace(ball, point_data={"thickness": np.where(x > 0, 4.0, 2.0)})
    cortex = named_sets(mesh, cortex_depth=9.0, cortex_thickness="thickness").sets.cells["cortex"]
    centroids = mesh.points[mesh.cells].mean(axis=1)
    radius = np.linalg.norm(centroids, axis=1)
    inside = np.isin(np.arange(len(mesh.cells)), cortex)
    right, left = centroids[:, 0] > 2, centroids[:, 0] < -2
    assert not inside[right & (radius < 5.8)].any() and inside[right & (radius > 6.2)].all()
    assert not inside[left & (radius < 7.8)].any() and inside[left & (radius > 8.2)].all()


def test_the_medial_wall_is_where_its_label_is():
    mesh = full_mesh()
    wall, cortical = mesh.sets.faces["medial_wall"], mesh.sets.faces["cortical_surface"]
    assert len(wall) + len(cortical) == len(boundary_faces(mesh))
    bottom = boundary_faces(mesh)[(mesh.points[boundary_faces(mesh)][:, :, 2] == 0).all(axis=1)]
    assert set(map(tuple, bottom.tolist())) <= set(map(tuple, wall.tolist()))
    assert ((mesh.point_data["area"][wall] == 0).sum(axis=1) >= 1).all()
    assert np.array_equal(mesh.sets.nodes["medial_wall"], np.unique(wall))


def test_every_label_is_a_set_of_surface_nodes_of_faces_and_of_tetrahedra():
    """So that each parcel can have a material of its own."""
    mesh = full_mesh()
    labels, surface = mesh.point_data["area"], boundary_nodes(mesh)
    names = {"area_Medial_wall": 0, "area_V1": 3, "area_12": 12}
    assert mesh.sets.nodes.keys() == {"cortical_surface", "medial_wall", *names}
    for name, key in names.items():
        assert np.array_equal(mesh.sets.nodes[name], surface[labels[surface] == key])
    assert sum(len(mesh.sets.faces[name]) for name in names) == len(boundary_faces(mesh))
    parcels = np.concatenate([mesh.sets.cells[name] for name in names])
    assert np.array_equal(np.sort(parcels), mesh.sets.cells["cortex"])
    of_nodes = labels[mesh.cells[mesh.sets.cells["area_V1"]]]
    assert ((of_nodes == 3).sum(axis=1) >= 2).all()


@pytest.mark.parametrize(
    ("text", "taken", "name"),
    [
        ("aparc_V1", [], "aparc_V1"),
        ("aparc_Left/Right (lateral)", [], "aparc_Left_Right_lateral"),
        ("12", [], "set_12"),
        ("aparc_v1", ["aparc_V1"], "aparc_v1_2"),
        ("a" * 100, [], "a" * 80),
        ("tissue_Großhirn äö", [], "tissue_Grohirn_ao"),
    ],
)
def test_names_are_such_that_every_solver_takes_them(ball, text, taken, name):
    assert set_name(text, taken) == name
    labelled = replace(ball, point_data={"area": (ball.points[:, 0] > 0) + 3})
    faces = named_sets(labelled, label_names={"area": {3: "皮質", 4: "V1"}}).sets.faces
    assert {"area_3", "area_V1"} <= faces.keys(), "a name without a letter for solvers is replaced by its key"


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"medial_wall": {"parcels": [0]}}, "parcels.*area"),
        ({"medial_wall": {"area": [0, 3, 12]}}, "entire surface"),
        ({"cortex_thickness": "area"}, "area"),
        ({"cortex_thickness": "thick"}, "thick .*thickness, normal, area"),
        ({"tissues": ["large"], "tags": "large"}, "9999998"),
    ],
)
def test_fields_that_are_not_there_or_that_no_file_holds_are_refused(arguments, word):
    mesh = full_mesh()
    for largest in (10**7 - 1, 2**31 - 1, 2**33):
        labels = np.where(np.arange(len(mesh.cells)) % 2, 0, largest)
        with pytest.raises(InputError, match=word):
            named_sets(replace(mesh, cell_data={"large": labels}), **arguments)


SWAPPED = {1: 2, 2: 1}


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (
            np.vectorize(SWAPPED.get),
            r"disagree on \d,\d{3} tetrahedra, the first is number 0: its region is \d, its set is co",
        ),
        (np.ones_like, "disagree on"),
        (lambda region: np.where(np.arange(len(region)) == 7, 0, region), "disagree on 1 tetrahedron.*number 7.*is 0"),
        (lambda region: np.where(np.arange(len(region)) == 9, 7, region), "disagree on 1 tetrahedron.*number 9.*is 7"),
    ],
)
@pytest.mark.parametrize("inner", [[], ["white"]])
def test_numbers_of_regions_that_disagree_with_the_sets_are_refused(ball, change, word, inner):
    """They were ignored: the sets were certified, and a solver that reads the array got another brain."""
    mesh = named_sets(ball, cortex_depth=3.0)
    require_same_regions(mesh, inner)
    with pytest.raises(InputError, match=word):
        require_same_regions(replace(mesh, cell_data={"region": change(mesh.cell_data["region"])}), inner)


def test_a_tetrahedron_in_two_regions_is_refused(ball):
    mesh = named_sets(ball, cortex_depth=3.0)
    cells = {**mesh.sets.cells, "core": np.union1d(mesh.sets.cells["core"], mesh.sets.cells["cortex"][:1])}
    with pytest.raises(InputError, match="1 tetrahedron is in several of the sets cortex, core"):
        require_same_regions(replace(mesh, sets=replace(mesh.sets, cells=cells)), [])


def test_labels_in_place_of_regions_are_no_disagreement(ball):
    tissue = (ball.points[ball.cells].mean(axis=1)[:, 0] > 0).astype(np.int32) + 4
    mesh = named_sets(replace(ball, cell_data={"tissue": tissue}), cortex_depth=3.0, tissues=["tissue"], tags="tissue")
    assert {*mesh.cell_data["region"]} == {4, 5}
    require_same_regions(mesh, [])
