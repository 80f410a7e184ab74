"""The simulation obeys what mechanics says of it: exact stress, no stress from free growth, momentum, energy."""

from __future__ import annotations

from itertools import combinations

import numba
import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh

from cortet.folding.body import Body, Material, Scale, body_of
from cortet.folding.contact import Contact, contact_of
from cortet.folding.elements import OWN_ROWS, stress_elements
from cortet.folding.growth import Course
from cortet.folding.kernels import (
    DONE,
    INVERTED,
    Motion,
    Work,
    advance,
    elastic_forces,
    energies,
    nodal_forces,
    workspace,
)
from cortet.folding.law import exponential, growth_share, inverse_cube_root
from cortet.folding.models import course, tangential
from cortet.folding.patches import ROWS, SIZE
from cortet.folding.stability import longest_step
from cortet.geometry.topology import boundary_faces, boundary_nodes
from cortet.meshes import TetMesh

MATERIAL = Material()
#: coordinates of the test meshes are taken as dimensionless
UNIT = Scale(np.zeros(3), 1.0)
NO_GROWTH = tangential([0.0])


def at_rest(mesh: TetMesh) -> Motion:
    return Motion(mesh.points.copy(), np.zeros_like(mesh.points))


def no_contact(mesh: TetMesh) -> Contact:
    """A contact that never finds anything: what is tested here is the solid."""
    return contact_of(mesh.points, boundary_faces(mesh), bulk=0.0)._replace(radius=np.inf)


def ungrown(mesh: TetMesh) -> tuple[Body, Work]:
    """A body of which no part grows."""
    body = body_of(mesh, UNIT, mask=np.zeros(len(mesh.points)))
    return body, workspace(body)


def steps(n: int, alpha: float = 0.0) -> Course:
    """The course of n steps at constant growth."""
    return course(np.full((n, 1), alpha))


def forces(body: Body, work: Work, x: np.ndarray, alpha: float = 0.0) -> np.ndarray:
    elastic_forces(MATERIAL, x, work, tangential([alpha]), 0.0)
    return nodal_forces(work)


def first_piola(f: np.ndarray, mu: float, bulk: float) -> np.ndarray:
    """P of the model for a homogeneous deformation, by the book."""
    j, b = np.linalg.det(f), f @ f.T
    sigma = mu * j ** (-5 / 3) * (b - np.trace(b) / 3 * np.eye(3)) + bulk * (j - 1) * np.eye(3)
    return j * sigma @ np.linalg.inv(f).T


def test_an_affine_displacement_gives_the_exact_stress():
    mesh = cube_mesh(4, jitter=0.2)
    body, work = ungrown(mesh)
    f = np.array([[1.1, 0.2, 0.0], [0.05, 0.9, -0.1], [0.0, 0.15, 1.2]])
    result = forces(body, work, mesh.points @ f.T)
    inside = np.ones(len(mesh.points), bool)
    inside[boundary_nodes(mesh)] = False
    assert np.abs(result[inside]).max() < 1e-14
    side = mesh.points[:, 0] == 1
    expected = -first_piola(f, MATERIAL.mu_core, MATERIAL.bulk) @ [1, 0, 0]  # on the unit face x = 1
    edge = np.isin(mesh.points[:, 1:], [0, 1]).any(axis=1)
    # nodes at the rim also carry other faces: compare those within, whose faces cover (1 - 1/4)^2 and half a ring
    share = lumped_area(mesh, side & ~edge)
    assert result[side & ~edge].sum(axis=0) == pytest.approx(share * expected, rel=1e-12)


def lumped_area(mesh: TetMesh, nodes: np.ndarray) -> float:
    """A third of the faces x = 1 around each of some nodes."""
    faces = boundary_faces(mesh)
    faces = faces[(mesh.points[faces][:, :, 0] == 1).all(axis=1)]
    u, v = (mesh.points[faces[:, k]] - mesh.points[faces[:, 0]] for k in (1, 2))
    areas = np.linalg.norm(np.cross(u, v), axis=1) / 2
    return float((areas[:, None] / 3 * nodes[faces]).sum())


