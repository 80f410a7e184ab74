"""Limits of known series are found, chance is told from cell size, and folds are compared on the common surface."""

from __future__ import annotations

import numpy as np
import pytest
from convergence import (
    QUANTITIES,
    Run,
    convergence_table,
    limit,
    sentence,
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


def runs(offset: float = 0.0) -> list[Run]:
    """Two seeds and two meshers at three sizes: order 2 towards 1.3, folds that agree better the smaller the cells."""
    rng = np.random.default_rng(0)
    pattern = np.sin(np.linspace(0, 20, 500))
    found = []
    for mesher in ("lattice", "cgal"):
        for size in SIZES:
            for seed in (0, 1):
                value = 1.3 - offset * size**2 + 1e-4 * seed
                gained = pattern + 0.3 * size * rng.normal(size=500)
                values = dict.fromkeys(QUANTITIES, value)
                found.append(Run("a", mesher, seed, size, 1.25, 1000, True, values, gained, np.ones(500)))
    return found


def test_the_table_tells_chance_from_cell_size():
    table = convergence_table(runs(0.1))
    assert list(table["cell_size_mm"]) == [*SIZES, 0.0] * 2
    limits = table[table["cell_size_mm"] == 0]
    assert limits["gyrification_index"].to_numpy() == pytest.approx(1.3, abs=1e-3)
    measured = table[table["cell_size_mm"] > 0]
    assert measured["gyrification_index_error"].to_numpy() == pytest.approx(1e-4 / np.sqrt(2))
    assert (measured["runs"] == 2).all()
    for pair in ("realisations", "meshers"):
        column = measured[f"correlation_{pair}"].to_numpy().reshape(2, 3)
        assert (np.diff(column, axis=1) > 0).all()
    assert measured["correlation_sizes"].isna().tolist() == [False, False, True] * 2
    assert "Use h <= 0.72 of the thickness" in sentence(convergence_table(runs(0.08)))
    assert "No size tried" in sentence(table)
