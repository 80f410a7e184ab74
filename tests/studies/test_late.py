"""Folds by week: bands of curvature against harmonics of a sphere, basins that were dug, and truth without newborns."""

from __future__ import annotations

import numpy as np
import pytest
from late import QUANTITIES, measured
from scipy.special import sph_harm_y
from shapes import ball_surface
from spectrum import BANDS, band_powers

from cortet.folding.fold_views import brain_of
from cortet.geometry.spheres import vertex_areas

BALL = ball_surface(4, radius=20.0)


def harmonic(degree: int) -> np.ndarray:
    x, y, z = (BALL.points / np.linalg.norm(BALL.points, axis=1, keepdims=True)).T
    return np.real(sph_harm_y(degree, 1, np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)))


@pytest.mark.parametrize(("degree", "band"), [(1, 1), (2, 1), (3, 2), (4, 2), (6, 3), (8, 3), (12, 4), (20, 4)])
def test_a_harmonic_of_a_sphere_is_in_the_band_of_its_frequency(degree, band):
    """The eigenvalue of degree l is l (l + 1) / r2, the lowest one 2 / r2, and a band spans a factor of four."""
    values = harmonic(degree)
    powers, longest = band_powers(BALL, values)
    assert longest == pytest.approx(2 * np.pi * 20 / np.sqrt(2), rel=0.01)
    assert int(powers.argmax()) + 1 == band and len(powers) == BANDS
    assert powers[band - 1] == pytest.approx((vertex_areas(BALL) * values**2).sum(), rel=0.01)


def test_a_surface_is_measured_without_its_medial_wall():
    whole = measured(brain_of(BALL, np.zeros(len(BALL.points), bool)))
    assert set(whole) == set(QUANTITIES)
    assert whole["gyrification_index"] == pytest.approx(1, abs=0.01) and whole["basins"] == 0
