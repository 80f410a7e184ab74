"""S4: worst elements improve, and the boundary does what was asked."""

import numpy as np
import pytest
from pydantic import ValidationError
from shapes import ball_mesh, ball_surface

from cortet.config.stages import Clean
from cortet.errors import StageError
from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.measure.quality import quality
from cortet.meshes import TetMesh
from cortet.stages.clean import clean, schedule

SURFACE = ball_surface(2, 1.0)


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return ball_mesh()


def test_sliding_keeps_connectivity_and_surface(mesh):
    result, report = clean(mesh, SURFACE)
    nodes = topology.boundary_nodes(result)
    tree = surface_tree(SURFACE.points, SURFACE.faces)
    assert np.array_equal(result.cells, mesh.cells)
    assert closest_points(tree, result.points[nodes]).distances.max() < 1e-12
    q = quality(result.points, result.cells)
    assert (report.q_mean, report.q_max) == (q.mean(), q.max())
    assert report.q_max < report.q_max_before
    assert report.vertices_moved > 0 and report.vertices_held == 0


def test_published_setting_never_moves_what_is_good_and_ends_the_tail_without_paying_with_the_mean(mesh):
    _, report = clean(mesh, SURFACE, Clean(boundary="free", improve_mean=False))
    assert [one.threshold for one in report.passes] == pytest.approx([0.15, 0.7, 0.5, 0.3, 0.2, 0.15])
    tail, last = report.passes[-2:]
    assert last.q_mean <= tail.q_mean and last.q_max <= tail.q_max


def test_fixed_boundary_does_not_move(mesh):
    nodes = topology.boundary_nodes(mesh)
    result, _ = clean(mesh, SURFACE, Clean(boundary="fixed"))
    assert np.array_equal(result.points[nodes], mesh.points[nodes])


def test_a_good_mesh_is_left_as_it_is():
    corner = np.array([[1, 1, 1], [-1, 1, -1], [1, -1, -1], [-1, -1, 1.0]])
    mesh = TetMesh(corner, [[0, 1, 2, 3]])
    surface, _ = topology.boundary_surface(mesh)
    result, report = clean(mesh, surface, Clean(improve_mean=False))
    assert np.array_equal(result.points, mesh.points) and report.vertices_moved == 0


def test_each_pass_comes_closer_to_min_max_unless_the_mean_would_pay_for_it():
    assert [aim.power for aim in schedule([0.7, 0.5, 0.3], improve_mean=True)] == [2, 8, 16, 32, 2]
    assert [aim.power for aim in schedule([0.7, 0.5, 0.3], improve_mean=False)] == [2, 4, 4, 4, 16, 2]
    assert [aim.threshold for aim in schedule([0.3], improve_mean=False)] == pytest.approx([0.15, 0.3, 0.2, 0.15])
    assert schedule([], improve_mean=False) == []
    assert [aim.threshold for aim in schedule([0.4], improve_mean=True)] == [0, 0.4, 0]


def test_overlapping_tetrahedra_and_settings_that_contradict_each_other_are_refused(mesh):
    apex = mesh.points[mesh.cells[0]].mean(axis=0)
    on_one_side = TetMesh(
        np.vstack([mesh.points, apex]), np.vstack([mesh.cells[:1], [*mesh.cells[0, :3], len(mesh.points)]])
    )
    with pytest.raises(StageError, match="overlap"):
        clean(on_one_side, SURFACE)
    with pytest.raises(ValidationError, match="meshtool"):
        Clean(backend="meshtool")
