"""S6 puts the boundary onto the surface without spoiling an element."""

import numpy as np
import pytest
from shapes import ball_surface

from cortet.config.stages import Generate, Relocate, Snap
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.topology import boundary_nodes
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh, TriSurface
from cortet.stages.generate import generate
from cortet.stages.relocate import relocate
from cortet.stages.snap import ON_SURFACE_MM, snap

BALL = ball_surface(4)


def distances(mesh: TetMesh, surface: TriSurface = BALL) -> np.ndarray:
    return closest_points(surface_tree(surface.points, surface.faces), mesh.points[boundary_nodes(mesh)]).distances


@pytest.fixture(scope="module")
def generated() -> TetMesh:
    return generate(BALL, Generate(backend="cgal"), cell_size=1.2, mesher="cgal")[0]


@pytest.fixture(scope="module")
def floating(generated) -> TetMesh:
    """As the published line leaves it: Gmsh has moved the boundary off the surface."""
    return relocate(generated, Relocate(boundary="free"))[0]


def test_after_meshing_there_is_nothing_to_do_and_the_report_says_so(generated):
    result, report = snap(generated, BALL)
    assert result is generated and report.outcome == "nothing to do: the boundary already lies on the surface"
    assert report.max_distance_before_mm < 1e-5 and report.repair_rounds == 0


def test_a_floating_boundary_comes_back_to_the_surface(floating):
    assert distances(floating).max() > 0.01
    result, report = snap(floating, BALL)
    assert distances(result).max() <= ON_SURFACE_MM
    assert report.nodes_left_off == 0 and report.outcome.startswith("the boundary lies on the surface")
    assert report.max_distance_before_mm == distances(floating).max()
    assert report.q_max_before == quality(floating.points, floating.cells).max()
    assert signed_volumes(result.points, result.cells).min() > 0 and report.q_max_after < 0.6
    assert result.cells is floating.cells
    to_vertex = np.linalg.norm(result.points[boundary_nodes(result), None] - BALL.points, axis=2).min(axis=1)
    assert np.median(to_vertex) > 0.05, "the nearest point, not the nearest vertex"


def test_elements_that_would_invert_are_repaired_and_counted(generated):
    """Boundary nodes pushed out so far that their way back leads past the nodes below them."""
    tangled = generated.points.copy()
    nodes = boundary_nodes(generated)
    interior = np.setdiff1d(np.arange(len(tangled)), nodes)
    near = interior[np.linalg.norm(tangled[interior], axis=1) > 3.6]
    tangled *= 1.25
    tangled[near] *= 5.05 / np.linalg.norm(tangled[near], axis=1, keepdims=True)
    swollen = TetMesh(tangled, generated.cells)
    assert signed_volumes(swollen.points, swollen.cells).min() > 0, "the input is valid, only its way back is not"
    result, report = snap(swollen, BALL)
    assert report.repair_rounds > 0
    assert signed_volumes(result.points, result.cells).min() > 0
    assert report.max_distance_after_mm < 0.3 * report.max_distance_before_mm


def test_no_element_is_lifted_to_the_limit(floating):
    limit = float(np.quantile(quality(floating.points, floating.cells), 0.9))
    result, report = snap(floating, BALL, Snap(q_max=limit))
    before, after = quality(floating.points, floating.cells), quality(result.points, result.cells)
    assert after.max() <= before.max() and report.q_max_after == after.max()


def test_nodes_that_cannot_go_are_counted():
    """A single tetrahedron much larger than the surface it should lie on: it would be flattened."""
    plate = TriSurface([[-5, -5, 0], [5, -5, 0], [0, 5, 0], [0, 0, -9.0]], [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    tetrahedron = TetMesh([[-1, -1, 0.1], [1, -1, 0.1], [0, 1, 0.1], [0, 0, 1.0]], [[0, 1, 2, 3]])
    result, report = snap(tetrahedron, plate)
    assert report.nodes_left_off > 0 and "stay off the surface" in report.outcome
    assert signed_volumes(result.points, result.cells).min() > 0