@pytest.mark.parametrize("growth", [(0.4, 0.0, 0.0), (0.4, -0.3, 0.1)])
def test_forces_are_the_gradient_of_the_energy(growth):
    mesh = ball_mesh(2)
    amount = np.linspace(0.2, 1.5, len(mesh.points))
    body = body_of(mesh, UNIT, thickness=0.3, amount=amount)
    body = body._replace(stiffness=np.linspace(0.1, 3.0, len(mesh.cells)))
    assert_forces_follow_from_energy(body, mesh.points * [1.1, 1.0, 0.9], growth)


@pytest.mark.parametrize("stretches", [(1.0, 1.1, 0.05), (1.0, 0.06, 0.05), (1.0, 0.9, 0.0), (1.1, 1.0, -0.05)])
def test_so_they_are_in_flat_and_inverted_elements(stretches):
    mesh = cube_mesh(1)
    body, _ = ungrown(mesh)
    x = mesh.points * stretches @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    assert_forces_follow_from_energy(body, x, (0.0, 0.0, 0.0))


def assert_forces_follow_from_energy(body: Body, x: np.ndarray, of_all: tuple[float, float, float]) -> None:
    """Compare the forces along a direction with the difference of the energy."""
    work, growth = workspace(body), np.array([of_all])
    direction = np.random.default_rng(1).normal(size=x.shape)
    elastic_forces(MATERIAL, x, work, growth, 0.0)
    analytic = -(nodal_forces(work) * direction).sum()

    def energy(at: float) -> float:
        return energies(MATERIAL, Motion(x + at * direction, np.zeros_like(x)), work, growth, 0.0)[1]

    h = 1e-6
    assert (energy(h) - energy(-h)) / (2 * h) == pytest.approx(analytic, rel=1e-7)


def test_a_free_body_that_grows_alike_everywhere_is_without_stress():
    mesh = ball_mesh(2)
    m = len(mesh.cells)
    body = body_of(mesh, UNIT)._replace(depth=np.full(m, -1e9), normals=np.zeros((m, 3)))  # g = 1, no direction
    work = workspace(body)
    assert np.abs(forces(body, work, 1.5 * mesh.points, 0.5)).max() < 1e-14
    energies(MATERIAL, at_rest(mesh), work, tangential([0.5]), 0.0)
    assert work.share == pytest.approx(1)
    assert np.abs(forces(body, work, mesh.points, 0.5)).max() > 1e-3  # held at its old size it is under stress


@pytest.mark.parametrize("cells", [4, 10])
def test_a_body_has_as_much_cortex_with_large_cells_as_with_small_ones(cells):
    """The cortex of a cube, 0.2 thick, fills 1 - 0.6^3 of it, whatever its cells are."""
    mesh = cube_mesh(cells, jitter=0.1)
    body = body_of(mesh, UNIT, thickness=0.2)
    share = [growth_share(*row, 1.0) for row in zip(body.depth, body.thickness, strict=True)]
    assert body.volumes @ share == pytest.approx(1 - 0.6**3, rel=0.03)


def test_growth_is_along_the_surface_and_near_it():
    mesh = ball_mesh(3)
    body = body_of(mesh, UNIT, thickness=0.2)
    work = workspace(body)
    energies(MATERIAL, at_rest(mesh), work, tangential([0.5]), 0.0)
    centroids = mesh.points[mesh.cells].mean(axis=1)
    radius = np.linalg.norm(centroids, axis=1)
    assert work.grown / body.volumes == pytest.approx((1 + 0.5 * work.share) ** 2)  # two directions of three
    assert work.share[radius > 0.95].min() > 0.9
    assert work.share[radius < 0.4].max() < 1e-3
    outward = (body.normals * centroids).sum(axis=1) / radius
    assert outward[radius > 0.8].min() > 0.8


def test_without_smoothing_elements_are_linear_tetrahedra():
    mesh = cube_mesh(3, jitter=0.2)
    x = mesh.points * [1.1, 1.0, 0.9] + 0.01 * np.sin(5 * mesh.points[:, ::-1])
    found = []
    for own, smoothed in ((1.0, False), (1.0, True), (0.5, True)):
        work = workspace(body_of(mesh, UNIT), smoothed=smoothed)
        elastic_forces(MATERIAL._replace(own=own), x, work, NO_GROWTH, 0.0)
        found.append(nodal_forces(work))
    assert found[0] == pytest.approx(found[1], abs=1e-15)
    assert np.abs(found[2] - found[0]).max() > 0.01 * np.abs(found[0]).max()


