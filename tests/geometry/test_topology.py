"""Connectivity on meshes small enough to count by hand."""

from dataclasses import replace

import numpy as np
import pytest

from cortet.geometry import topology
from cortet.meshes import TetMesh

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
UNIT = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])


def torus(m: int = 4, n: int = 4) -> np.ndarray:
    i, j = (x.ravel() for x in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    a, b, c, d = i * n + j, (i + 1) % m * n + j, (i + 1) % m * n + (j + 1) % n, i * n + (j + 1) % n
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def test_a_tetrahedron_is_a_sphere():
    found = topology.surface_topology(TETRAHEDRON)
    assert found == topology.SurfaceTopology(1, 2, 0, 0, 0, 0)
    assert found.is_closed_manifold and found.genus == 0 and found.problems() == []


def test_triangles_that_a_caller_changes_are_looked_at_again():
    faces = TETRAHEDRON.copy()
    assert topology.surface_topology(faces).open_edges == 0
    faces[3] = faces[0]
    assert topology.surface_topology(faces).open_edges == 2, "a writable array is not remembered"


def test_a_torus_has_a_handle_and_says_so():
    found = topology.surface_topology(torus())
    assert found.is_closed_manifold and found.genus == 1
    assert found.problems() == ["Euler number 0 instead of 2 (genus 1)"]
    assert found.problems(genus=1) == []


@pytest.mark.parametrize(
    ("faces", "kind", "count"),
    [
        (TETRAHEDRON[:3], "open_edges", 3),
        (np.concatenate([TETRAHEDRON, TETRAHEDRON + 4]), "components", 2),
        (np.concatenate([TETRAHEDRON, [[0, 1, 4]]]), "nonmanifold_edges", 1),
        (np.concatenate([TETRAHEDRON[:3], TETRAHEDRON[3:, ::-1]]), "misoriented_edges", 3),
        (np.concatenate([TETRAHEDRON, np.where(TETRAHEDRON == 0, 0, TETRAHEDRON + 3)]), "pinched_vertices", 1),
    ],
)
def test_each_defect_is_counted_under_its_own_name(faces, kind, count):
    found = topology.surface_topology(faces.astype(np.int32))
    assert getattr(found, kind) == count
    assert not found.is_closed_manifold and found.problems()


def test_boundary_of_two_glued_tetrahedra_is_outward_and_leaves_the_shared_face_out():
    points = np.vstack([UNIT, [1, 1, 1]])
    mesh = TetMesh(points, [[0, 1, 2, 3], [1, 2, 3, 4]])
    found = topology.boundary(mesh)
    assert len(found.faces) == 6 and found.cells.tolist() == [0, 0, 0, 1, 1, 1]
    assert {1, 2, 3} not in [set(face) for face in found.faces.tolist()]
    assert topology.enclosed_volume(points, found.faces) == pytest.approx(1 / 6 + 1 / 3)
    moved, reordered = replace(mesh, points=2 * points), TetMesh(points, mesh.cells[::-1])
    assert topology.boundary(mesh) is found and topology.boundary(moved) is found, "the tetrahedra are the same"
    assert topology.boundary(reordered) is not found
    assert np.array_equal(topology.boundary_surface(moved)[0].points, 2 * points), "points are not remembered"
    surface, nodes = topology.boundary_surface(mesh)
    assert nodes.tolist() == [0, 1, 2, 3, 4] and topology.surface_topology(surface.faces).is_closed_manifold


def test_geometry_of_the_unit_tetrahedron():
    assert topology.enclosed_volume(UNIT + 100, TETRAHEDRON) == pytest.approx(1 / 6)
    assert sorted(topology.face_areas(UNIT, TETRAHEDRON)) == pytest.approx([0.5, 0.5, 0.5, 3**0.5 / 2])
    assert topology.vertex_normals(UNIT, TETRAHEDRON)[0] == pytest.approx(-np.ones(3) / 3**0.5)
    assert topology.neighbour_means(UNIT, TETRAHEDRON)[0] == pytest.approx(np.ones(3) / 3)


def test_faces_are_told_apart_by_one_number_each_also_in_meshes_of_millions_of_nodes():
    faces = np.random.default_rng(0).integers(0, 30, (200, 3))
    small = np.unique(topology.packed(faces), return_inverse=True)[1]
    far = np.unique(topology.packed(np.vstack([faces, [[2**22, 2**22 + 1, 2**22 + 2]]])), return_inverse=True)[1][:-1]
    assert np.array_equal(small, far)
