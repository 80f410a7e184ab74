"""Renumbering changes numbers only."""

import numpy as np
from shapes import ball_mesh

from cortet.geometry.ordering import ordered_along_curve
from cortet.measure.quality import quality, signed_volumes


def test_the_mesh_stays_the_same_and_neighbours_come_closer():
    mesh = ball_mesh(3)
    shuffled = np.random.default_rng(0).permutation(len(mesh.points))
    number = np.argsort(shuffled)
    points, cells, _ = ordered_along_curve(mesh.points[shuffled], number[mesh.cells].astype(np.int32))
    assert (signed_volumes(points, cells) > 0).all()
    assert np.array_equal(np.sort(quality(points, cells)), np.sort(quality(mesh.points, mesh.cells)))
    assert np.ptp(cells, axis=1).mean() < 0.6 * np.ptp(number[mesh.cells], axis=1).mean()
