"""The time step is that of the largest eigenvalue, of the body as measured and of its contacts as estimated."""

from __future__ import annotations

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_mesh

from cortet.folding.body import Body, Material, Scale, body_of
from cortet.folding.contact import Contact, contact_forces, contact_of, listed_at
from cortet.folding.kernels import DONE, Motion, Work, advance, elastic_forces, energies, nodal_forces, workspace
from cortet.folding.models import course, tangential
from cortet.folding.stability import FIRST, MARGIN, NEXT, largest_eigenvalue, largest_of_contacts, longest_step
from cortet.geometry.topology import boundary_faces
from cortet.meshes import FloatArray, TetMesh

UNIT = Scale(np.zeros(3), 1.0)
NOTHING = tangential([0.0])


def body_and_work(mesh: TetMesh) -> tuple[Body, Work]:
    body = body_of(mesh, UNIT, mask=np.zeros(len(mesh.points)))
    return body, workspace(body)


def eigenvalues(material: Material, x: FloatArray, work: Work) -> FloatArray:
    """All of M^-1 K, from the forces of every displacement, one by one."""

    def forces(at: FloatArray) -> FloatArray:
        elastic_forces(material, at, work, NOTHING, 0.0)
        return nodal_forces(work).ravel()

    h, ways = 1e-6, np.eye(x.size).reshape(-1, *x.shape)
    columns = [(forces(x - h * way) - forces(x + h * way)) / (2 * h) for way in ways]
    root = np.repeat(np.sqrt(material.density * work.node_grown), 3)
    matrix = np.array(columns) / root / root[:, None]
    return np.linalg.eigvalsh((matrix + matrix.T) / 2)


@pytest.mark.parametrize("flat", [1.0, 0.6])
def test_the_largest_eigenvalue_is_that_of_the_whole_matrix(flat):
    mesh, material = cube_mesh(2, jitter=0.2), Material()
    _, work = body_and_work(mesh)
    x = mesh.points * [1, 1, flat]
    found, mode = largest_eigenvalue(material, x, work, NOTHING)
    exact = eigenvalues(material, x, work)[-1]
    assert MARGIN**2 * exact < found <= exact * (1 + 1e-6)
    again, _ = largest_eigenvalue(material, x, work, NOTHING, mode=mode)
    assert found * (1 - 1e-6) <= again <= exact * (1 + 1e-6)
    assert NEXT < FIRST


def test_steps_of_this_length_keep_the_energy_and_longer_ones_do_not():
    mesh, material = ball_mesh(2), Material(damping=0.0)
    body, work = body_and_work(mesh)
    nothing_touches = contact_of(mesh.points, boundary_faces(mesh), bulk=0.0)._replace(radius=np.inf)
    dt, _ = longest_step(material, mesh.points, work, nothing_touches, NOTHING)

    def gain(dt: float) -> float:
        """Energy after 300 steps over that of a small motion in the beginning."""
        state = Motion(mesh.points.copy(), 1e-6 * np.random.default_rng(0).normal(size=mesh.points.shape))
        before = sum(energies(material, state, work, NOTHING, 0.0))
        _, how = advance(body, material, state, work, nothing_touches, course(np.zeros((300, 1))), dt)
        return sum(energies(material, state, work, NOTHING, 0.0)) / before if how == DONE else np.inf

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
    (_, work), material = body_and_work(mesh), Material()
    elastic_forces(material, mesh.points, work, NOTHING, 0.0)
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
