"""Names of files: BIDS-derivative, one for each thing, and none that two jobs share."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cortet.cohort.layout import EXPORTED, WILDCARDS, Layout, beside, file_of, filled
from cortet.cohort.sheet import Case

LAYOUT = Layout("out")
CASE = Case("01", "a", "L", 24.0, Path("x.surf.gii"))
JOB = {"folder": "sub-01/ses-a", "case": "sub-01_ses-a_hemi-L", "res": "600", "mesher": "lattice"}


def test_a_mesh_is_named_by_cell_size_mesher_setting_and_stage():
    here = "out/sub-01/ses-a/mesh/sub-01_ses-a_hemi-L_res-600um"
    assert filled(LAYOUT.mesh("Solver"), JOB) == f"{here}_desc-latticeSolver_tetmesh.vtu"
    assert filled(LAYOUT.mesh("Cleaned"), JOB | {"setting": "Cgal"}) == f"{here}_desc-latticeCgalCleaned_tetmesh.vtu"
    assert filled(LAYOUT.mesh("Generated"), JOB | {"setting": "Cgal"}) == f"{here}_desc-latticeGenerated_tetmesh.vtu"
    assert file_of(LAYOUT.certificate, CASE, 600, "lattice") == f"{here}_desc-latticeSolver_certificate.json"


def test_an_inner_surface_is_named_by_its_region():
    job = JOB | {"inner": "white"}
    here = "out/sub-01/ses-a/anat/sub-01_ses-a_hemi-L"
    assert filled(LAYOUT.surface("gated", inner=True), job) == f"{here}_inner-white_desc-gated_white.surf.gii"
    assert filled(LAYOUT.separated, job) == f"{here}_res-600um_inner-white_desc-separated_white.surf.gii"


@pytest.mark.parametrize(
    ("rule", "wildcards", "name"),
    [
        ("cohort_page", [], "out/logs/cohort_page.log"),
        ("gate", ["case", "folder"], "out/logs/gate/{folder}/{case}.log"),
        ("gate_inner", ["case", "folder", "inner"], "out/logs/gate_inner/{folder}/{case}_inner-{inner}.log"),
        (
            "clean",
            ["case", "folder", "mesher", "res", "setting"],
            "out/logs/clean/{folder}/{case}_res-{res}um_desc-{mesher}{setting}.log",
        ),
        ("reference", ["reference"], "out/logs/reference/reference-{reference}.log"),
    ],
)
def test_a_log_is_named_by_all_wildcards_of_its_job(rule, wildcards, name):
    assert LAYOUT.log(rule, wildcards) == name
    assert set(re.findall(r"\{(\w+)\}", name)) == set(wildcards)
    assert LAYOUT.log(rule, wildcards, kind="tsv") == name.replace("logs", "benchmarks").replace(".log", ".tsv")


def test_wildcards_match_what_names_are_made_of():
    for name, text in (JOB | {"inner": "white"}).items():
        assert re.fullmatch(WILDCARDS[name], text)
    assert not re.fullmatch(WILDCARDS["case"], "sub-01_hemi-X") and not re.fullmatch(WILDCARDS["res"], "0600")


def test_exports_never_take_the_name_of_a_stages_mesh():
    assert "tetmesh.vtu" not in EXPORTED and len(set(EXPORTED.values())) == len(EXPORTED)


def test_a_page_links_to_files_from_where_it_lies():
    assert beside("out/sub-01/mesh/x.html", "out/cohort/index.html") == "../sub-01/mesh/x.html"
