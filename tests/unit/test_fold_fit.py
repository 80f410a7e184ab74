"""Calibration of the growing model, on made-up tables of runs."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from fold_brain import TARGET_WEEKS, determined, misses

from cortet.folding.growth import AREA, VOLUME, usual


def table(*, area: float = 1.0, width: float = 12.0) -> pd.DataFrame:
    """A run that grows as usual hemispheres do, its area by a factor more."""
    ages = np.arange(22.0, 36.1, 0.5)
    factor = np.where(ages > 22, area, 1.0)
    return pd.DataFrame(
        {
            "gestational_age": ages,
            "volume_mm3": 19_800 * usual(VOLUME, ages) / usual(VOLUME, ages[:1]),
            "area_mm2": factor * 4_770 * usual(AREA, ages) / usual(AREA, ages[:1]),
            "cortical_thickness_mm": 1.1,
            "fold_spacing_mm": width,
        }
    )


def test_a_run_that_is_as_it_should_be_misses_nothing() -> None:
    found = misses(table())
    assert {column: len(missed) for column, missed in found.items()} == {
        "volume_mm3": 7, "area_mm2": 7, "cortical_thickness_mm": 7, "fold_spacing_mm": 5,
    }  # fmt: skip
    assert max(np.abs(missed).max() for missed in found.values()) < 1e-9
    assert TARGET_WEEKS[-1] == 38  # which this run has not reached


def test_misses_are_in_standard_errors() -> None:
    found = misses(table(area=1.05, width=12 * 0.92))
    assert found["area_mm2"] == pytest.approx(1.0)
    assert found["fold_spacing_mm"] == pytest.approx(-1.0)


def test_a_parameter_that_moves_a_target_more_is_determined_better() -> None:
    base = np.zeros(3)
    stepped = 0.1 * np.array([[10.0, 0, 0], [0, 0, 2.0]])
    assert determined(base, stepped, 0.1) == pytest.approx([0.1, 0.5])
