"""Limits of known series are found, chance is told from cell size, and folds are compared on the common surface."""

from __future__ import annotations

import pytest
from convergence import (
    limit,
)

SIZES = [1.6, 1.2, 0.9]


@pytest.mark.parametrize("order", [1.0, 3.0])
def test_the_limit_of_a_known_series_is_found(order):
    values = [1.3 - 0.2 * size**order for size in [3.0, *SIZES]]  # only the last three count
    found = limit([3.0, *SIZES], values, 1e-3)
    assert found is not None
    assert found.value == pytest.approx(1.3, abs=1e-6)
    assert found.order == pytest.approx(order, abs=1e-3)
    assert found.error == pytest.approx(1.25 * abs(1.3 - values[-1]), rel=1e-3)


@pytest.mark.parametrize(
    ("sizes", "values", "chance"),
    [
        (SIZES, [1.0, 1.2, 1.1], 0.0),  # to and fro
        (SIZES, [1.0, 1.1, 1.3], 0.0),  # away
        (SIZES, [1.0, 1.1, 1.13], 0.05),  # the last step may be chance
        (SIZES[:2], [1.0, 1.1], 0.0),
        (SIZES, [1.0, 1.1, None], 0.0),
    ],
)
def test_there_is_none_where_nothing_goes_evenly_towards_one(sizes, values, chance):
    assert limit(sizes, values, chance) is None
