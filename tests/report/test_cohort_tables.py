"""Tables hold what the certificates hold, and their sidecars explain every column."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import pandas as pd
import pytest
from cubes import cube_mesh
from shapes import ball_surface

from cortet.cohort.sheet import Case
from cortet.config.sections import Certify
from cortet.config.stages import Resample
from cortet.errors import InputError
from cortet.formats.tables import names
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import certify
from cortet.report.cohort_tables import (
    QUALITY_COLUMNS,
    SUMMARY,
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
    """A certificate; the surface of the second case was resampled and repaired."""
    mesh, second = cube_mesh(3, side=6.0), case is CASES[1]
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
            **({"resample": resampled} if second else {}),
            "repair": {**repaired, "repaired": second},
            "generate": {"topology_ok": True, "reason": "", "backend": "cgal", "facet_distance_mm": 0.5},
        },
    )
    return json.loads(json.dumps(asdict(certificate)))


@pytest.fixture(scope="module")
def records() -> list[dict[str, Any]]:
    return [record(CASES[0]), record(CASES[1], q_max=0.2)]


def test_one_row_per_certificate_with_the_sheet_before_the_measures(records):
    first, second = quality_table(records, CASES).to_dict("records")
    assert (first["case"], first["participant_id"], first["session_id"]) == ("sub-01_ses-a_hemi-L", "sub-01", "ses-a")
    assert (first["scan_age"], first["site"]) == (22.5, "x")
    assert pd.isna(second["session_id"])
    assert first["q_max"] == records[0]["quality"]["q"]["max"]
    assert first["tets"] == 6 * 27 and first["cell_size_mm"] == 1.0
    assert first["nodes_to_surface_max_mm"] == records[0]["fidelity"]["nodes_to_surface_mm"]["max"]
    assert (first["euler_number"], first["crossing_faces"]) == (2, 0)
    assert (first["surface_state"], second["surface_state"]) == ("as given", "repaired")
    off = records[1]["reports"]["resample"]["native_to_resampled_mm"]["mean"]
    assert pd.isna(first["resample_native_to_resampled_mean_mm"])
    assert second["resample_native_to_resampled_mean_mm"] == off > 0
    assert (first["verdict"], first["reasons"], second["verdict"]) == ("pass", "", "fail")
    assert "must be below 0.2" in second["reasons"]


def test_every_value_is_found_in_a_certificate_and_every_certificate_in_the_sheet(records, tmp_path):
    values = quality_table(records, CASES).loc[1, names(QUALITY_COLUMNS)]
    assert list(values.index[values.isna()]) == []
    with pytest.raises(KeyError, match="sub-01_ses-a_hemi-L"):
        quality_table(records, CASES[1:])
    older = {key: value for key, value in records[0].items() if key != "schema"}
    for content in ({}, older):
        (tmp_path / "other.json").write_text(json.dumps(content))
        with pytest.raises(InputError, match=r"other\.json: .*certificate"):
            read_certificate(tmp_path / "other.json")


def test_sidecars_explain_every_column_and_give_units_and_thresholds(records, tmp_path):
    explained = {}
    for name, write in (("quality", write_quality), ("summary", write_summary)):
        table, beside = tmp_path / f"{name}.tsv", tmp_path / f"{name}.json"
        write(records[:1], CASES, [table, beside])
        explained |= json.loads(beside.read_text())
        assert list(json.loads(beside.read_text())) == list(read_tsv(table))
    assert all(entry["Description"] for entry in explained.values())
    row = read_tsv(tmp_path / "quality.tsv").iloc[0]
    assert float(row["q_max"]) == pytest.approx(records[0]["quality"]["q"]["max"], rel=1e-5)
    assert row["reasons"] == "n/a"
    explained = json.loads((tmp_path / "quality.json").read_text())
    assert explained["q_max"]["Threshold"] == "< 0.6" and explained["scan_age"]["Units"] == "weeks"
    assert explained["nodes_to_surface_max_mm"]["Threshold"] == "<= 0.001"
    assert explained["bank_gap"]["Threshold"] == ">= 0.03"


def test_the_summary_has_the_format_of_the_published_table_by_cell_size():
    meshes = [
        (0.6, "pass", 0.1285, 0.462, 0),
        (0.6, "pass", 0.129, 0.508, 0),
        (0.6, "fail", 0.1295, 0.661, 4),
        (0.8, "pass", 0.128, 0.462, 1),
        (0.8, "pass", 0.131, 0.462, 1),
        (1.0, "pass", 0.13, 0.462, 12095),
    ]
    columns = ["cell_size_mm", "verdict", "q_mean", "q_max", "q_above_0.6"]
    table = summary_table(pd.DataFrame(meshes, columns=columns).assign(mesher="cgal"))
    assert list(table) == names(SUMMARY.columns)
    three, two, one = table.to_dict("records")
    assert (three["q_mean"], three["q_max"]) == ("0.129 ± 0.001", "0.508 [0.462-0.661]")
    assert (three["q_above_0.6"], three["q_above_0.6_total"]) == ("0 [0-4]", 4)
    assert (three["meshes"], three["certified"]) == (3, 2)
    assert two["q_mean"] == "0.130 [0.128-0.131]"
    assert (one["q_mean"], one["q_max"], one["q_above_0.6"]) == ("0.130", "0.462", "12,095")
