"""Tables hold what the certificates hold, and their sidecars explain every column."""

from __future__ import annotations

import csv
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from cubes import cube_mesh
from shapes import ball_surface

from cortet.cohort.sheet import Case
from cortet.cohort.status import COLUMNS as STATUS
from cortet.config.sections import Certify
from cortet.config.stages import Resample
from cortet.formats.tables import names, read_columns, sidecar, write_table
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import certify
from cortet.report import DATA, cohort_page, cohort_tables
from cortet.report.cohort_tables import (
    QUALITY_COLUMNS,
    SUMMARY,
    quality_columns,
    quality_table,
    summary_table,
    write_quality,
    write_summary,
)
from cortet.report.records import read_certificate
from cortet.stages.repair import repair
from cortet.stages.resample import resample

CASES = [
    Case("01", "a", "L", 22.5, "phantom", extra={"site": "x"}),
    Case("02", None, "R", 30.0, "phantom", extra={"site": "y"}),
]


def record(case: Case, cell_size: float | None = None, **limits: Any) -> dict[str, Any]:
    mesh = cube_mesh(3, side=6.0)
    surface, _ = boundary_surface(mesh)
    repaired = asdict(repair(surface, source=None)[1])
    resampled = asdict(resample(ball_surface(3), ball_surface(3), Resample(subdivisions=3))[1])
    certificate = certify(
        mesh,
        surface,
        Certify(**limits),
        cell_size=cell_size,
        native=surface,
        case=case.name,
        parameters={"generate": {"cell_size": 1.0, "mesher": "cgal"}},
        reports={
            **({"resample": resampled} if case is CASES[1] else {}),
            "repair": {**repaired, "repaired": case is CASES[1]},
            "generate": {"topology_ok": True, "reason": "", "backend": "cgal", "facet_distance_mm": 0.5},
        },
    )
    return json.loads(json.dumps(asdict(certificate)))


@pytest.fixture(scope="module")
def records() -> list[dict[str, Any]]:
    return [record(CASES[0]), record(CASES[1], q_max=0.2)]


def test_one_row_per_certificate_with_the_sheet_before_the_measures(records: list[dict[str, Any]]) -> None:
    first, second = quality_table(records, CASES).to_dict("records")
    assert (first["case"], first["participant_id"], first["session_id"]) == ("sub-01_ses-a_hemi-L", "sub-01", "ses-a")
    assert (first["scan_age"], first["site"]) == (22.5, "x")
    assert pd.isna(second["session_id"])
    assert first["q_max"] == records[0]["quality"]["q"]["max"]
    assert first["tets"] == 6 * 27
    assert first["cell_size_mm"] == 1.0
    assert first["nodes_to_surface_max_mm"] == records[0]["fidelity"]["nodes_to_surface_mm"]["max"]
    assert (first["euler_number"], first["crossing_faces"]) == (2, 0)
    assert (first["surface_state"], second["surface_state"]) == ("as given", "repaired")
    off = records[1]["reports"]["resample"]["native_to_resampled_mm"]["mean"]
    assert pd.isna(first["resample_native_to_resampled_mean_mm"])
    assert second["resample_native_to_resampled_mean_mm"] == off > 0


def test_verdicts_are_pass_and_fail_with_the_reasons(records: list[dict[str, Any]]) -> None:
    first, second = quality_table(records, CASES).to_dict("records")
    assert (first["verdict"], first["reasons"]) == ("pass", "")
    assert second["verdict"] == "fail"
    assert "must be below 0.2" in second["reasons"]


def test_every_value_is_found_in_a_certificate(records: list[dict[str, Any]]) -> None:
    values = quality_table(records, CASES).loc[1, names(QUALITY_COLUMNS)]
    assert list(values.index[values.isna()]) == []


