"""The table by week: what is measured of real surfaces, means of runs, laws, and what is more or less than usual."""

from __future__ import annotations

from pathlib import Path

import fold_brain
import numpy as np
import pytest
from fold_brain import (
    fitted,
    of_pair,
    of_surface,
    table_of,
)
from shapes import ball_surface

from cortet.folding.fold_figures import healthy_fetuses, healthy_hemispheres, real_brains
from cortet.folding.growth import AREA, HULL, VOLUME, usual
from cortet.meshes import TriSurface

SHARED = Path(__file__).parents[3] / "shared/data"


def test_a_pair_of_balls_has_the_cortex_between_them():
    pial, white = ball_surface(4, radius=12.0), ball_surface(4, radius=10.0)
    found, inside = of_pair(pial, white, None), of_surface(white, None)
    assert found["cortex_share"] == pytest.approx(1 - (10 / 12) ** 3, rel=1e-6)
    assert found["cortical_thickness_mm"] == pytest.approx((12**3 - 10**3) / 12**2 / 3, rel=2e-3)
    assert found["area_cm2"] == inside["area_cm2"] == pytest.approx(4 * np.pi, rel=3e-3)
    assert np.isnan(inside["cortical_thickness_mm"]) and np.isnan(inside["cortex_share"])


def test_the_medial_wall_takes_no_part_in_width_and_depth_and_is_no_cortex():
    ball = ball_surface(5, radius=10.0)
    dished = ball.points.copy()
    dished[dished[:, 0] > 8, 0] = 6.0  # a left half whose medial wall lies in a hollow
    surface = TriSurface(dished, ball.faces)
    whole, half = of_surface(surface, None), of_surface(surface, "L", cortex_volume=1000.0)
    assert whole["area_cm2"] == half["area_cm2"]
    assert half["sulcal_depth_mm"] < 0.3 * whole["sulcal_depth_mm"]
    wall = (np.pi * 6.0**2 + 2 * np.pi * 6.0 * 2.0) / 100  # with its rim
    assert half["cortical_thickness_mm"] == pytest.approx(10 / (half["area_cm2"] - wall), rel=0.02)


@pytest.mark.parametrize(
    ("law", "column"), [(AREA, "area_cm2"), (VOLUME, "volume_ml"), (HULL, "hull_volume_ml")], ids=str
)
def test_the_laws_of_the_package_are_those_of_its_table(law, column):
    brains = healthy_hemispheres()
    ages, values = (brains[name].to_numpy(float) for name in ("gestational_age_weeks", column))
    again = fitted(ages, values, (1.2 * law[0], 0.9 * law[1], law[2] + 1))
    assert usual(again, ages) == pytest.approx(usual(law, ages), rel=1e-2)
    assert np.sqrt(((values / usual(law, ages) - 1) ** 2).mean()) < 0.08


def test_fetuses_are_the_healthy_hemispheres_of_no_newborn():
    healthy, fetuses = healthy_hemispheres(), healthy_fetuses()
    assert (len(healthy), len(fetuses)) == (17, 8)
    assert not fetuses["surface"].str.contains("dhcp|week40|SB_").any()


def test_the_table_of_real_brains_is_what_the_surfaces_say(monkeypatch):
    if not SHARED.exists():
        pytest.skip(f"needs {SHARED}")
    names = ["CRL_STA28_left_white", "neonatal_dhcp_w34_rh_pial"]
    known = real_brains()
    known = known[known["surface"].isin(names)].reset_index(drop=True)
    monkeypatch.setattr(fold_brain, "real_brains", lambda: known)
    again = table_of(SHARED)
    numbers = known.select_dtypes("number").columns
    assert again[numbers].astype(float).to_numpy() == pytest.approx(known[numbers].to_numpy())
