"""The vertex optimiser: its calculus, its promises about the boundary, and what it reaches."""

import numba
import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh, ball_surface

from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise import vertices
from cortet.optimise.star import derivatives, empty_star, energy, newton_step, tangent_step
from cortet.optimise.vertices import FREE, Pass, move_vertices

SPHERE = ball_surface(2, 1.0)
TREE = surface_tree(SPHERE.points, SPHERE.faces)
PASSES = [Pass(0, 2, 4), Pass(0.5, 8, 10), Pass(0.3, 16, 10)]


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return ball_mesh()


def star_of(mesh: TetMesh, v: int):
    around = vertices._patches(mesh, np.full(len(mesh.points), FREE, np.int8), topology.boundary_faces(mesh))
    star = empty_star()
    return star, vertices._gather(mesh.points, around, v, star)


def interior_vertex(mesh: TetMesh) -> int:
    return int(np.setdiff1d(np.arange(len(mesh.points)), topology.boundary_nodes(mesh))[0])


@pytest.mark.parametrize("power", [2, 8, 32])
def test_energy_and_gradient_agree_with_the_definition_of_q(mesh, power):
    v = interior_vertex(mesh)
    star, size = star_of(mesh, v)
    mine = mesh.cells[(mesh.cells == v).any(axis=1)]

    def defined(offset):
        points = mesh.points.copy()
        points[v] += offset
        q = quality(points, mine)
        return ((1 - q) ** -power).sum()

    offset = np.array([0.01, -0.02, 0.005])
    assert energy(star, size, *offset, power // 2, np.inf) == pytest.approx(defined(offset), rel=1e-12)
    step = 1e-6
    differences = [(defined(step * e) - defined(-step * e)) / (2 * step) for e in np.eye(3)]
    energy(star, size, 0.0, 0.0, 0.0, power // 2, np.inf)
    assert derivatives(star, size, power // 2)[:3] == pytest.approx(differences, rel=1e-5)


def test_newton_steps_solve_the_system_in_space_and_in_the_plane():
    rng = np.random.default_rng(0)
    root, g = rng.normal(size=(3, 3)), rng.normal(size=3)
    hessian = root @ root.T + np.eye(3)
    flat = (*g, *hessian[np.triu_indices(3)])
    assert newton_step(flat) == pytest.approx(-np.linalg.solve(hessian, g))
    normal = np.array([0.36, 0.48, 0.8])
    basis = np.linalg.svd(normal[None])[2][1:].T
    expected = -basis @ np.linalg.solve(basis.T @ hessian @ basis, basis.T @ g)
    assert tangent_step(flat, *normal) == pytest.approx(expected)


def test_centre_of_an_icosahedron_returns_to_the_centre():
    shell = ball_surface(0, 1.0)
    off = np.array([[0.2, -0.3, 0.1]])
    cells = np.column_stack([shell.faces[:, [0, 2, 1]], np.full(20, 12)])
    start = TetMesh(np.vstack([shell.points, off]), cells)
    assert (signed_volumes(start.points, start.cells) > 0).all()
    tree = surface_tree(shell.points, shell.faces)
    moved, _ = move_vertices(start, tree, [Pass(0, 8, 30)], boundary="fixed")
    assert moved.points[12] == pytest.approx(np.zeros(3), abs=1e-3)
    assert np.array_equal(moved.points[:12], start.points[:12])


@pytest.mark.parametrize("boundary", ["slide", "fixed", "free"])
def test_worst_element_improves_and_no_volume_turns(mesh, boundary):
    moved, report = move_vertices(mesh, TREE, PASSES, boundary=boundary)
    q = quality(moved.points, moved.cells)
    assert (signed_volumes(moved.points, moved.cells) > 0).all()
    assert np.array_equal(moved.cells, mesh.cells)
    assert q.max() < quality(mesh.points, mesh.cells).max()
    assert (report[-1].q_mean, report[-1].q_max) == pytest.approx((q.mean(), q.max()), abs=1e-12)


def test_sliding_reaches_more_than_a_fixed_boundary_and_stays_on_the_surface(mesh):
    nodes = topology.boundary_nodes(mesh)
    slid, report = move_vertices(mesh, TREE, PASSES, boundary="slide", held=nodes[::7])
    fixed, report_fixed = move_vertices(mesh, TREE, PASSES, boundary="fixed")
    assert report[-1].q_max < report_fixed[-1].q_max
    assert np.abs(slid.points[nodes] - mesh.points[nodes]).max() > 0.01
    assert closest_points(TREE, slid.points[nodes]).distances.max() < 1e-12
    assert np.array_equal(fixed.points[nodes], mesh.points[nodes])
    assert np.array_equal(slid.points[nodes[::7]], mesh.points[nodes[::7]]), "held vertices stay"
    _, after = move_vertices(slid, TREE, [Pass(0, 2, 3, keep=0.3)], boundary="slide")
    assert after[-1].q_mean < report[-1].q_mean and after[-1].q_max <= report[-1].q_max + 1e-12, "the mean improves"


def test_threshold_leaves_good_elements_alone(mesh):
    q = quality(mesh.points, mesh.cells)
    moved, _ = move_vertices(mesh, TREE, [Pass(0.5, 8, 1)], boundary="slide")
    untouched = np.setdiff1d(np.arange(len(mesh.points)), mesh.cells[q > 0.5])
    assert np.array_equal(moved.points[untouched], mesh.points[untouched])


@pytest.mark.parametrize("boundary", ["free", "slide"])
def test_the_same_bits_for_any_number_of_threads(boundary):
    mesh = cube_mesh(16, jitter=0.2)
    surface, _ = topology.boundary_surface(mesh)
    tree, results = surface_tree(surface.points, surface.faces), []
    for threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(threads)
        results.append(move_vertices(mesh, tree, PASSES, boundary=boundary)[0].points)
    assert np.array_equal(*results) and not np.array_equal(results[0], mesh.points)


def test_a_vertex_on_a_sharp_crest_moves_along_it():
    crest = np.array([[-1, 0, -0.5], [1, 0, -0.5], [0, 0, 0], [0, 0.5, -1], [0, -0.5, -1.0]])
    tree = surface_tree(crest, np.array([[0, 2, 3], [2, 1, 3], [2, 0, 4], [1, 2, 4]], np.int32))
    start = np.concatenate([[0.3 * crest[2] + 0.7 * crest[1]], crest[[0, 1, 3, 4]]])
    mesh = TetMesh(start, np.array([[0, 2, 4, 3], [1, 0, 4, 3]], np.int32))
    assert (signed_volumes(mesh.points, mesh.cells) > 0).all()
    worst = []
    for crests in (False, True):
        made, _ = move_vertices(mesh, tree, [Pass(0, 8, 20, crests=crests)], boundary="slide", held=[1, 2, 3, 4])
        worst.append(quality(made.points, made.cells).max())
    assert worst[1] < 0.1 < 0.3 < worst[0], "a face of the other bank looks away from the surface below the vertex"
    assert closest_points(tree, made.points).distances.max() < 1e-12
