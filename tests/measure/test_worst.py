"""The worst elements are found, placed and explained by the edges that hold them."""

from __future__ import annotations

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.geometry.topology import boundary_faces, boundary_nodes, edges
from cortet.measure.quality import opening_bound, quality
from cortet.measure.worst import fans, valence_bound, worst_elements
from cortet.meshes import TetMesh


def around_an_edge(count: int, radius: float = 1.0, height: float = 1.0) -> TetMesh:
    """`count` tetrahedra around one interior edge, the z axis, from -height / 2 to height / 2."""
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)], axis=1)
    k = np.arange(count)
    bottom, top = np.full(count, count), np.full(count, count + 1)
    points = np.concatenate([ring, [[0, 0, -height / 2], [0, 0, height / 2]]])
    return TetMesh(points, np.stack([bottom, k, (k + 1) % count, top], axis=1))


@pytest.mark.parametrize("count", [3, 4, 10])
def test_tetrahedra_around_an_edge_reach_the_bound_and_cannot_pass_it(count):
    bound = valence_bound(fans(around_an_edge(count)))
    assert bound.interior_q == pytest.approx(opening_bound(360 / count), abs=5e-4)
    assert bound.interior_edges_of_valence_3 == (count == 3)
    meshes = (around_an_edge(count, height=height) for height in np.linspace(0.3, 3, 200))
    best = min(quality(mesh.points, mesh.cells).max() for mesh in meshes)
    assert best == pytest.approx(bound.interior_q, abs=1e-4)


def test_a_boundary_edge_in_one_tetrahedron_is_bounded_by_its_opening_angle():
    theta = np.radians(140)
    mesh = TetMesh([[0, 0, -0.5], [1, 0, 0], [np.cos(theta), np.sin(theta), 0], [0, 0, 0.5]], [[0, 1, 2, 3]])
    around = fans(mesh)
    assert np.max(around.opening) == pytest.approx(140)
    bound = valence_bound(around)
    assert bound.boundary_q == pytest.approx(0.517, abs=5e-4)
    assert bound.boundary_edges_of_valence_1 == 6
    assert quality(mesh.points, mesh.cells)[0] >= bound.q


def test_opening_angles_of_a_cube_are_right_angles_at_its_edges_and_straight_on_its_faces():
    around = fans(cube_mesh(3))
    opening = np.round(around.opening[around.on_boundary])
    assert set(opening) == {90.0, 180.0}
    assert (opening == 90).sum() == 12 * 3


def test_nothing_depends_on_the_numbering_and_no_mesh_is_better_than_its_bound():
    mesh = cube_mesh(4, jitter=0.25)
    inner = np.setdiff1d(np.arange(len(mesh.points)), boundary_nodes(mesh))
    order = np.concatenate([boundary_nodes(mesh), inner])  # surface nodes first, as solvers want them
    renumbered = TetMesh(mesh.points[order], np.argsort(order)[mesh.cells])
    around = fans(renumbered)
    assert around.on_boundary.sum() == len(edges(boundary_faces(mesh)))
    assert valence_bound(around).interior_q == valence_bound(fans(mesh)).interior_q
    assert valence_bound(around).q <= quality(mesh.points, mesh.cells).max()


def test_a_fan_of_three_is_named_with_its_place_and_reconnection_recommended_unless_it_was_tried():
    mesh = around_an_edge(3, height=1.4)
    around, q = fans(mesh), quality(mesh.points, mesh.cells)
    first, second = worst_elements(mesh, around, count=2)
    assert [first.q, second.q] == sorted(q, reverse=True)[:2] and first.boundary_nodes == 4
    assert np.allclose(first.centre_mm, mesh.points[mesh.cells[first.element]].mean(axis=0))
    assert "0.300" in first.reason
    assert "reconnect" in worst_elements(mesh, around)[0].remedy
    assert not worst_elements(mesh, around, limit=0.9)[0].remedy
    assert "reconnect" not in worst_elements(mesh, around, stages=["clean", "reconnect"])[0].remedy


def test_a_sliver_inside_is_held_by_nothing_and_cleaning_recommended():
    mesh = cube_mesh(4, jitter=0.3)
    worst = worst_elements(mesh, fans(mesh))[0]
    assert worst.bound < worst.q / 2
    assert "moving vertices" in worst.reason
    assert "clean" in worst.remedy


def test_a_thin_blade_is_recognised_by_its_banks():
    cube = cube_mesh(6, side=6.0)
    layer = (cube.points[cube.cells][:, :, 2] <= 1).all(axis=1)  # one cell thick, its diagonals join the two banks
    nodes = np.unique(cube.cells[layer])
    blade = TetMesh(cube.points[nodes] * [1, 1, 0.1], np.searchsorted(nodes, cube.cells[layer]))
    reasons = [element.reason for element in worst_elements(blade, fans(blade), count=len(blade.cells))]
    assert any("1.00 mm apart" in reason for reason in reasons)
