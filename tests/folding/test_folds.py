"""Width and depth of folds on surfaces whose folds are known."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import ball_surface

from cortet.folding.measurements import folds_of, mean_curvature, shape
from cortet.meshes import TriSurface

RADIUS = 30.0


def rippled(waves: int, height: float) -> tuple[TriSurface, np.ndarray]:
    """A sphere with so many meridional waves around its equator; only the equator's neighbourhood is cortex."""
    ball = ball_surface(5, radius=RADIUS)
    x, y, z = ball.points.T
    radius = 1 + height / RADIUS * np.cos(waves * np.arctan2(y, x)) * (1 - (z / RADIUS) ** 2)
    return TriSurface(ball.points * radius[:, None], ball.faces), (np.abs(z) < 5).astype(float)


@pytest.mark.parametrize(("waves", "height"), [(16, 0.05), (16, 0.2), (16, 1.5), (10, 1.5)])
def test_the_wavelength_and_spacing_of_known_waves_of_any_height(waves, height):
    """Those of 0.05 and 0.2 mm do not make the surface concave."""
    surface, cortex = rippled(waves, height)
    found = folds_of(surface.points, surface.faces, cortex)
    if waves == 16:
        assert found.wavelength == pytest.approx(2 * np.pi * RADIUS / waves, rel=0.15)
    assert found.spacing == (pytest.approx(2 * np.pi * RADIUS / waves, rel=0.15) if height > 1 else None)


def test_a_ball_is_curved_alike_everywhere_and_has_no_folds():
    ball = ball_surface(4, radius=RADIUS)
    everywhere = np.ones(len(ball.points))
    assert np.median(mean_curvature(ball.points, ball.faces)) == pytest.approx(1 / RADIUS, rel=1e-2)
    assert folds_of(ball.points, ball.faces, everywhere).spacing is None
    depth = shape(ball.points, ball.faces, everywhere == 0, np.nan)["sulcal_depth_mm"]
    assert depth == pytest.approx(0, abs=1e-9)


def test_the_spacing_of_a_rough_surface_does_not_jump_as_it_grows():
    """It is smoothed over 1.5 mm, which is some rounds over neighbours, and not a whole number of them."""
    surface, cortex = rippled(16, height=0.8)
    rough = surface.points * np.random.default_rng(0).normal(1, 0.002, (len(surface.points), 1))
    scales = np.linspace(0.9, 1.1, 21)
    relative = [(folds_of(scale * rough, surface.faces, cortex).spacing or 0) / scale for scale in scales]
    assert np.abs(np.diff(np.log(relative))).max() < 0.008


def test_the_depth_of_known_waves():
    surface, cortex = rippled(16, height=1.5)
    # the mean of 1.5 (1 - cos), less what the hull, straight from crest to crest, cuts off the sphere: spacing^2 / 12 R
    expected = 1.5 - (2 * np.pi * RADIUS / 16) ** 2 / (12 * RADIUS)
    depth = shape(surface.points, surface.faces, cortex == 0, np.nan)["sulcal_depth_mm"]
    assert depth == pytest.approx(expected, rel=0.1)