def test_the_sidecar_explains_every_column_and_gives_units_and_thresholds(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    path.write_text(json.dumps(record(CASES[0])))
    table, beside = tmp_path / "cohort_quality.tsv", tmp_path / "cohort_quality.json"
    write_quality([path], CASES, [table, beside])
    with table.open(newline="") as file:
        (row,) = csv.DictReader(file, delimiter="\t")
    explained = json.loads(beside.read_text())
    assert list(explained) == list(row)
    assert all(entry["Description"] for entry in explained.values())
    assert explained["q_max"]["Threshold"] == "< 0.6"
    assert explained["nodes_to_surface_max_mm"]["Threshold"] == "<= 0.001"
    assert explained["relative_area_change"]["Threshold"] == "<= 0.05"
    assert explained["relative_volume_change"]["Threshold"] == "<= 0.1"
    assert explained["bank_gap"]["Threshold"] == ">= 0.03"
    assert explained["scan_age"]["Units"] == "weeks"
    assert float(row["q_max"]) == pytest.approx(json.loads(path.read_text())["quality"]["q"]["max"], rel=1e-5)
    assert row["reasons"] == "n/a"


def test_the_summary_has_the_format_of_the_published_table() -> None:
    measures = [("pass", 0.1285, 0.462, 0), ("pass", 0.129, 0.508, 0), ("fail", 0.1295, 0.661, 4)]
    rows = [
        {
            "cell_size_mm": 0.6,
            "mesher": "cgal",
            "verdict": verdict,
            "q_mean": mean,
            "q_max": worst,
            "q_above_0.6": count,
        }
        for verdict, mean, worst, count in measures
    ]
    (summary,) = summary_table(pd.DataFrame(rows)).to_dict("records")
    assert list(summary) == names(SUMMARY.columns)
    assert summary["q_mean"] == "0.129 ± 0.001"
    assert summary["q_max"] == "0.508 [0.462-0.661]"
    assert summary["q_above_0.6"] == "0 [0-4]"
    assert (summary["meshes"], summary["certified"], summary["q_above_0.6_total"]) == (3, 2, 4)


def test_a_summary_of_two_meshes_names_both_and_of_one_repeats_nothing() -> None:
    row = {"mesher": "cgal", "verdict": "pass", "q_max": 0.462, "q_above_0.6": 12095}
    both = [{**row, "cell_size_mm": 0.6, "q_mean": mean} for mean in (0.128, 0.131)]
    two, one = summary_table(pd.DataFrame([*both, {**row, "cell_size_mm": 1.0, "q_mean": 0.13}])).to_dict("records")
    assert two["q_mean"] == "0.130 [0.128-0.131]"
    assert (one["q_mean"], one["q_max"], one["q_above_0.6"]) == ("0.130", "0.462", "12,095")


def test_cell_sizes_and_meshers_are_summarised_apart(records: list[dict[str, Any]]) -> None:
    table = summary_table(quality_table(records, CASES).assign(cell_size_mm=[1.0, 0.6]))
    assert list(zip(table["cell_size_mm"], table["meshes"], strict=True)) == [(0.6, 1), (1.0, 1)]


def test_a_limit_that_differs_from_mesh_to_mesh_is_given_as_a_range() -> None:
    sizes = [record(CASES[0], cell_size=size) for size in (0.6, 1.0)]
    explained = sidecar(quality_columns(sizes, ["surface_to_boundary_max_mm", "q_max"]))
    assert explained["surface_to_boundary_max_mm"]["Threshold"] == "<= 0.3 to 0.5, by the mesh"
    assert explained["q_max"]["Threshold"] == "< 0.6"


def test_the_summary_is_written_with_its_sidecar(tmp_path: Path) -> None:
    paths = []
    for case in CASES:
        paths.append(tmp_path / f"{case.name}.json")
        paths[-1].write_text(json.dumps(record(case)))
    table, explained = tmp_path / "s.tsv", tmp_path / "s.json"
    write_summary(paths, CASES, [table, explained])
    assert table.read_text().splitlines()[0].split("\t") == list(json.loads(explained.read_text()))


def test_certificates_of_an_earlier_cortet_give_the_same_table(records: list[dict[str, Any]], tmp_path: Path) -> None:
    """Their checks had names alone."""
    now, before = tmp_path / "now.json", tmp_path / "before.json"
    now.write_text(json.dumps(records[0]))
    old = {key: value for key, value in records[0].items() if key != "schema"}
    old["checks"] = [{key: value for key, value in check.items() if key != "id"} for check in old["checks"]]
    before.write_text(json.dumps(old))
    new, found = read_certificate(now), read_certificate(before)
    assert [check["id"] for check in found["checks"]] == [check["id"] for check in new["checks"]]
    assert {**found, "schema": new["schema"]} == new


def test_a_certificate_of_an_unknown_case_is_an_error(records: list[dict[str, Any]]) -> None:
    with pytest.raises(KeyError, match="sub-01_ses-a_hemi-L"):
        quality_table(records, [replace(CASES[1])])


def test_another_column_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "c.json").write_text(json.dumps(content := record(CASES[0])))
    lines = (DATA / "cohort_quality_columns.tsv").read_text()
    another = "longest_edge_mm\tmm\tquality.longest_edge_mm\tn/a\tLongest edge (mm)\t.3f\tLongest edge of the mesh\n"
    (tmp_path / "columns.tsv").write_text(lines + another)
    columns = read_columns(tmp_path / "columns.tsv")
    monkeypatch.setattr(cohort_tables, "QUALITY_COLUMNS", columns)
    monkeypatch.setattr(cohort_page, "COLUMNS", (*STATUS, *columns))

    table, beside, view = (tmp_path / f"cohort_quality.{suffix}" for suffix in ("tsv", "json", "html"))
    write_quality([tmp_path / "c.json"], CASES, [table, beside, view])
    mesh = {"case": CASES[0].name, "cell_size_mm": 1.0, "mesher": "cgal", "state": "certified"}
    write_table(STATUS, [mesh], tmp_path / "status.tsv")
    cohort_page.write_cohort_page(tmp_path / "status.tsv", (table, beside), tmp_path / "page.html", meshes=[])

    value = content["quality"]["longest_edge_mm"]
    assert read_tsv(table)["longest_edge_mm"].astype(float).tolist() == [pytest.approx(value)]
    assert json.loads(beside.read_text())["longest_edge_mm"] == {
        "Description": "Longest edge of the mesh",
        "Units": "mm",
    }
    assert "Longest edge of the mesh; units: mm" in view.read_text()
    page = (tmp_path / "page.html").read_text()
    assert ">Longest edge (mm)</th>" in page and f">{value:.3f}</td>" in page
