"""Sets of grid points: a point that may join changes nothing about the topology of the surface around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.grid_topology import LINKS, STEPS, _hangs_together, as_ball
from cortet.geometry.label_surface import contour
from cortet.geometry.topology import components, surface_topology


def surface_around(inside: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Triangles of all components."""
    return contour(np.pad(np.where(inside, 0.5, -0.5), 1, constant_values=-0.5))[1]


def may_join(inside: NDArray[np.bool_]) -> bool:
    """Whether the middle of (3, 3, 3) points may join those that are inside."""
    bits = sum(1 << k for k, step in enumerate(STEPS) if inside[tuple(1 + step)])
    (own, other), everything = LINKS, (1 << len(STEPS)) - 1
    return bool(_hangs_together(bits, *own) and _hangs_together(everything & ~bits, *other))


def test_a_point_that_may_join_changes_no_topology():
    """Components and Euler number of the surface around the points, with the middle one and without."""
    random, joining = np.random.default_rng(0), 0
    for share in (0.2, 0.35, 0.5, 0.65, 0.8):
        for _ in range(60):
            inside = random.random((3, 3, 3)) < share
            inside[0, 0, 0] = True
            found = []
            for inside[1, 1, 1] in (False, True):
                faces = surface_around(inside)
                found.append((components(faces), surface_topology(faces).euler_number))
            assert not may_join(inside) or found[0] == found[1]
            joining += may_join(inside)
    assert joining > 50


def test_noise_becomes_a_ball():
    random = np.random.default_rng(1)
    x, y, z = np.indices((24, 24, 24)) - 11.5
    depth = 8 - np.sqrt(x**2 + y**2 + z**2) + random.normal(0, 1.5, (24, 24, 24))
    depth[[0, -1]] = depth[:, [0, -1]] = depth[:, :, [0, -1]] = -1
    assert surface_topology(surface_around(depth > 0)).euler_number != 2
    ball = as_ball(depth)
    assert surface_topology(surface_around(ball)).problems(genus=0) == []
    assert 0 < (ball != (depth > 0)).sum() < 0.2 * (depth > 0).sum()
