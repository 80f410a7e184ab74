"""Crossing triangles, pair by pair and on whole surfaces."""

import numpy as np
import pytest
from shapes import ball_surface

from cortet.intersection import self_intersections
from cortet.mesh import TriSurface

FLAT = [[0, 0, 0], [2, 0, 0], [0, 2, 0]]


@pytest.mark.parametrize(
    ("points", "faces", "crossing"),
    [
        ([*FLAT, [0.5, 0.5, -1], [0.5, 0.5, 1], [3, 3, 1]], [[0, 1, 2], [3, 4, 5]], True),  # an edge through the inside
        ([*FLAT, [0.5, 0.5, 1], [0.5, 0.5, 2], [3, 3, 1]], [[0, 1, 2], [3, 4, 5]], False),  # above
        ([*FLAT, [1, 1, 1], [0.6, 0.6, -1]], [[0, 1, 2], [0, 3, 4]], True),  # one common vertex, passing through
        ([*FLAT, [1, 1, 1], [-1, -1, -1]], [[0, 1, 2], [0, 3, 4]], False),  # one common vertex, touching only there
        ([*FLAT, [0.5, 0.5, 0]], [[0, 1, 2], [1, 0, 3]], True),  # common edge, folded flat
        ([*FLAT, [0.5, 0.5, 1e-6]], [[0, 1, 2], [1, 0, 3]], False),  # common edge, nearly
        ([*FLAT, [0, -1, 0]], [[0, 1, 2], [1, 0, 3]], False),  # common edge, side by side
        ([*FLAT], [[0, 1, 2], [0, 2, 1]], True),  # the same triangle twice
    ],
)
def test_pairs(points, faces, crossing):
    assert self_intersections(TriSurface(points, faces)).tolist() == ([0, 1] if crossing else [])


def test_a_sphere_does_not_cross_itself_and_two_that_overlap_do_along_a_ring():
    sphere = ball_surface(3, 1.0)
    assert len(self_intersections(sphere)) == 0
    shift = np.array([0.9, 0.13, 0.07])
    both = TriSurface(np.vstack([sphere.points, sphere.points + shift]), np.vstack([sphere.faces, sphere.faces + 642]))
    found = self_intersections(both)
    centres = both.points[both.faces[found]].mean(axis=1)
    # the ring lies in the plane half-way between the centres
    off = (centres - shift / 2) @ shift / np.linalg.norm(shift)
    assert len(found) > 80 and np.abs(off).max() < 0.1
    assert (found < len(sphere.faces)).any() and (found >= len(sphere.faces)).any()


def test_a_vertex_pushed_through_the_far_side_is_found():
    sphere = ball_surface(2, 1.0)
    points = sphere.points.copy()
    points[0] *= -1.2
    found = self_intersections(TriSurface(points, sphere.faces))
    assert (sphere.faces[found] == 0).any() and len(found) > 3
