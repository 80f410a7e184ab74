"""The tables of the paper hold what the records hold, say what failed, and have the published rows below."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd
import pytest
from cubes import cube_mesh

from cortet.formats.tables import names
from cortet.measure.checks import Number, checked
from cortet.measure.quality import summarise
from cortet.paper.ablation import ABLATION, ablation_table
from cortet.paper.mesh_tables import (
    MEASURES,
    RESOLUTION,
    exponent,
    measures_table,
    not_certified,
    resolution_table,
)
from cortet.report.records import Origin
from cortet.report.table_files import Table, write

AGES = {"sub-a": 28.0, "sub-b": 22.0}
OF_MESHES = pytest.mark.parametrize(
    ("table", "table_of"), [(RESOLUTION, resolution_table), (MEASURES, measures_table)], ids=["resolution", "measures"]
)


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


def ours(*inputs: Any) -> list[dict[str, Any]]:
    """Rows of this cohort in Table 1."""
    return [row for row in rows_of(ablation_table(*inputs)) if row["source"] == "this cohort"]


def printed(table: Table, name: str, row: dict[str, Any]) -> str:
    """A cell as readers see it."""
    (column,) = (column for column in table.columns if column.name == name)
    return column.text(row)


# --- Table 1: the ablation -------------------------------------------------------------------------------------------


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
    rows = ours(records, {}, {}, {})
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


def test_what_failed_is_told_with_its_reason():
    reports = {at("a", "Generated", None, "netgen"): {"failure": "netgen crashed (SIGSEGV)"}}
    missing = {at("b", "Cleaned"): "relocate: Gmsh failed", at("c", "Cleaned"): "clean: too bad"}
    cleaned, crashed = ours({at("a", "Cleaned"): record(max=0.4)}, reports, missing, {})
    assert (cleaned["meshes"], cleaned["failed"]) == (1, 2)
    assert cleaned["remarks"] == "sub-b: relocate: Gmsh failed; sub-c: clean: too bad"
    assert (crashed["configuration"], crashed["meshes"], crashed["failed"]) == ("Netgen only", 0, 1)
    assert crashed["remarks"] == "sub-a: netgen crashed (SIGSEGV)" and crashed["q_max_median"] is None


def test_reference_meshes_and_the_published_table_stand_below():
    records, references = {at("a", "Generated", None): record()}, {"tallinen": record(max=0.811, above=15)}
    rows = rows_of(ablation_table(records, {}, {}, references))
    assert [row["source"] for row in rows] == ["this cohort", "reference mesh"] + 5 * ["arXiv:2607.12157"]
    assert rows[1]["q_max_median"] == 0.811
    assert [row["q_above_0.6_median"] for row in rows[2:]] == [15955, 15, 888, 191, 0]


# --- Table 2 and other measures: one row per mesh --------------------------------------------------------------------


def test_cells_of_half_the_size_are_eight_times_as_many():
    sizes = pd.DataFrame({"cell_size_mm": [0.4, 0.8], "tets": [8000, 1000]})
    slope, error = exponent(sizes)
    assert slope == pytest.approx(-3) and np.isnan(error)
    assert np.isnan(exponent(sizes.assign(cell_size_mm=0.4))).all()
    slope, error = exponent(pd.DataFrame({"cell_size_mm": [0.5, 1.0, 2.0], "tets": [8000 * 1.1, 1000, 125 * 1.1]}))
    # residuals of the logarithms are log 1.1 / 3 times 1, -2, 1; x has 2 (log 2)^2 around its mean
    assert slope == pytest.approx(-3)
    assert error == pytest.approx(np.log(1.1) / 3 * np.sqrt(6) / (np.log(2) * np.sqrt(2)))
    assert printed(RESOLUTION, "exponent", {"exponent": slope, "exponent_se": error}) == "-3.00 ± 0.08"


def test_rows_are_in_the_order_of_age_and_cell_size_before_the_published_ones():
    records = {at("a", size=1.0): record(2), at("b", size=1.0): record(2), at("b", size=0.5): record(4)}
    rows = rows_of(resolution_table(records, {}, AGES))
    assert [(row["case"], row["cell_size_mm"]) for row in rows[:3]] == [("sub-b", 0.5), ("sub-b", 1.0), ("sub-a", 1.0)]
    assert rows[0]["exponent"] == rows[1]["exponent"] == pytest.approx(-3)
    assert rows[2]["exponent"] is None and rows[0]["tets"] == 6 * 4**3
    assert {row["source"] for row in rows[3:]} == {"arXiv:2607.12157"}
    assert [row["exponent"] for row in rows[3:]] == pytest.approx(9 * [-3], abs=0.02)


def test_measures_are_the_largest_of_each_record_and_the_published_range():
    content = record()
    mine, theirs = rows_of(measures_table({at("a"): content}, {}, AGES))
    assert mine["one_minus_mean_ratio_max"] == content["one_minus_mean_ratio"]["max"]
    assert mine["q_max"] == content["q"]["max"]
    assert theirs["one_minus_radius_ratio_range"] == "0.422-0.497"


@OF_MESHES
def test_a_mesh_that_is_missing_or_not_certified_says_why(table, table_of, tmp_path):
    certificates = {}
    for case, limit in (("a", 0.6), ("b", 0.8)):
        check = asdict(checked(Number("worst_q", 0.7, limit, "use a smaller cell size")))
        file = tmp_path / f"{case}.json"
        file.write_text(json.dumps({"schema": 1, "certified": check["passed"], "checks": [check]}))
        certificates[str(file)] = at(case)
    missing = {at("c"): "generate: too fine"}
    ages = AGES | {"sub-c": 40.0}
    rows = rows_of(table_of({at("a"): record(), at("b"): record()}, missing, ages, not_certified(certificates)))
    remarks = {row["case"]: row["remarks"] for row in rows}
    assert remarks["sub-a"] == "not certified: worst q 0.7, must be below 0.6" and remarks["sub-b"] is None
    assert (rows[2]["case"], rows[2]["q_max"], remarks["sub-c"]) == ("sub-c", None, "generate: too fine")


# --- as files --------------------------------------------------------------------------------------------------------

LONG = "gate: the surface is open along 3 edges"


def rows_with_long_remarks(table: Table) -> pd.DataFrame:
    """A table in which a case of a long name failed, and a mesh has no certificate."""
    if table is ABLATION:
        records = {at(case, "Generated", None): record(above=12_095) for case in "acd"}
        return ablation_table(records, {}, {at("b", "Generated", None): LONG}, {"ball": record()})
    mesh, missing, ages = at("a", setting="published"), {at("b_hemi-L"): LONG}, AGES | {"sub-b_hemi-L": None}
    refused = {mesh: "worst q 0.7123, must be below 0.6; 2 handles"}
    table_of = resolution_table if table is RESOLUTION else measures_table
    return table_of({mesh: record()}, missing, ages, refused)


@pytest.mark.parametrize("table", [ABLATION, RESOLUTION, MEASURES], ids=lambda table: table.title)
def test_they_are_written_in_every_form(table, tmp_path):
    tsv, sidecar, latex = (tmp_path / f"table.{suffix}" for suffix in ("tsv", "json", "tex"))
    rows = rows_with_long_remarks(table)
    write(table, rows, tsv, sidecar, latex)
    header, *lines = tsv.read_text().splitlines()
    assert header.split("\t") == names(table.columns) == list(json.loads(sidecar.read_text()))
    assert len(lines) == len(rows) and LONG in tsv.read_text()
    assert LONG in latex.read_text() and re.search(r"\b0\.6 &", latex.read_text())
