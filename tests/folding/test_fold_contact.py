"""Contact: the list misses nothing, bodies in contact push each other apart, and nothing passes through."""

from __future__ import annotations

import numpy as np
import pytest
from cubes import cube_mesh
from scipy.spatial import ConvexHull
from shapes import ball_mesh

from cortet.folding.body import Material, Scale, body_of
from cortet.folding.contact import Contact, contact_forces, contact_of, listed_at, moved_too_far, planes_of
from cortet.folding.kernels import DONE, LIST_OUTDATED, Motion, advance, elastic_forces, workspace
from cortet.folding.models import course, tangential
from cortet.folding.stability import longest_step
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.intersection import self_intersections
from cortet.geometry.topology import TRI_EDGES, boundary_faces, boundary_nodes, face_normals, vertex_normals
from cortet.meshes import TetMesh, TriSurface


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


def test_an_undeformed_body_is_not_in_contact_with_itself():
    for mesh in (ball_mesh(3), cube_mesh(4)):
        found = contact(mesh)
        assert contact_forces(found, mesh.points, np.zeros_like(mesh.points), 1.0) == 0


def test_the_force_grows_as_the_gap_closes_and_past_it():
    pushes = []
    for gap in (0.3, 0.15, 0.05, 0.01, -0.02):
        mesh = two_blocks(0.05)
        found = contact(mesh)
        x = mesh.points.copy()
        upper = x[:, 2] > 1.02
        x[upper, 2] += gap * found.reach / 0.2 - 0.05
        found = listed_at(found, x, 1.0)
        external = np.zeros_like(x)
        contact_forces(found, x, external, 1.0)
        assert np.abs(external.sum(axis=0)).max() < 1e-12  # what pushes is pushed
        assert np.abs(external[upper, :2]).max(initial=0) < 0.1 * max(external[upper, 2].max(), 1e-9)
        pushes.append(external[upper, 2].sum())
    assert pushes[0] == 0
    assert np.all(np.diff(pushes[1:]) > 0)


def test_colliding_blocks_bounce_without_passing_through_each_other():
    mesh = two_blocks(0.1)
    material = Material(damping=0.0)
    body = body_of(mesh, Scale(np.zeros(3), 1.0), mask=np.zeros(len(mesh.points)))
    work, state, found = workspace(body), Motion(mesh.points.copy(), np.zeros_like(mesh.points)), contact(mesh)
    upper = mesh.points[:, 2] > 1.01
    state.v[upper, 2] = -4.0
    elastic_forces(material, state.x, work, tangential([0.0]), 0.0)
    mass = (material.density * work.node_grown)[:, None]
    before = (mass * state.v).sum(axis=0)
    dt = longest_step(material, state.x, work, found, tangential([0.0]))[0] / 3  # they come fast
    touched, left = 0, 6000
    while left:
        done, how = advance(body, material, state, work, found, course(np.zeros((min(left, 100), 1))), dt)
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


def test_an_envelope_pushes_back_what_is_beyond_it_along_its_normal():
    mesh = two_blocks(0.5)
    x = mesh.points
    found = contact_of(x, boundary_faces(mesh), bulk=5.0, planes=planes_of(ConvexHull(x)))
    external = np.zeros_like(x)
    contact_forces(found, x, external, 1.0)
    assert np.abs(external).max() < 1e-12  # nothing is beyond the hull
    contact_forces(found, x, external, 1.1)
    assert np.abs(external).max() < 1e-12
    top = np.isclose(x[:, 2], x[:, 2].max())
    found = listed_at(found, x, 0.9)
    contact_forces(found, x, external, 0.9)
    middle = top & (np.abs(x[:, :2] - x[top, :2].mean(axis=0)).max(axis=1) < 0.3)
    assert external[middle, 2] == pytest.approx(-found.softness * 0.1 * x[:, 2].max())
    assert np.abs(external[middle, :2]).max() < 1e-12
