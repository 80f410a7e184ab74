"""Distances of triangles that face each other across the outside of a surface."""

import numpy as np
import pytest
from shapes import ball_surface

from cortet.geometry.facing import facing
from cortet.meshes import TriSurface

#: a tetrahedron whose upper edge runs along x, triangles outward
ROOF = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, -1.0], [0, 1, -1.0]])
FACES = np.array([[0, 1, 3], [1, 0, 2], [0, 3, 2], [1, 2, 3]])


def roofs(gap: float, turn: float = 90.0) -> TriSurface:
    """Two roofs, the second upside down and turned, `gap` mm above the first."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = ROOF @ [[c, s, 0], [-s, c, 0], [0, 0, 1]] * [1, 1, -1] + [0, 0, gap]
    return TriSurface(np.concatenate([ROOF, turned]), np.concatenate([FACES, FACES[:, ::-1] + 4]).astype(np.int32))


@pytest.mark.parametrize("turn", [90.0, 30.0])
@pytest.mark.parametrize("gap", [1e-9, 0.2])
def test_edges_that_cross_over_each_other_are_as_far_apart_as_their_lines(gap, turn):
    found = facing(roofs(gap, turn), 0.5)
    nearest = found.distances.argmin()
    assert found.distances[nearest] == pytest.approx(gap, rel=1e-6)
    assert found.middles[nearest] == pytest.approx([0, 0, gap / 2], abs=1e-9)
    assert (nearest < 4) != (found.others[nearest] < 4)


def test_triangles_out_of_reach_and_the_inside_of_a_thin_plate_do_not_count():
    assert np.isinf(facing(roofs(0.2), 0.1).distances).all()
    ball = ball_surface(3, radius=5.0)
    plate = TriSurface(ball.points * [1, 1, 1e-3], ball.faces)
    assert np.isinf(facing(plate, 0.1).distances).all()
    inside_out = TriSurface(plate.points, plate.faces[:, ::-1].copy())
    assert facing(inside_out, 0.1).distances.min() < 0.01
