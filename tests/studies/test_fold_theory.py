"""Exact onset of the folds of a growing layer: Biot's half-space, Allen's stiff film, and what is between them."""

from __future__ import annotations

import numpy as np
import pytest
from cubes import cube_mesh
from fold_strips import theory
from fold_theory import (
    Onset,
    critical_growth,
    is_stable,
    moduli,
    normal_stretch,
    onset,
    sharp_profile,
    smooth_profile,
)

from cortet.folding.body import Material, Scale, body_of
from cortet.folding.kernels import Motion, energies, workspace
from cortet.folding.law import ACROSS
from cortet.folding.models import tangential
from cortet.meshes import FloatArray


def layer(stiffness: float) -> Onset:
    return onset(Material(mu_core=1 / stiffness), sharp_profile)


def everywhere(depth: FloatArray) -> FloatArray:
    return np.ones_like(depth)


@pytest.mark.parametrize(("along", "across"), [(0.0, 0.0), (0.4, -0.5)])
@pytest.mark.parametrize("depth", [0.2, 0.95])
def test_moduli_are_the_second_derivatives_of_the_energy_that_the_simulation_has(along, across, depth):
    mesh, material = cube_mesh(1), Material(mu_cortex=1.0, mu_core=0.3)
    m = len(mesh.cells)
    body = body_of(mesh, Scale(np.zeros(3), 1.0), thickness=1.0)._replace(
        normals=np.tile([0.0, 0.0, 1.0], (m, 1)), depth=np.full(m, depth)
    )
    work, growth = workspace(body), tangential([along])
    growth[:, ACROSS] = across
    share = smooth_profile(np.array([depth]))
    mu = material.mu_core + (material.mu_cortex - material.mu_core) * share
    flat = np.diag([1, 1, normal_stretch(mu, material.bulk, 1 / (1 + along * share))[0] * (1 + across * share[0])])

    def energy(first: tuple[int, int], second: tuple[int, int], h: float, k: float) -> float:
        """That of the flat state with two more displacement gradients, per initial volume: the cube's is 1."""
        gradient = flat.copy()
        gradient[first] += h
        gradient[second] += k
        x = mesh.points @ gradient.T
        return energies(material, Motion(x, np.zeros_like(x)), work, growth, 0.0)[1]

    h = 1e-4
    xx, zz, xz, zx = (0, 0), (2, 2), (0, 2), (2, 0)
    slope = (energy(zz, zz, h, 0) - energy(zz, zz, -h, 0)) / (2 * h)
    assert slope == pytest.approx(0, abs=1e-7)  # nothing pulls at the surface
    for pair, found in zip(((xx, zz), (xz, zx)), moduli(mu, material.bulk, along * share, across * share), strict=True):
        expected = [
            [
                sum(i * j * energy(one, other, i * h, j * h) for i in (-1, 1) for j in (-1, 1)) / (4 * h * h)
                for other in pair
            ]
            for one in pair
        ]
        assert found[0] == pytest.approx(np.array(expected), abs=1e-6)


@pytest.mark.parametrize(("wave_number", "across"), [(1.0, 0.0), (10.0, 0.0), (1.0, -0.5)])
def test_a_half_space_that_grows_all_over_folds_as_biot_says_whatever_the_wave(wave_number, across):
    # its stretches across and along the surface are then as 1 to 0.2956, and the cube root of that is 0.666
    material = Material(mu_cortex=1.0, mu_core=1.0, bulk=100.0)
    found = critical_growth(wave_number, 1.0, material, everywhere, across)
    assert found == pytest.approx(0.2956 ** (-1 / 3) - 1, rel=5e-3)


def test_a_stiff_film_folds_as_allen_says():
    wavelength, growth = theory(1.0, Material(mu_core=1e-3))
    found = layer(1000)
    assert found.wavelength == pytest.approx(wavelength, rel=0.02)
    # Allen's film is compressed along the waves alone; this one across them as well, by Poisson's ratio, 13 / 32
    assert found.growth == pytest.approx(growth / (1 + 13 / 32), rel=0.02)


def test_waves_are_longer_and_come_earlier_where_the_layer_is_stiffer():
    found = [layer(stiffness) for stiffness in (1, 5, 20)]
    assert [one.set_by_layer for one in found] == [True, True, True]
    assert np.all(np.diff([one.wavelength for one in found]) > 0)
    assert np.all(np.diff([one.growth for one in found]) < 0)
    assert not layer(0.2).set_by_layer, "a layer softer than its base creases before it folds"
    assert is_stable(0.0, 1.0, 1.0, Material(), smooth_profile), "nothing folds that has not grown"