def test_momentum_is_conserved_without_contact_and_damping():
    mesh = ball_mesh(2)
    body = body_of(mesh, UNIT, thickness=0.3)
    work, state, material = workspace(body), at_rest(mesh), MATERIAL._replace(damping=0.0)
    state.v[:] = 0.1 * np.random.default_rng(0).normal(size=state.v.shape)
    elastic_forces(material, state.x, work, tangential([0.1]), 0.0)
    mass = material.density * work.node_grown[:, None]
    before = (mass * state.v).sum(axis=0), np.cross(state.x, mass * state.v).sum(axis=0)
    dt, _ = longest_step(material, state.x, work, no_contact(mesh), tangential([0.1]))
    short = dt / 64  # not until it springs back
    assert advance(body, material, state, work, no_contact(mesh), steps(200, 0.1), short) == (200, DONE)
    after = (mass * state.v).sum(axis=0), np.cross(state.x, mass * state.v).sum(axis=0)
    scale = float(np.abs(mass * state.v).sum())
    assert np.abs(np.subtract(before, after)).max() < 1e-13 * scale
    assert np.abs(state.x - mesh.points).max() > 1e-3  # it did move


def test_energy_decays_once_growth_has_stopped():
    mesh = ball_mesh(2)
    body, damped = body_of(mesh, UNIT, thickness=0.3), Material(damping=0.5)
    work, state = workspace(body), at_rest(mesh)
    dt = min(longest_step(damped, state.x, work, no_contact(mesh), tangential([0.3]))[0], 4e-4) / 8
    had = []
    for _ in range(10):  # grown at once: it springs
        had.append(sum(energies(MATERIAL, state, work, tangential([0.3]), 0.0)))
        assert advance(body, damped, state, work, no_contact(mesh), steps(200, 0.3), dt) == (200, DONE)
    assert np.all(np.diff(had) < 0)
    assert had[-1] < 0.7 * had[0]


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_it_stops_at_an_inverted_element_and_moves_nothing(bad):
    mesh = cube_mesh(3)
    body, work = ungrown(mesh)
    state = at_rest(mesh)
    state.x[mesh.cells[7, 3]] = state.x[mesh.cells[7, :3]].mean(axis=0) + bad  # flat, or not a number
    x = state.x.copy()
    assert advance(body, MATERIAL, state, work, no_contact(mesh), steps(5), 1e-5) == (0, INVERTED)
    assert np.array_equal(state.x, x, equal_nan=True)


def test_the_flatter_an_element_the_harder_it_is_pushed_open_and_nearly_flat_ones_are_counted():
    mesh = cube_mesh(1)
    body, work = ungrown(mesh)
    top, edges = mesh.points[:, 2] == 1, 19
    for stretch, degenerate in ((0.2, 0), (0.05, len(mesh.cells) + edges)):
        flat = Motion(mesh.points * [1, 1, stretch], np.zeros_like(mesh.points))
        work.counts[0] = 0
        assert advance(body, MATERIAL, flat, work, no_contact(mesh), steps(1), 1e-9) == (1, DONE)
        assert work.counts[0] == degenerate and work.min_j[0] == pytest.approx(min(stretch, 1))

    def push(stretch: float) -> float:
        elastic_forces(MATERIAL._replace(bulk=0.0), mesh.points * [1, 1, stretch], work, NO_GROWTH, 0.0)
        return float(nodal_forces(work)[top, 2].sum())

    assert push(0.1 - 1e-9) == pytest.approx(push(0.1 + 1e-9), rel=1e-6)
    pushes = [push(stretch) for stretch in (0.2, 0.1, 0.05, 0.0, -0.05)]
    assert np.all(np.diff(pushes) > 0)


def shear_stress(f: np.ndarray) -> np.ndarray:
    """Deviatoric P (m, 3, 3) for a modulus of 1, by the formula of the module `law`."""
    j, trace, inverse = np.linalg.det(f), (f**2).sum(axis=(1, 2)), np.linalg.inv(f).transpose(0, 2, 1)
    return np.asarray((j ** (-2 / 3))[:, None, None] * (f - (trace / 3)[:, None, None] * inverse))


