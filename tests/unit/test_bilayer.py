"""Exact onset of the folds of a growing layer: Biot's half-space, Allen's stiff film, and what is between them."""

from __future__ import annotations

import numpy as np
import pytest
from bilayer import Onset, critical_growth, is_stable, normal_stretch, onset, sharp_profile, smooth_profile
from fold_wrinkles import theory

from cortet.meshes import FloatArray
from cortet.simulation.body import Material


def layer(stiffness: float) -> Onset:
    return onset(Material(mu_core=1 / stiffness), sharp_profile)


def everywhere(depth: FloatArray) -> FloatArray:
    return np.ones_like(depth)


def test_an_incompressible_film_keeps_its_volume() -> None:
    assert normal_stretch(np.ones(1), 1e6, np.array([0.8])) == pytest.approx(1 / 0.8**2, rel=1e-4)


@pytest.mark.parametrize("wave_number", [1.0, 10.0])
def test_a_half_space_that_grows_all_over_folds_as_biot_says_whatever_the_wave(wave_number: float) -> None:
    # its stretches across and along the surface are then as 1 to 0.2956, and the cube root of that is 0.666
    material = Material(mu_cortex=1.0, mu_core=1.0, bulk=100.0)
    assert critical_growth(wave_number, 1.0, material, everywhere) == pytest.approx(0.2956 ** (-1 / 3) - 1, rel=5e-3)


def test_a_stiff_film_folds_as_allen_says() -> None:
    wavelength, growth = theory(1.0, Material(mu_core=1e-3))
    found = layer(1000)
    assert found.wavelength == pytest.approx(wavelength, rel=0.02)
    # Allen's film is compressed along the waves alone; this one across them as well, by Poisson's ratio, 13 / 32
    assert found.growth == pytest.approx(growth / (1 + 13 / 32), rel=0.02)


def test_waves_are_longer_and_come_earlier_where_the_layer_is_stiffer() -> None:
    found = [layer(stiffness) for stiffness in (1, 5, 20)]
    assert [one.set_by_layer for one in found] == [True, True, True]
    assert np.all(np.diff([one.wavelength for one in found]) > 0)
    assert np.all(np.diff([one.growth for one in found]) < 0)


def test_a_layer_softer_than_its_base_creases_before_it_folds() -> None:
    assert not layer(0.2).set_by_layer


def test_nothing_folds_that_has_not_grown() -> None:
    assert is_stable(0.0, 1.0, 1.0, Material(), smooth_profile)
