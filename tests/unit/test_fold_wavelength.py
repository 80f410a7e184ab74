"""A growing ball folds, with longer waves for a thicker cortex."""

from __future__ import annotations

import numpy as np
import pytest
from fold_solver import fold_ball, mean_degree, solid_ball
from scipy.special import sph_harm_y

from cortet.meshes import TetMesh

#: of a ball of radius 1, and shear modulus over that of the core
THIN, THICK, STIFFNESS = 0.15, 0.3, 3.0


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return solid_ball(800)


@pytest.mark.parametrize("degree", [3, 6])
def test_the_degree_of_a_known_wave_is_found(degree: int) -> None:
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    heights = 1 + 0.05 * sph_harm_y(degree, 2, polar, azimuth).real
    assert mean_degree(directions, heights) == pytest.approx(degree, rel=1e-6)


def test_waves_are_longer_in_a_thicker_cortex(mesh: TetMesh) -> None:
    thin, thick = (fold_ball(mesh, thickness, STIFFNESS) for thickness in (THIN, THICK))
    assert thick.wavelength > 1.2 * thin.wavelength