def first_piola_of_elements(
    cells: np.ndarray, f: np.ndarray, mean: np.ndarray, mu: np.ndarray, volume: np.ndarray
) -> np.ndarray:
    """P of elements (m, 3, 3) that are not degenerate, by the formulas of the modules `law` and `smoothing`."""
    around: dict[tuple[int, ...], list[int]] = {}
    for number, corners in enumerate(cells.tolist()):
        for pair in combinations(sorted(corners), 2):
            around.setdefault(pair, []).append(number)
    of_edges, weight = np.zeros_like(f), mu * volume
    for elements in around.values():
        mean_f = np.average(f[elements], axis=0, weights=weight[elements])
        of_edges[elements] += shear_stress(mean_f[None]) / 6
    deviatoric = mu[:, None, None] * (MATERIAL.own * shear_stress(f) + (1 - MATERIAL.own) * of_edges)
    pressure = MATERIAL.bulk * (mean - 1) * np.linalg.det(f)
    return np.asarray(deviatoric + pressure[:, None, None] * np.linalg.inv(f).transpose(0, 2, 1))


@pytest.mark.parametrize("cells", [1, 6])
def test_the_compiled_loops_compute_what_the_formulas_say(cells):
    """On 6 elements of one patch, and on 1,296 of three: to rounding."""
    mesh = cube_mesh(cells, jitter=0.2)
    body = body_of(mesh, UNIT, thickness=0.3, amount=np.linspace(0.2, 1.5, len(mesh.points)))
    body = body._replace(stiffness=np.linspace(0.1, 3.0, len(mesh.cells)))
    work, (along, across, core) = workspace(body), (0.4, -0.3, 0.1)
    x = mesh.points * [1.1, 1.0, 0.9] + 0.01 * np.sin(5 * mesh.points[:, ::-1])
    elastic_forces(MATERIAL, x, work, np.array([[along, across, core]]), 0.0)
    found = nodal_forces(work)
    share = body.mask / (1 + np.exp(10 * (body.depth / body.thickness - 1)))
    tangential = (1 + share * body.amount * along + (1 - share) * core)[:, None, None]
    radial = (1 + share * across + (1 - share) * core)[:, None, None]
    out = body.normals[:, :, None] * body.normals[:, None]
    grown = tangential * (np.eye(3) - out) + radial * out
    gradients = body.gradients @ np.linalg.inv(grown)
    f = (x[mesh.cells[:, 1:]] - x[mesh.cells[:, :1]]).transpose(0, 2, 1) @ gradients
    volume = body.volumes * np.linalg.det(grown)
    nodal = [np.bincount(mesh.cells.ravel(), np.repeat(v, 4)) for v in (np.linalg.det(f) * volume, volume)]
    mu = MATERIAL.mu_core * body.stiffness * (1 - share) + MATERIAL.mu_cortex * share
    p = first_piola_of_elements(mesh.cells, f, (nodal[0] / nodal[1])[mesh.cells].mean(axis=1), mu, volume)
    on_corners = -volume[:, None, None] * (gradients @ p.transpose(0, 2, 1))
    expected = np.zeros_like(x)
    np.add.at(expected, mesh.cells[:, 1:], on_corners)
    np.add.at(expected, mesh.cells[:, 0], -on_corners.sum(axis=1))
    assert found == pytest.approx(expected, abs=1e-13 * np.abs(expected).max())
    assert work.ratio == pytest.approx(nodal[0] / nodal[1], rel=1e-13)
    assert work.block_min.min() == pytest.approx(np.linalg.det(f).min(), rel=1e-13)


def test_functions_without_calls_are_those_of_the_library():
    x = np.linspace(-250, 250, 10001)
    assert [exponential(value) for value in x] == pytest.approx(np.exp(x), rel=1e-15)
    assert exponential(1e9) > 1e130 and 0 < exponential(-1e9) < 1e-130
    j = np.logspace(-12, 6, 1001)
    assert [inverse_cube_root(value) for value in j] == pytest.approx(j ** (-1 / 3), rel=1e-15)


def test_the_loop_of_the_law_is_made_of_vector_instructions():
    """One call that is left in it would make it ten times slower, and nothing else would tell."""
    fresh = numba.njit(fastmath={"contract"}, error_model="numpy")(stress_elements.py_func)
    fresh(np.zeros(OWN_ROWS * SIZE), np.zeros(ROWS * SIZE), MATERIAL)
    (assembly,) = fresh.inspect_asm().values()
    scalar, packed = assembly.count("mulsd"), assembly.count("mulpd")
    assert packed > 20 and packed >= scalar  # what is scalar is the remainder of the loop
