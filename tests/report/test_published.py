"""The published figures that come with the package are those of the paper, and each column is explained."""

from __future__ import annotations

import numpy as np
import pytest

from cortet.report import published


def test_the_tables_are_those_of_the_paper():
    worst = published.cohort()["q_max"]
    assert (len(worst), worst.min(), worst.median(), worst.max()) == pytest.approx((194, 0.462, 0.508, 0.561), abs=5e-4)
    assert published.resolution().groupby("case")["cell_size_mm"].agg(set).tolist() == 3 * [{0.4, 0.6, 0.8}]
    assert len(published.measures()) == 3
    assert tuple(published.measures().loc["one_minus_mean_ratio"]) == (0.339, 0.390)


def test_the_pooled_distribution_agrees_with_table_1():
    middle = (np.arange(200) + 0.5) / 200
    table = published.ablation()
    for stages, row in table[table["mesher"] == "cgal"].set_index("stages").iterrows():
        counts = published.histogram(stages)
        assert counts.sum() == 200_379_097
        assert counts @ middle / counts.sum() == pytest.approx(row["q_mean_mean"], abs=1e-3)
        assert counts[120:].sum() == row["q_above_0.6_total"]
        assert middle[counts.nonzero()[0].max()] == pytest.approx(row["q_max_max"], abs=0.0035)
