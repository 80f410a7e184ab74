"""Post-mesh smoothing of the boundary: smoother, valid, and on the surface unless asked otherwise."""

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.config.stages import SmoothBoundary
from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.measure.fidelity import boundary_roughness
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise.backing_off import back_off
from cortet.stages.clean import clean
from cortet.stages.reconnect import reconnect
from cortet.stages.smooth_boundary import smooth_boundary

SURFACE = ball_surface(3, 1.0)


@pytest.fixture(scope="module")
def rough() -> TetMesh:
    """A good mesh of a ball whose boundary vertices are unevenly spread over the sphere."""
    mesh, _ = reconnect(clean(ball_mesh(3), SURFACE)[0], SURFACE)
    nodes = topology.boundary_nodes(mesh)
    target = mesh.points.copy()
    target[nodes] += np.random.default_rng(0).normal(0, 0.02, (len(nodes), 3))
    tree = surface_tree(SURFACE.points, SURFACE.faces)
    target[nodes] = closest_points(tree, target[nodes]).points
    points, share = back_off(mesh.points, target, mesh.cells, q_max=0.6)
    return TetMesh(np.where(share[:, None] == 1, points, mesh.points), mesh.cells)


def roughness(mesh: TetMesh) -> float:
    boundary, _ = topology.boundary_surface(mesh)
    return boundary_roughness(boundary.points, boundary.faces)


def test_the_boundary_becomes_smoother_and_stays_on_the_surface(rough):
    result, report = smooth_boundary(rough, SURFACE)
    assert report.roughness == pytest.approx(roughness(result))
    assert report.roughness < 0.7 * report.roughness_before == pytest.approx(0.7 * roughness(rough))
    assert report.nodes_to_surface_mm.max < 1e-12 and report.displacement_mm.mean > 0.01
    assert report.q_max <= 0.5 and np.array_equal(result.cells, rough.cells)
    assert (signed_volumes(result.points, result.cells) > 0).all()


def test_published_smoothing_leaves_the_surface_and_the_report_says_how_far(rough):
    result, report = smooth_boundary(rough, SURFACE, SmoothBoundary(iterations=10, onto_surface=False))
    assert report.roughness < report.roughness_before
    assert report.nodes_to_surface_mm.mean > 0.03
    assert (signed_volumes(result.points, result.cells) > 0).all()


def test_iterations_are_halved_until_no_element_inverts():
    mesh = ball_mesh(2)  # too coarse and too bad to be smoothed far
    _, report = smooth_boundary(mesh, SURFACE, SmoothBoundary(iterations=200, onto_surface=False))
    assert report.iterations < 200
