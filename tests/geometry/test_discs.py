"""Loads of the vertices of a surface below a disc."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import ball_surface

from cortet.formats.gifti import read_surface
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.discs import Disc, circle_integrals, disc
from cortet.meshes import FloatArray, TriSurface
from cortet.phantoms import phantom

ADULT = Path(__file__).parents[3] / "shared/data/pairs/adult_fsaverage5_lh_pial.surf.gii"


def around(surface: TriSurface, point: FloatArray, radius: float) -> Disc:
    found = closest_points(tree_of(surface), np.asarray(point, float)[None])
    return disc(surface, int(found.faces[0]), found.barycentric[0], radius)


def plane(spacing: float) -> TriSurface:
    """A square of 10 mm whose faces look up, with irregular vertices."""
    x = np.arange(-5, 5 + spacing / 2, spacing)
    n = len(x)
    points = np.stack([*np.meshgrid(x, x), np.zeros((n, n))], axis=2).reshape(-1, 3)
    points[:, :2] += np.random.default_rng(0).uniform(-0.2, 0.2, (n * n, 2)) * spacing
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, n], corner[:, None] + [1, n + 1, n]])
    return TriSurface(points, faces)


@pytest.mark.parametrize("spacing", [0.1, 1.0, 8.0])
def test_a_disc_on_a_plane_has_its_area_and_its_centre_across_many_faces_or_inside_one(spacing):
    square, centre = plane(spacing), np.array([0.31, -0.27, 0.0])
    found = around(square, centre, 1.15)
    assert found.area == pytest.approx(np.pi * 1.15**2, rel=1e-12)
    assert found.loads.sum() == pytest.approx(1, abs=1e-12)
    assert found.loads.min() >= 0
    assert found.loads @ square.points[found.vertices] == pytest.approx(centre, abs=1e-12)
    assert (len(found.faces) == 1) == (spacing == 8.0)


def test_loads_are_the_integrals_of_the_hat_functions():
    """Compared with sums over a fine grid of points."""
    square, centre, radius = plane(1.0), np.array([0.31, -0.27, 0.0]), 1.7
    found = around(square, centre, radius)
    x = (np.arange(-600, 600) + 0.5) * radius / 600
    grid = np.stack([*np.meshgrid(x, x), np.zeros((1200, 1200))], axis=2).reshape(-1, 3)
    grid = centre + grid[np.linalg.norm(grid, axis=1) < radius]
    nearest = closest_points(tree_of(square), grid)
    summed = np.bincount(square.faces[nearest.faces].ravel(), nearest.barycentric.ravel(), len(square.points))
    assert found.loads == pytest.approx(summed[found.vertices] / len(grid), abs=2e-5)


def test_a_circle_inside_around_or_beside_a_triangle():
    corners = np.array([[[0, 0], [3, 0], [0, 3]], [[-9, -9], [9, -9], [0, 9]], [[5, 5], [6, 5], [5, 6]]], float)
    area, moment = circle_integrals(corners, 2.0)
    assert area == pytest.approx([np.pi, 4 * np.pi, 0.0], abs=1e-12)  # a side at 2.12 mm, none
    assert moment[0] == pytest.approx([8 / 3, 8 / 3], rel=1e-12)
    assert moment[1:] == pytest.approx(np.zeros((2, 2)), abs=1e-12)
    whole, _ = circle_integrals(corners, 20.0)
    assert whole == pytest.approx([4.5, 162.0, 0.5], rel=1e-12)


def test_loads_turn_with_the_surface():
    ball, turn = ball_surface(4, radius=20.0), Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    turned = TriSurface(ball.points @ turn.T, ball.faces)
    there = np.array([3.0, 11.0, 16.5])
    one, other = around(ball, there, 2.5), around(turned, turn @ there, 2.5)
    assert np.array_equal(one.vertices, other.vertices)
    assert one.loads == pytest.approx(other.loads, abs=1e-12)
    assert one.area == pytest.approx(other.area, rel=1e-12)


def test_the_area_is_that_of_the_cap_of_a_ball():
    found = around(ball_surface(6, radius=20.0), np.array([0.0, 0.0, 20.0]), 5.0)
    height = 20 - np.sqrt(20**2 - 5**2)
    assert found.area == pytest.approx(2 * np.pi * 20 * height, rel=1e-3)


def test_the_far_side_of_a_thin_sheet_does_not_belong_to_the_disc():
    ball = ball_surface(5, radius=10.0)
    flat = TriSurface(ball.points * [1, 1, 0.05], ball.faces)
    found = around(flat, np.array([0.0, 0.0, 1.0]), 2.0)
    assert flat.points[found.vertices, 2].min() > 0
    assert found.area == pytest.approx(np.pi * 4, rel=1e-3)


@pytest.mark.parametrize("real", [False, True])
def test_loads_of_a_thousand_discs_on_a_cortex_sum_to_one(real):
    if real and not ADULT.exists():
        pytest.skip("needs ../shared/data")
    cortex = read_surface(ADULT) if real else phantom(28, subdivisions=5)
    random = np.random.default_rng(0)
    points = cortex.points[random.integers(len(cortex.points), size=1000)] + random.normal(0, 0.5, (1000, 3))
    nearest = closest_points(tree_of(cortex), points)
    for face, weights, radius in zip(nearest.faces, nearest.barycentric, random.uniform(0.2, 6, 1000), strict=True):
        found = disc(cortex, int(face), weights, radius)
        assert abs(found.loads.sum() - 1) < 1e-12
        assert found.loads.min() > -1e-12
        assert 0 < found.area <= 2 * np.pi * radius**2
        assert face in found.faces
