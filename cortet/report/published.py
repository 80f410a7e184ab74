"""The published numbers (arXiv:2607.12157) that tables and figures show beside ours; JSON files explain them."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cortet.formats.tsv import MISSING, read_tsv
from cortet.measure.counts import HISTOGRAM_BIN_WIDTH
from cortet.report import DATA

if TYPE_CHECKING:
    import pandas as pd

#: cell size of the published meshes, mm
CELL_SIZE = 0.6
#: columns that hold words, not numbers
_WORDS = ["case", "configuration", "hemi", "measure", "mesher", "source", "stages", "surface", "surface_type"]


def cohort() -> pd.DataFrame:
    """The 194 meshes of Fig. 3, one row each."""
    return _read("published_cohort")


def ablation() -> pd.DataFrame:
    """Table 1."""
    return _read("published_ablation")


def resolution() -> pd.DataFrame:
    """Table 2."""
    return _read("published_resolution")


def measures() -> pd.DataFrame:
    """Range of the largest value of each measure over three subjects: columns `min` and `max`, index the measure."""
    return _read("published_measures").set_index("measure")


def histogram(stages: str) -> NDArray[np.int64]:
    """Pooled distribution of q after S1-S2, S1-S3 or S1-S4 (Fig. 2): counts (200,), bins of `measure.quality`.

    Every page of a mesh shows it, so it is read without pandas.
    """
    counts = np.zeros(round(1 / HISTOGRAM_BIN_WIDTH), np.int64)
    with (DATA / "published_histogram.tsv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file, delimiter="\t"):
            if row["stages"] == stages:
                counts[round(float(row["bin_left"]) / HISTOGRAM_BIN_WIDTH)] = int(row["count"])
    return counts


def _read(name: str) -> pd.DataFrame:
    return numbers_of(DATA / f"{name}.tsv")


def numbers_of(path: Path) -> pd.DataFrame:
    """A table of the package, with numbers as numbers and NaN where its source gives none."""
    import pandas as pd

    table = read_tsv(path).reset_index(drop=True)
    table = table.mask(table == MISSING)
    numbers = table.columns.difference(_WORDS)
    table[numbers] = table[numbers].apply(pd.to_numeric)
    return table
