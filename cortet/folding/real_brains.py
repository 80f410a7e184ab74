"""Size, shape and folds of real brains, which figures show beside folds; `data/real_brains.json` explains them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from cortet.report.published import numbers_of

#: source of brains whose anatomy is abnormal
ABNORMAL = "spina bifida atlas"


def real_brains() -> pd.DataFrame:
    """Size, shape and folds of real surfaces, 22 to 42 weeks, one row each."""
    return numbers_of(Path(__file__).with_name("data") / "real_brains.tsv")


def healthy_hemispheres() -> pd.DataFrame:
    """The rows of `real_brains` that are the inner surface of one healthy hemisphere."""
    brains = real_brains()
    return brains[(brains["surface_type"] == "white") & (brains["hemi"] != "both") & (brains["source"] != ABNORMAL)]


def as_real_brains(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of a fold's table, or of `measurements.shape`, with areas and volumes under the names of `real_brains`."""
    return rows.assign(
        area_cm2=rows["area_mm2"] / 100,
        volume_ml=rows["volume_mm3"] / 1000,
        hull_volume_ml=rows["hull_volume_mm3"] / 1000,
    )
