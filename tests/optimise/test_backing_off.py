"""Nodes go as far as their elements allow."""

import numpy as np
from cubes import cube_mesh

from cortet.geometry.topology import boundary_nodes
from cortet.measure.quality import quality, signed_volumes
from cortet.optimise.backing_off import back_off


def test_a_harmless_move_is_made_exactly():
    mesh = cube_mesh(3)
    target = mesh.points * 1.1 + np.pi
    points, share = back_off(mesh.points, target, mesh.cells)
    assert np.array_equal(points, target) and (share == 1).all()


def test_a_node_pushed_through_its_neighbours_stops_before_they_invert():
    mesh = cube_mesh(4)
    node = np.setdiff1d(np.arange(len(mesh.points)), boundary_nodes(mesh))[0]
    target = mesh.points.copy()
    target[node] += [0.6, 0.0, 0.0]  # spacing is 0.25
    assert signed_volumes(target, mesh.cells).min() < 0
    points, share = back_off(mesh.points, target, mesh.cells)
    assert signed_volumes(points, mesh.cells).min() > 0
    assert 0 < share[node] < 1 and np.array_equal(np.delete(points, node, 0), np.delete(mesh.points, node, 0))


def test_quality_stays_below_the_limit_or_no_worse_than_before():
    mesh = cube_mesh(4, jitter=0.2)
    target = mesh.points + np.random.default_rng(0).normal(0, 0.04, mesh.points.shape)
    limit = 0.5
    before = quality(mesh.points, mesh.cells)
    assert before.max() > limit  # some are bad to begin with and may not get worse
    points, _ = back_off(mesh.points, target, mesh.cells, q_max=limit)
    after = quality(points, mesh.cells)
    assert ((after < limit) | (after <= before)).all() and (points != mesh.points).any()
