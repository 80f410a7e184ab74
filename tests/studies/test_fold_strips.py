"""A growing film on a softer base wrinkles as theory says: longer when it is thicker, and when it is stiffer."""

from __future__ import annotations

import fold_theory
import numpy as np
import pytest
from fold_strips import Wrinkles, critical_growth, material_of, strip, wrinkle

pytestmark = pytest.mark.thorough

LENGTH, DEPTH, SPACING = 40.0, 20.0, 1.0


def wrinkles(thickness: float, stiffness: float) -> Wrinkles:
    return wrinkle(strip(LENGTH, DEPTH, thickness, SPACING), thickness, material_of(stiffness))


def test_waves_are_longer_in_a_thicker_and_in_a_stiffer_film():
    plain, thick, stiff = (wrinkles(thickness, stiffness) for thickness, stiffness in ((1, 8), (2, 8), (1, 32)))
    assert thick.wavelength / plain.wavelength == pytest.approx(2, rel=0.3)
    assert stiff.wavelength / plain.wavelength == pytest.approx(4 ** (1 / 3), rel=0.3)
    assert stiff.growth < 0.7 * plain.growth  # and they come earlier


def test_growth_across_a_film_delays_a_wave_as_exact_theory_says():
    # a film that has become thinner, and one that has become thicker, take another wave than this one first
    wavelength, thickness, material = 12.0, 2.0, material_of(2.0)

    def measured_over_exact(across: float) -> float:
        exact = fold_theory.critical_growth(
            2 * np.pi / wavelength, thickness, material, fold_theory.smooth_profile, across=across
        )
        return critical_growth(wavelength, SPACING, thickness, material, exact, across) / exact

    plain = measured_over_exact(0.0)
    assert plain == pytest.approx(1.1, abs=0.1)  # coarse elements delay it
    for across in (-0.4, 0.5):
        assert measured_over_exact(across) == pytest.approx(plain, rel=0.03)
