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
    quality_table,
    write_quality,
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
    for content in ({}, records[0]):
        (tmp_path / "other.json").write_text(json.dumps(content))
        with pytest.raises(InputError, match=r"other\.json: .*certificate"):
            read_certificate(tmp_path / "other.json")


def test_sidecars_explain_every_column_and_give_units_and_thresholds(records, tmp_path):
    table, beside = tmp_path / "quality.tsv", tmp_path / "quality.json"
    write_quality(records[:1], CASES, [table, beside])
    explained = json.loads(beside.read_text())
    assert list(explained) == list(read_tsv(table)) and all(entry["Description"] for entry in explained.values())
    row = read_tsv(table).iloc[0]
    assert float(row["q_max"]) == pytest.approx(records[0]["quality"]["q"]["max"], rel=1e-5)
    assert row["reasons"] == "n/a"
    assert explained["q_max"]["Threshold"] == "< 0.6" and explained["scan_age"]["Units"] == "weeks"
    assert explained["nodes_to_surface_max_mm"]["Threshold"] == "<= 0.001"
    assert explained["bank_gap"]["Threshold"] == ">= 0.03"
