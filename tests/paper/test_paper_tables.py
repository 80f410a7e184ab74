"""The tables of the paper hold what the records hold, say what failed, and have the published rows below."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
import pytest
from cubes import cube_mesh

from cortet.formats.certificates import SCHEMA, sealed
from cortet.measure.checks import Number, checked
from cortet.measure.quality import summarise
from cortet.paper.ablation import ablation_table
from cortet.paper.mesh_tables import (
    exponent,
    measures_table,
    not_certified,
    resolution_table,
)
from cortet.report.records import Origin

AGES = {"sub-a": 28.0, "sub-b": 22.0}


def record(n: int = 2, **of_q: float) -> dict[str, Any]:
    """The quality record of a cube, with other numbers of q: `mean`, `max`, and `above`, the number of bad elements."""
    content = asdict(summarise(cube_mesh(n)))
    if of_q:
        content["count_above"]["0.6"] = of_q.pop("above", 0)
        content["q"] |= of_q
    return content


def at(case: str, stage: str = "Solver", setting: str | None = "default", mesher: str = "cgal", size: float = 0.6):
    return Origin(f"sub-{case}", size, mesher, setting, stage)


def rows_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table, with None where there is no value."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def test_stages_are_summarised_over_the_meshes_in_their_order():
    records = {
        at("a", "Cleaned", "published"): record(mean=0.128, max=0.50),
        at("b", "Cleaned", "published"): record(mean=0.130, max=0.52),
        at("a", "Generated", None): record(mean=0.134, max=0.75, above=800),
        at("b", "Generated", None): record(mean=0.136, max=0.81, above=1000),
        at("a", "Cleaned"): record(mean=0.12, max=0.4),
        at("b", "Cleaned"): record(mean=0.12, max=0.4),
        at("a", "Generated", None, size=1.0): record(mean=0.1, max=0.7),
        at("a", "Generated", None, mesher="tetgen"): record(mean=0.2, max=0.99),
    }
    rows = [row for row in rows_of(ablation_table(records, {}, {}, {})) if row["source"] == "this cohort"]
    assert [(row["cell_size_mm"], row["configuration"], row["setting"]) for row in rows] == [
        (0.6, "CGAL only", None),
        (0.6, "+ cleaning (S4)", "default"),
        (0.6, "+ cleaning (S4)", "published"),
        (0.6, "TetGen only", None),
        (1.0, "CGAL only", None),
    ]
    first = rows[0]
    assert (first["q_mean_mean"], first["q_mean_sd"]) == pytest.approx((0.135, 0.0014142), rel=1e-4)
    assert (first["q_max_median"], first["q_max_min"], first["q_max_max"]) == (pytest.approx(0.78), 0.75, 0.81)
    assert (first["q_above_0.6_median"], first["q_above_0.6_total"]) == (900, 1800)
    assert (first["meshes"], first["failed"], first["tets_total"]) == (2, 0, 96)


def test_cells_of_half_the_size_are_eight_times_as_many():
    sizes = pd.DataFrame({"cell_size_mm": [0.4, 0.8], "tets": [8000, 1000]})
    slope, error = exponent(sizes)
    assert slope == pytest.approx(-3) and np.isnan(error)
    assert np.isnan(exponent(sizes.assign(cell_size_mm=0.4))).all()
    slope, error = exponent(pd.DataFrame({"cell_size_mm": [0.5, 1.0, 2.0], "tets": [8000 * 1.1, 1000, 125 * 1.1]}))
    # residuals of the logarithms are log 1.1 / 3 times 1, -2, 1; x has 2 (log 2)^2 around its mean
    assert slope == pytest.approx(-3)
    assert error == pytest.approx(np.log(1.1) / 3 * np.sqrt(6) / (np.log(2) * np.sqrt(2)))


def test_rows_are_in_the_order_of_age_and_cell_size_before_the_published_ones():
    records = {at("a", size=1.0): record(2), at("b", size=1.0): record(2), at("b", size=0.5): record(4)}
    rows = rows_of(resolution_table(records, {}, AGES))
    assert [(row["case"], row["cell_size_mm"]) for row in rows[:3]] == [("sub-b", 0.5), ("sub-b", 1.0), ("sub-a", 1.0)]
    assert rows[0]["exponent"] == rows[1]["exponent"] == pytest.approx(-3)
    assert rows[2]["exponent"] is None and rows[0]["tets"] == 6 * 4**3
    assert {row["source"] for row in rows[3:]} == {"arXiv:2607.12157"}
    assert [row["exponent"] for row in rows[3:]] == pytest.approx(9 * [-3], abs=0.02)


@pytest.mark.parametrize("table_of", [resolution_table, measures_table])
def test_a_mesh_that_is_missing_or_not_certified_says_why(table_of, tmp_path):
    certificates = {}
    for case, limit in (("a", 0.6), ("b", 0.8)):
        check = asdict(checked(Number("worst_q", 0.7, limit, "use a smaller cell size")))
        file = tmp_path / f"{case}.json"
        file.write_text(json.dumps(sealed({"schema": SCHEMA, "certified": check["passed"], "checks": [check]})))
        certificates[str(file)] = at(case)
    missing = {at("c"): "generate: too fine"}
    ages = AGES | {"sub-c": 40.0}
    rows = rows_of(table_of({at("a"): record(), at("b"): record()}, missing, ages, not_certified(certificates)))
    remarks = {row["case"]: row["remarks"] for row in rows}
    assert remarks["sub-a"] == "not certified: worst q: 0.7 (must be below 0.6)" and remarks["sub-b"] is None
    assert (rows[2]["case"], rows[2]["q_max"], remarks["sub-c"]) == ("sub-c", None, "generate: too fine")
