"""The table by week: what is measured of real surfaces, means of runs, laws, and what is more or less than usual."""

from __future__ import annotations

from pathlib import Path

import fold_brain
import numpy as np
import pytest
from fold_brain import (
    fitted,
    table_of,
)

from cortet.folding.fold_figures import healthy_hemispheres, real_brains
from cortet.folding.growth import AREA, HULL, VOLUME, usual

SHARED = Path(__file__).parents[3] / "shared/data"


@pytest.mark.parametrize(
    ("law", "column"), [(AREA, "area_cm2"), (VOLUME, "volume_ml"), (HULL, "hull_volume_ml")], ids=str
)
def test_the_laws_of_the_package_are_those_of_its_table(law, column):
    brains = healthy_hemispheres()
    ages, values = (brains[name].to_numpy(float) for name in ("gestational_age_weeks", column))
    again = fitted(ages, values, (1.2 * law[0], 0.9 * law[1], law[2] + 1))
    assert usual(again, ages) == pytest.approx(usual(law, ages), rel=1e-2)
    assert np.sqrt(((values / usual(law, ages) - 1) ** 2).mean()) < 0.08


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
