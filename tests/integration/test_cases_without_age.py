"""Adults and other species: a case without an age is meshed, unsmoothed, beside one that has an age."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from cortet.formats.gifti import write_surface
from tests.integration.study import STATUS, Study, surface

pytestmark = pytest.mark.thorough


def test_a_case_without_an_age_runs_beside_one_with_an_age(tmp_path):
    study = Study(tmp_path)
    study.config["experiments"] = {"settings": ["default"], "resolution": {"cell_size": [4.0]}}
    study.config["smooth_surface"] = {"method": "published"}  # which asks for the age
    study.config["certify"] |= {"max_native_distance": None, "max_mean_native_distance": None}
    inner = tmp_path / "surfaces/b_white.surf.gii"
    study.add_case(study.case("a"), surface(0))
    study.add_case(replace(study.case("b"), scan_age=None, inner={"white": inner}), surface(1))
    one = surface(1)
    write_surface(replace(one, points=0.6 * one.points), inner)
    study.config["fold"] = {"cases": "all", "force": True}
    assert {case for rule, case in study.planned_jobs() if rule == "fold"} == {"sub-a"}

    study.config["fold"] = {}
    asked = ("cohort/cohort_quality.tsv", "logs/CITATION.md")
    jobs = study.jobs_of_run(STATUS, *(f"derivatives/cortet/{file}" for file in asked))
    assert "smooth 1 of 2 cases" in study.said and "sub-b_hemi-L" in study.said
    assert {case for rule, case in jobs if rule == "smooth_surface"} == {"sub-a"}
    assert {row["state"] for row in study.status().values()} == {"certified"}
    certificate = json.loads(study.files("sub-b*Solver_certificate.json")[0].read_text())
    assert "smooth_surface" not in certificate["parameters"]
    columns, *rows = (study.outputs / "cohort/cohort_quality.tsv").read_text().splitlines()
    assert [row.split("\t")[columns.split("\t").index("scan_age")] for row in rows] == ["24", "n/a"]
    methods = (study.outputs / "logs/CITATION.md").read_text()
    assert "gestational age at scan 24 weeks, of 1 of them not known" in methods
    assert "Surfaces of known age were smoothed" in methods
