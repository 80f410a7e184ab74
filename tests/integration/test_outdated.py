"""Nothing under a final name claims to be the result of an input that the sheet no longer names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cortet.cohort.sheet import write_sheet
from cortet.formats import vtu
from cortet.formats.gifti import read_surface, write_fields
from tests.integration.study import STATUS
from tests.integration.study import surface as study_surface
from tests.integration.test_reruns import COHORT


def test_cases_that_the_sheet_excludes_or_drops_have_no_results(study):
    a, b = study.cases()
    study.write_cases([replace(a, include=False, exclude_reason="motion"), b])
    assert study.planned_jobs() == COHORT
    assert study.jobs_of_run(STATUS) == {("cohort_tables", "-")}
    assert study.status()["sub-a_hemi-L"]["reason"] == "motion"
    assert study.results("a") == set() and study.outdated("a").exists()
    assert "certificate.json" in study.results("b")
    study.write_cases([replace(a, include=True)])
    study.jobs_of_run(STATUS)
    assert "certificate.json" in study.results("a") and study.results("b") == set()


def test_another_sheet_on_the_same_output_drops_no_case_of_the_first(study):
    study.add_case(study.case("c"), study_surface(2))
    cases = study.cases()
    write_sheet([cases[-1]], study.folder / "other.tsv")
    study.write_cases(cases[:-1])
    study.config["cohort"] = {"sheet": "other.tsv"}
    study.jobs_of_run("meshes")
    assert all("certificate.json" in study.results(name) for name in "abc")


def test_a_field_taken_from_the_sheet_is_taken_from_the_mesh(study):
    first, second = study.cases()
    file = study.folder / "surfaces/a_thickness.shape.gii"
    write_fields({"thickness": np.ones(len(read_surface(Path(first.surface)).points))}, file)
    study.write_cases([replace(first, fields={"thickness": file}), second])
    study.jobs_of_run("meshes")
    (mesh,) = study.files("sub-a/mesh/*Solver_sets.vtu")
    assert "thickness" in vtu.read(mesh).point_data
    study.write_cases([first, second])
    study.jobs_of_run("meshes")
    assert "thickness" not in vtu.read(mesh).point_data


def test_files_of_a_format_that_is_no_longer_asked_for_do_not_stay_beside_another_mesh(study):
    study.write_cases(study.cases()[:1])
    study.config["export"] = {"formats": ["vtu", "abaqus"]}
    study.jobs_of_run("meshes")
    study.config |= {"export": {"formats": ["vtu"]}, "generate": {**study.config["generate"], "seed": 1}}
    assert "meshes with other settings" in study.run("--dry-run", "meshes").stdout
    study.jobs_of_run("meshes")
    study.jobs_of_run("--forcerun", "solver_ready", "--", "meshes")
    assert not study.files("sub-a/mesh/*.inp") and len(study.files("sub-a/mesh/*Solver_sets.vtu")) == 1
