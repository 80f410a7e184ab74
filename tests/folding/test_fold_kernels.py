"""The simulation obeys mechanics: exact stress, momentum, energy, contacts that hold, and steps that are stable."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh

from cortet.folding.body import Body, Material, Scale, body_of
from cortet.folding.contact import Contact, contact_forces, contact_of, listed_at, moved_too_far
from cortet.folding.growth import Course
from cortet.folding.kernels import (
    DONE,
    INVERTED,
    LIST_OUTDATED,
    Motion,
    Work,
    advance,
    elastic_forces,
    energies,
    nodal_forces,
    workspace,
)
from cortet.folding.law import exponential, inverse_cube_root
from cortet.folding.models import course, tangential
from cortet.folding.stability import FIRST, MARGIN, NEXT, largest_eigenvalue, largest_of_contacts, longest_step
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.intersection import self_intersections
from cortet.geometry.topology import TRI_EDGES, boundary_faces, boundary_nodes, face_normals, vertex_normals
from cortet.meshes import FloatArray, TetMesh, TriSurface

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


@pytest.mark.parametrize("bad", [0.0, np.nan])
def test_it_stops_at_an_inverted_element_and_moves_nothing(bad):
    mesh = cube_mesh(3)
    body, work = ungrown(mesh)
    state = at_rest(mesh)
    state.x[mesh.cells[7, 3]] = state.x[mesh.cells[7, :3]].mean(axis=0) + bad  # flat, or not a number
    x = state.x.copy()
    assert advance(body, MATERIAL, state, work, no_contact(mesh), steps(5), 1e-5) == (0, INVERTED)
    assert np.array_equal(state.x, x, equal_nan=True)


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


# --- contact


def two_blocks(gap: float, n: int = 4) -> TetMesh:
    """Two cubes of side 1, one above the other, shifted a little so that no nodes are in line."""
    low, high = cube_mesh(n), cube_mesh(n)
    shift = np.array([0.05, 0.08, 1 + gap])
    return TetMesh(np.vstack([low.points, high.points + shift]), np.vstack([low.cells, high.cells + len(low.points)]))


def contact(mesh: TetMesh, side: float = 0.0) -> Contact:
    return contact_of(mesh.points, boundary_faces(mesh), bulk=5.0, side=side)


def pairs(found: Contact) -> set[tuple[int, int]]:
    return {
        (int(node), int(face))
        for i, node in enumerate(found.nodes)
        for face in found.candidates[found.offsets[i] : found.offsets[i + 1]]
    }


def all_pairs(x: np.ndarray, faces: np.ndarray, radius: float) -> set[tuple[int, int]]:
    """Every node and triangle that face each other within the radius and share no neighbour, one by one."""
    normals, node_normals = face_normals(x, faces), vertex_normals(x, faces)
    ring: dict[int, set[int]] = {int(node): {int(node)} for node in np.unique(faces)}
    for a, b in faces[:, TRI_EDGES].reshape(-1, 2):
        ring[int(a)].add(int(b))
        ring[int(b)].add(int(a))
    nodes = np.unique(faces)
    found = set()
    for face, corners in enumerate(faces):
        triangle = surface_tree(x, corners[None])
        distances = closest_points(triangle, x[nodes]).distances
        for node in nodes[distances < radius]:
            facing = node_normals[node] @ normals[face] < 0
            if facing and not ring[int(node)] & set(corners.tolist()):
                found.add((int(node), face))
    return found


def blocks_askew() -> TriSurface:
    """The surface of two blocks, the upper one standing on an edge that all but touches the lower."""
    mesh = two_blocks(0.0, n=5)
    points = mesh.points.copy()
    turned = len(points) // 2
    angle = np.radians(40)
    y, z = points[turned:, 1] - 0.5, points[turned:, 2] - 1.0
    points[turned:, 1] = 0.5 + np.cos(angle) * y - np.sin(angle) * z
    points[turned:, 2] = 1.4 + np.sin(angle) * y + np.cos(angle) * z
    return TriSurface(points, boundary_faces(mesh))


@pytest.mark.parametrize("case", ["in parallel", "askew"])
def test_the_list_is_what_a_search_over_all_pairs_finds(case):
    parallel = two_blocks(0.05)
    surface = TriSurface(parallel.points, boundary_faces(parallel)) if case == "in parallel" else blocks_askew()
    found = contact_of(surface.points, surface.faces, bulk=5.0)
    expected = all_pairs(surface.points, surface.faces, found.radius)
    assert pairs(found) == expected
    assert len(expected) > 10
    x, margin = surface.points.copy(), found.radius - found.reach
    x[found.nodes[3], 1] += 0.49 * margin
    assert not moved_too_far(found, x)
    x[found.nodes[3], 1] += 0.02 * margin
    assert moved_too_far(found, x) and not moved_too_far(listed_at(found, x, 1.0), x)


def test_colliding_blocks_bounce_without_passing_through_each_other():
    mesh = two_blocks(0.1)
    material = Material(damping=0.0)
    (body, work), state, found = ungrown(mesh), at_rest(mesh), contact(mesh)
    upper = mesh.points[:, 2] > 1.01
    state.v[upper, 2] = -4.0
    elastic_forces(material, state.x, work, NO_GROWTH, 0.0)
    mass = (material.density * work.node_grown)[:, None]
    before = (mass * state.v).sum(axis=0)
    dt = longest_step(material, state.x, work, found, NO_GROWTH)[0] / 3  # they come fast
    touched, left = 0, 6000
    while left:
        done, how = advance(body, material, state, work, found, steps(min(left, 100)), dt)
        left -= done
        touched = max(touched, int(work.counts[1]))
        if how == LIST_OUTDATED:
            found = listed_at(found, state.x, 1.0)
        else:
            assert how == DONE
    assert touched > 10
    assert work.counts[1] == 0  # and apart again
    assert (mass * state.v).sum(axis=0) == pytest.approx(before, abs=1e-12)
    assert state.v[upper, 2].mean() > state.v[~upper, 2].mean() + 1.0
    assert len(self_intersections(TriSurface(state.x, boundary_faces(mesh)))) == 0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_medial_plane_holds_half_a_brain_on_its_side(side):
    mesh = ball_mesh(2)
    found, external = contact(mesh, side), np.zeros_like(mesh.points)
    contact_forces(found, mesh.points, external, 1.0)
    beyond = np.zeros(len(mesh.points), bool)
    beyond[boundary_nodes(mesh)] = True
    beyond &= side * mesh.points[:, 0] < 0
    assert (side * external[beyond, 0] > 0).all()
    assert not external[~beyond].any() and not external[:, 1:].any()
    soft, beside = np.zeros((2, *mesh.points.shape))
    faces = boundary_faces(mesh)
    contact_forces(contact_of(mesh.points, faces, bulk=5.0, side=side, plane=0.2), mesh.points, soft, 1.0)
    contact_forces(contact_of(mesh.points, faces, bulk=5.0, side=side, gap=1.0 + 1e-9), mesh.points, beside, 1.0)
    assert 10 * soft == pytest.approx(external) and not beside.any()


# --- the time step


def eigenvalues(material: Material, x: FloatArray, work: Work) -> FloatArray:
    """All of M^-1 K, from the forces of every displacement, one by one."""

    def forces(at: FloatArray) -> FloatArray:
        elastic_forces(material, at, work, NO_GROWTH, 0.0)
        return nodal_forces(work).ravel()

    h, ways = 1e-6, np.eye(x.size).reshape(-1, *x.shape)
    columns = [(forces(x - h * way) - forces(x + h * way)) / (2 * h) for way in ways]
    root = np.repeat(np.sqrt(material.density * work.node_grown), 3)
    matrix = np.array(columns) / root / root[:, None]
    return np.linalg.eigvalsh((matrix + matrix.T) / 2)


@pytest.mark.parametrize("flat", [1.0, 0.6])
def test_the_largest_eigenvalue_is_that_of_the_whole_matrix(flat):
    mesh, material = cube_mesh(2, jitter=0.2), Material()
    _, work = ungrown(mesh)
    x = mesh.points * [1, 1, flat]
    found, mode = largest_eigenvalue(material, x, work, NO_GROWTH)
    exact = eigenvalues(material, x, work)[-1]
    assert MARGIN**2 * exact < found <= exact * (1 + 1e-6)
    again, _ = largest_eigenvalue(material, x, work, NO_GROWTH, mode=mode)
    assert found * (1 - 1e-6) <= again <= exact * (1 + 1e-6)
    assert NEXT < FIRST


def test_steps_of_this_length_keep_the_energy_and_longer_ones_do_not():
    mesh, material = ball_mesh(2), Material(damping=0.0)
    body, work = ungrown(mesh)
    dt, _ = longest_step(material, mesh.points, work, no_contact(mesh), NO_GROWTH)

    def gain(dt: float) -> float:
        """Energy after 300 steps over that of a small motion in the beginning."""
        state = Motion(mesh.points.copy(), 1e-6 * np.random.default_rng(0).normal(size=mesh.points.shape))
        before = sum(energies(material, state, work, NO_GROWTH, 0.0))
        _, how = advance(body, material, state, work, no_contact(mesh), steps(300), dt)
        return sum(energies(material, state, work, NO_GROWTH, 0.0)) / before if how == DONE else np.inf

    assert gain(dt) < 5
    assert gain(dt / MARGIN * 1.1) > 1000


def pressed(n: int, depth: float, volumes: FloatArray | None) -> tuple[TetMesh, Contact]:
    """Two cubes, one pressed a little into the other, the upper one with cells of half the size."""
    low, high = cube_mesh(n), cube_mesh(2 * n)
    high = TetMesh(high.points + np.array([0.03, 0.05, 1.0]), high.cells)
    mesh = TetMesh(np.vstack([low.points, high.points]), np.vstack([low.cells, high.cells + len(low.points)]))
    found = contact_of(mesh.points, boundary_faces(mesh), bulk=5.0, volumes=volumes)
    x = mesh.points.copy()
    x[len(low.points) :, 2] -= depth * found.reach
    return TetMesh(x, mesh.cells), listed_at(found, x, 1.0)


@pytest.mark.parametrize("weighted", [False, True])
def test_contacts_have_no_larger_eigenvalue_than_is_estimated(weighted):
    mesh, _ = pressed(3, 0.0, None)
    (_, work), material = ungrown(mesh), Material()
    elastic_forces(material, mesh.points, work, NO_GROWTH, 0.0)
    volumes = work.node_grown.copy() if weighted else None
    mesh, contact = pressed(3, 0.2, volumes)
    x, h = mesh.points, 1e-7
    mass = material.density * work.node_grown

    def forces(at: FloatArray) -> FloatArray:
        external = np.zeros_like(at)
        assert contact_forces(contact, at, external, 1.0) > 0
        return external[:, 2].copy()

    nodes, columns = contact.nodes, []
    for node in nodes:  # contacts push along z here
        way = np.zeros_like(x)
        way[node, 2] = h
        columns.append((forces(x - way) - forces(x + way))[nodes] / (2 * h))
    root = np.sqrt(mass[nodes])
    exact = np.abs(np.linalg.eigvals(np.array(columns) / root / root[:, None])).max()
    estimate = largest_of_contacts(contact, material, work.node_grown)
    assert exact < estimate
    assert exact > 0.1 * estimate  # it is no idle one
