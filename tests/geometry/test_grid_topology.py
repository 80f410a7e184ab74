"""Sets of grid points: a point that may join changes nothing about the topology of the surface around them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from cortet.geometry.grid_topology import CUBES, TETRAHEDRA, Grid, _hangs_together, as_ball, skin
from cortet.geometry.label_surface import contour
from cortet.geometry.topology import component_labels, surface_topology


def surface_around(inside: NDArray[np.bool_], grid: Grid) -> NDArray[np.int32]:
    """Triangles of all components."""
    depth = np.pad(np.where(inside, 0.5, -0.5), 1, constant_values=-0.5)
    if grid is TETRAHEDRA:
        return skin(depth)[1]
    return contour(depth)[1]


def may_join(inside: NDArray[np.bool_], grid: Grid) -> bool:
    """Whether the middle of (3, 3, 3) points may join those that are inside."""
    bits = sum(1 << k for k, step in enumerate(grid.steps) if inside[tuple(1 + step)])
    (own, other), everything = zip(grid.joined, grid.near, strict=True), (1 << len(grid.steps)) - 1
    return bool(_hangs_together(bits, *own) and _hangs_together(everything & ~bits, *other))


@pytest.mark.parametrize("grid", [CUBES, TETRAHEDRA], ids=["cubes", "tetrahedra"])
def test_a_point_that_may_join_changes_no_topology(grid):
    """Components and Euler number of the surface around the points, with the middle one and without."""
    random, joining = np.random.default_rng(0), 0
    for share in (0.2, 0.35, 0.5, 0.65, 0.8):
        for _ in range(60):
            inside = random.random((3, 3, 3)) < share
            inside[0, 0, 0] = True
            found = []
            for inside[1, 1, 1] in (False, True):
                faces = surface_around(inside, grid)
                found.append(
                    (len(np.unique(component_labels(faces)[faces[:, 0]])), surface_topology(faces).euler_number)
                )
            assert not may_join(inside, grid) or found[0] == found[1]
            joining += may_join(inside, grid)
    assert joining > 50


@pytest.mark.parametrize("grid", [CUBES, TETRAHEDRA], ids=["cubes", "tetrahedra"])
def test_noise_becomes_a_ball(grid):
    random = np.random.default_rng(1)
    x, y, z = np.indices((24, 24, 24)) - 11.5
    depth = 8 - np.sqrt(x**2 + y**2 + z**2) + random.normal(0, 1.5, (24, 24, 24))
    depth[[0, -1]] = depth[:, [0, -1]] = depth[:, :, [0, -1]] = -1
    assert surface_topology(surface_around(depth > 0, grid)).euler_number != 2
    ball = as_ball(depth, 1.0, grid)
    assert surface_topology(surface_around(ball > 0, grid)).problems(genus=0) == []
    changed = (ball > 0) != (depth > 0)
    assert 0 < changed.sum() < 0.2 * (depth > 0).sum()
    assert np.array_equal(ball[~changed], depth[~changed])
