"""S5 renumbers, and lets nothing unsound through."""

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import StageError
from cortet.geometry.topology import boundary_faces, boundary_nodes
from cortet.meshes import TetMesh
from cortet.stages.solver_ready import surface_nodes_first


def shuffled() -> TetMesh:
    cube = cube_mesh(3, side=2.0, jitter=0.2)
    shuffle = np.random.default_rng(5).permutation(len(cube.points))
    where = np.argsort(shuffle)
    return TetMesh(cube.points[where], shuffle[cube.cells], {"x": cube.points[where, 0]}, {"cell": cube.cells[:, 0]})


def test_surface_nodes_come_first_and_keep_their_order():
    mesh = shuffled()
    ready, report = surface_nodes_first(mesh)
    assert np.array_equal(boundary_nodes(ready), np.arange(report.surface_nodes)) and report.surface_nodes == 56
    assert np.array_equal(ready.points[:56], mesh.points[boundary_nodes(mesh)])


def test_it_is_the_same_mesh_with_the_same_fields():
    mesh = shuffled()
    ready, report = surface_nodes_first(mesh)
    assert np.array_equal(ready.points[ready.cells], mesh.points[mesh.cells])
    assert np.array_equal(ready.point_data["x"], ready.points[:, 0]) and ready.cell_data == mesh.cell_data
    assert (report.nodes, report.tetrahedra, report.boundary_faces) == (64, 162, 108)
    assert report.volume_mm3 == pytest.approx(8)


def test_a_second_run_changes_nothing():
    once, _ = surface_nodes_first(shuffled())
    twice, _ = surface_nodes_first(once)
    assert np.array_equal(once.points, twice.points) and np.array_equal(once.cells, twice.cells)


def test_boundary_faces_look_outward():
    ready, _ = surface_nodes_first(shuffled())
    a, b, c = (ready.points[boundary_faces(ready)[:, i]] for i in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - 1.0) > 0).all()


def test_inverted_elements_are_refused():
    mesh = cube_mesh(2)
    cells = mesh.cells.copy()
    cells[5] = cells[5, [1, 0, 2, 3]]
    with pytest.raises(StageError, match="1 tetrahedra have no positive volume"):
        surface_nodes_first(TetMesh(mesh.points, cells))


def test_unused_nodes_are_refused():
    mesh = cube_mesh(2)
    with pytest.raises(StageError, match="2 nodes belong to no tetrahedron"):
        surface_nodes_first(TetMesh(np.concatenate([mesh.points, [[3, 3, 3], [4, 4, 4]]]), mesh.cells))


def test_overlapping_elements_are_refused():
    """Two tetrahedra on the same side of their common face: every volume positive, but part of the space twice."""
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 1], [0.3, 0.3, 0.5]]
    with pytest.raises(StageError, match="add up to"):
        surface_nodes_first(TetMesh(points, [[0, 1, 2, 3], [0, 1, 2, 4]]))
