"""The published figures (arXiv:2607.12157) that tables and figures put beside ours; JSON files explain them."""

from __future__ import annotations

import csv
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from cortet.measure.quality import HISTOGRAM_BIN_WIDTH

#: cell size of the published meshes, mm
CELL_SIZE = 0.6


def cohort() -> list[dict[str, str]]:
    """The 194 meshes of Fig. 3."""
    return _read("published_cohort")


def ablation() -> list[dict[str, str]]:
    """Table 1."""
    return _read("published_ablation")


def resolution() -> list[dict[str, str]]:
    """Table 2."""
    return _read("published_resolution")


def measures() -> dict[str, tuple[float, float]]:
    """Measure -> range of its largest value over three subjects."""
    return {row["measure"]: (float(row["min"]), float(row["max"])) for row in _read("published_measures")}


def histogram(stages: str) -> NDArray[np.int64]:
    """Pooled distribution of q after S1-S2, S1-S3 or S1-S4 (Fig. 2): counts (200,), bins of `measure.quality`."""
    counts = np.zeros(round(1 / HISTOGRAM_BIN_WIDTH), np.int64)
    for row in _read("published_histogram"):
        if row["stages"] == stages:
            counts[round(float(row["bin_left"]) / HISTOGRAM_BIN_WIDTH)] = int(row["count"])
    return counts


def _read(name: str) -> list[dict[str, str]]:
    text = (files("cortet.report") / "data" / f"{name}.tsv").read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines(), delimiter="\t"))
