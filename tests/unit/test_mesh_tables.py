"""Tables with one row per mesh hold what the records hold, and the published rows below."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from cubes import cube_mesh
from latex import require_fits

from cortet.formats.tables import names
from cortet.measure.checks import checked
from cortet.measure.quality import summarise
from cortet.paper.mesh_tables import (
    RESOLUTION,
    TABLES,
    exponent,
    measures_table,
    resolution_table,
    write_mesh_table,
)
from cortet.paper.records import Origin

AGES = {"sub-a": 28.0, "sub-b": 22.0}


def record(n: int) -> dict[str, Any]:
    return asdict(summarise(cube_mesh(n)))


def rows_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table, with None where there is no value."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def at(case: str, size: float, setting: str = "default") -> Origin:
    return Origin(case, size, "cgal", setting, "Solver")


def test_cells_of_half_the_size_are_eight_times_as_many() -> None:
    sizes = pd.DataFrame({"cell_size_mm": [0.4, 0.8], "tets": [8000, 1000]})
    slope, error = exponent(sizes)
    assert slope == pytest.approx(-3) and np.isnan(error)
    assert np.isnan(exponent(sizes.assign(cell_size_mm=0.4))).all()


def test_an_exponent_of_three_sizes_has_its_error() -> None:
    sizes = pd.DataFrame({"cell_size_mm": [0.5, 1.0, 2.0], "tets": [8000 * 1.1, 1000, 125 * 1.1]})
    slope, error = exponent(sizes)
    # residuals of the logarithms are log 1.1 / 3 times 1, -2, 1; x has 2 (log 2)^2 around its mean
    assert slope == pytest.approx(-3)
    assert error == pytest.approx(np.log(1.1) / 3 * np.sqrt(6) / (np.log(2) * np.sqrt(2)))
    (column,) = (column for column in RESOLUTION.columns if column.name == "exponent")
    assert column.text({"exponent": slope, "exponent_se": error}) == "-3.00 ± 0.08"
    assert column.text({"exponent": slope, "exponent_se": None}) == "-3.00"


def test_rows_are_in_the_order_of_age_setting_and_cell_size() -> None:
    records = {at("sub-a", 1.0): record(2), at("sub-b", 1.0): record(2), at("sub-b", 0.5): record(4)}
    rows = rows_of(resolution_table(records, {}, AGES))
    assert [(row["case"], row["cell_size_mm"]) for row in rows[:3]] == [("sub-b", 0.5), ("sub-b", 1.0), ("sub-a", 1.0)]
    assert rows[0]["exponent"] == rows[1]["exponent"] == pytest.approx(-3)
    assert rows[2]["exponent"] is None
    assert rows[0]["tets"] == 6 * 4**3


@pytest.mark.parametrize("ages", [{"sub-a": None, "sub-b": 22.0}, {"sub-a": None, "sub-b": None}])
def test_an_unknown_age_is_n_a(tmp_path: Path, ages: dict[str, float | None]) -> None:
    records = {at("sub-a", 1.0): record(2), at("sub-b", 1.0): record(2)}
    rows = rows_of(resolution_table(records, {}, ages))
    assert {row["case"]: row["scan_age"] for row in rows if row["case"] in ages} == ages
    assert [row["case"] for row in rows[:2]] == sorted(ages, key=lambda case: (ages[case] is None, case))
    assert len(measures_table(records, {}, ages)) > 2


def test_the_published_table_stands_below() -> None:
    rows = rows_of(resolution_table({at("sub-a", 1.0): record(2)}, {}, AGES))
    assert len(rows) == 1 + 9
    assert {row["source"] for row in rows[1:]} == {"arXiv:2607.12157"}
    assert [row["exponent"] for row in rows[1:]] == pytest.approx(9 * [-3], abs=0.02)


def test_a_mesh_that_is_missing_is_a_row_that_says_why() -> None:
    missing = {at("sub-a", 0.5): "generate: too fine"}
    rows = rows_of(resolution_table({at("sub-a", 1.0): record(2)}, missing, AGES))
    assert (rows[0]["cell_size_mm"], rows[0]["tets"], rows[0]["remarks"]) == (0.5, None, "generate: too fine")
    assert rows_of(measures_table({}, missing, AGES))[0]["q_max"] is None


def test_a_mesh_that_is_not_certified_is_a_row_that_says_why() -> None:
    records = {at("sub-a", 0.5): record(2), at("sub-b", 0.5): record(2)}
    refused = {at("sub-a", 0.5): "worst q 0.7, must be below 0.6"}
    for table in (resolution_table, measures_table):
        remarks = {row["case"]: row["remarks"] for row in rows_of(table(records, {}, AGES, refused))}
        assert remarks["sub-a"] == "not certified: worst q 0.7, must be below 0.6"
        assert remarks["sub-b"] is None


@pytest.mark.parametrize("table", TABLES)
def test_its_reasons_are_those_of_its_certificate(table: str, tmp_path: Path) -> None:
    origin, files = asdict(at("sub-a", 0.6)), {}
    (tmp_path / "record.json").write_text(json.dumps({"origin": origin, **record(2)}))
    for limit in (0.6, 0.8):
        check = asdict(checked("worst_q", 0.7, "<", limit, remedy="use a smaller cell size"))
        files[limit] = tmp_path / f"{limit}.json"
        files[limit].write_text(json.dumps({"schema": 1, "certified": check["passed"], "checks": [check]}))

    def remarks(**more: Any) -> str:
        write_mesh_table(table, [tmp_path / "record.json"], [], [tmp_path / "t.tsv"], ages=AGES, **more)
        return str(pd.read_csv(tmp_path / "t.tsv", sep="\t", keep_default_na=False)["remarks"][0])

    assert remarks(certificates={str(files[0.8]): origin}) == "n/a"
    assert remarks(certificates={str(files[0.6]): origin}) == "not certified: worst q 0.7, must be below 0.6"
    missing = [{"origin": origin, "reason": "certify: out of memory"}]
    assert remarks(uncertified=missing) == "not certified: certify: out of memory"


def test_measures_are_the_largest_of_each_record_and_the_published_range() -> None:
    content = record(2)
    ours, theirs = rows_of(measures_table({at("sub-a", 1.0): content}, {}, AGES))
    assert ours["one_minus_mean_ratio_max"] == content["one_minus_mean_ratio"]["max"]
    assert ours["q_max"] == content["q"]["max"]
    assert theirs["one_minus_radius_ratio_range"] == "0.422-0.497"


@pytest.mark.parametrize("table", TABLES)
def test_they_are_written_in_every_form(table: str, tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    path.write_text(json.dumps({"origin": asdict(at("sub-a", 0.6, "published")), **record(2)}))
    outputs = [tmp_path / f"table.{suffix}" for suffix in ("tsv", "json", "tex", "md", "html")]
    write_mesh_table(table, [str(path)], [], outputs, ages=AGES)
    header, first, *_ = (tmp_path / "table.tsv").read_text().splitlines()
    assert (
        header.split("\t") == names(TABLES[table][0].columns) == list(json.loads((tmp_path / "table.json").read_text()))
    )
    assert dict(zip(header.split("\t"), first.split("\t"), strict=True))["setting"] == "published"
    assert re.search(r"\| sub-a +\| +28\.0 +\| CGAL +\| published +\| +0\.6 +\|", (tmp_path / "table.md").read_text())


@pytest.mark.parametrize("table", TABLES)
def test_they_fit_both_columns_of_a_journal(table: str, tmp_path: Path) -> None:
    path = tmp_path / "record.json"
    path.write_text(json.dumps({"origin": asdict(at("sub-a", 0.6, "published")), **record(2)}))
    missing = [{"origin": asdict(at("sub-b_hemi-L", 0.6)), "reason": "gate: the surface is open along 3 edges"}]
    refused = [
        {"origin": asdict(at("sub-a", 0.6, "published")), "reason": "worst q 0.7123, must be below 0.6; 2 handles"}
    ]
    ages = AGES | {"sub-b_hemi-L": None}
    write_mesh_table(table, [str(path)], missing, [tmp_path / "table.tex"], ages=ages, uncertified=refused)
    require_fits(tmp_path / "table.tex")
