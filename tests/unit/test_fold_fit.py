"""The fit to real brains: which of them judge it, and how."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from fold_fit import LAST, misfits, real


def test_healthy_fetal_hemispheres_judge_and_newborns_test() -> None:
    fetal, newborn = real(born=False), real(born=True)
    assert not set(fetal["surface"]) & set(newborn["surface"])
    assert not fetal["surface"].str.startswith("SB_").any()
    assert len(fetal) == 8 and len(newborn) == 4
    assert max(fetal["gestational_age"].max(), newborn["gestational_age"].max()) <= LAST


def test_the_misfit_of_a_curve_that_is_a_tenth_too_high() -> None:
    brains = real(born=False)
    columns = ["gestational_age", "gyrification_index", "relative_area"]
    ages = np.sort(brains["gestational_age"].unique())
    run = pd.DataFrame({"gestational_age": ages, "gyrification_index": 1.0, "relative_area": 7.0})
    even = brains.assign(gyrification_index=1 / 1.1, relative_area=7 / 1.1)[columns]
    assert misfits(run, even) == pytest.approx((0.1, 0.1))
