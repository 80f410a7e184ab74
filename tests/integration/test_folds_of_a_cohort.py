"""Every case of a cohort is folded, under each variant; a fold that stops is a row and stops no other."""

from __future__ import annotations

import csv
import shutil

import numpy as np
import pytest

from cortet.formats.gifti import read_surface
from tests.integration.study import scaled

pytestmark = pytest.mark.thorough


def test_all_cases_are_folded_under_every_variant(study):
    real = shutil.copy(study.folder / "surfaces/a.surf.gii", study.folder / "real_L.surf.gii")
    study.config["fold"] = {
        "force": True,
        "cases": "all",
        "real_surfaces": {24.2: "real_{hemi}.surf.gii"},
        "end": 24.2,
        "thickness": 3.0,
        "frame_interval": 0.2,
        "surfaces": [24.1],
        "picture": "depth",
        "variants": {
            "wild": {"thickness": 2.0, "growth_rate": 2000.0, "end": 40.0, "record_interval": 0.5, "surfaces": []}
        },
    }
    jobs = study.jobs_of_run()
    assert {("fold", "sub-a"), ("fold", "sub-b"), ("cohort_page", "-")} <= jobs
    with (study.outputs / "cohort/cohort_folding.tsv").open(newline="") as file:
        rows = {(row["case"], row["variant"]): row for row in csv.DictReader(file, delimiter="\t")}
    assert set(rows) == {(f"sub-{name}_hemi-L", variant) for name in "ab" for variant in ("n/a", "wild")}
    states = {key: row["state"] for key, row in rows.items()}
    assert {state for (_, variant), state in states.items() if variant != "wild"} == {"folded"}
    assert {state for (_, variant), state in states.items() if variant == "wild"} == {"inverted"}
    assert float(rows["sub-a_hemi-L", "wild"]["thickness_mm"]) == 2.0
    assert float(rows["sub-a_hemi-L", "n/a"]["thickness_mm"]) == 3.0
    page = (study.outputs / "cohort/index.html").read_text()
    assert page.count("by age") == 4 and "FoldedWild/folding.gif" in page
    home = sorted(study.outputs.glob("sub-*/**/simulation/*Folded/*_week-24.1_*"))
    assert {("folded_surface", "sub-a"), ("folded_surface", "sub-b")} <= jobs and len(home) == 2 * 15
    a = [read_surface(file) for file in home if file.name == "sub-a_hemi-L_week-24.1_white.surf.gii"]
    given = read_surface(study.folder / "surfaces/a.surf.gii")
    assert [np.array_equal(one.faces, given.faces) for one in a] == [True] and (a[0].points != given.points).any()
    assert study.planned_jobs() == set()
    scaled(real, 1.1)
    assert study.planned_jobs() == {("fold_figures", "sub-a"), ("fold_figures", "sub-b")}
