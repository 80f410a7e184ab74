"""Nothing under a final name claims to be the result of an input that the sheet no longer names."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from cortet.cohort.sheet import PHANTOM, write_sheet
from cortet.formats import vtu
from cortet.formats.gifti import read_surface, write_fields
from cortet.formats.hashing import sha256
from tests.integration.study import STATUS, Study
from tests.integration.study import surface as study_surface


def results(study: Study, participant: str) -> set[str]:
    """Names of the exported mesh and the certificate of a case, wherever they claim to be its result."""
    files = study.files(f"sub-{participant}/**/*Solver_*")
    return {path.name.rpartition("Solver_")[2] for path in files}


def outdated(study: Study, participant: str) -> Path:
    """The certificate that moved aside."""
    (certificate,) = study.outputs.glob(f"sub-{participant}/outdated/*/mesh/*_certificate.json")
    return certificate


def test_a_certified_case_whose_surface_is_then_damaged_is_certified_no_more(study):
    path = study.case("b").surface
    (certificate,) = study.files("sub-b/**/*certificate.json")
    before = sha256(certificate)
    Path(path).write_bytes(Path(path).read_bytes()[:2000])
    study.jobs_of_run(succeeds=False)
    assert "2 cases: 1 certified, 1 failed" in study.said
    assert results(study, "b") == {"report.html", "thumbnail.webp"}, "of its failure"
    assert sha256(outdated(study, "b")) == before
    row = study.status()["sub-b_hemi-L"]
    assert row["state"] == "failed" and "sub-b/outdated" in row["reason"]
    (page,) = study.files("sub-b/mesh/*Solver_report.html")
    assert "sub-b/outdated" in page.read_text()
    assert "certificate.json" in results(study, "a")


def test_another_surface_gets_a_mesh_of_its_own_and_the_former_one_is_kept(study):
    case = study.case("b")
    Path(case.surface).write_bytes(Path(study.case("a").surface).read_bytes())
    study.jobs_of_run()
    (new,) = study.files("sub-b/mesh/*certificate.json")
    assert json.loads(new.read_text())["input"]["sha256"] == sha256(Path(case.surface))
    assert json.loads(outdated(study, "b").read_text())["input"]["sha256"] != sha256(Path(case.surface))


def test_cases_that_the_sheet_excludes_or_drops_have_no_results(study):
    a, b = study.cases()
    study.write_cases([replace(a, include=False, exclude_reason="motion"), b])
    study.jobs_of_run()
    assert results(study, "a") == set() and outdated(study, "a").exists()
    assert "certificate.json" in results(study, "b")
    study.write_cases([replace(a, include=True)])
    study.jobs_of_run()
    assert "certificate.json" in results(study, "a") and results(study, "b") == set()


def test_a_touched_surface_moves_nothing(study):
    Path(study.case("b").surface).touch()
    study.jobs_of_run()
    assert not list(study.outputs.rglob("outdated"))


def test_results_of_a_surface_that_cannot_be_found_stay(study):
    """Its disk may be missing, and they are still those of the surface that the sheet names."""
    path = Path(study.case("b").surface)
    path.rename(path.with_name("aside"))
    study.jobs_of_run(succeeds=False)
    assert study.status()["sub-b_hemi-L"]["state"] == "failed" and "certificate.json" in results(study, "b")


def test_another_sheet_on_the_same_output_drops_no_case_of_the_first(study):
    study.add_case(study.case("c"), study_surface(2))
    cases = study.cases()
    write_sheet([cases[-1]], study.folder / "other.tsv")
    study.write_cases(cases[:-1])
    study.config["cohort"] = {"sheet": "other.tsv"}
    study.jobs_of_run("meshes")
    assert all("certificate.json" in results(study, name) for name in "abc")


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
    study.config["export"] = {"formats": ["vtu", "abaqus"]}
    study.jobs_of_run("meshes")
    study.config |= {"export": {"formats": ["vtu"]}, "generate": {**study.config["generate"], "seed": 1}}
    assert "2 meshes were made with other settings" in study.run("--dry-run", "meshes").stdout
    study.jobs_of_run("meshes")
    study.jobs_of_run("--forcerun", "certify", "--", "meshes")
    assert not study.files("sub-a/mesh/*.inp") and len(study.files("sub-a/mesh/*Solver_sets.vtu")) == 1


def test_a_phantom_that_failed_and_became_a_file_is_certified(study):
    first, second = study.cases()
    study.write_cases([replace(first, surface=PHANTOM, scan_age=None), second])
    study.run("meshes")
    study.write_cases([first, second])
    study.jobs_of_run(STATUS)
    assert study.status()["sub-a_hemi-L"]["state"] == "certified"
