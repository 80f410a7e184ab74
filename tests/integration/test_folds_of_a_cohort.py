"""Every case of a cohort is folded, under each variant; a fold that stops is a row and stops no other."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import nibabel as nib
import numpy as np

from cortet.formats.gifti import read_fields, read_surface, write_surface
from cortet.meshes import TriSurface
from tests.integration.study import Study, scaled, surface


def test_all_cases_are_folded_under_every_variant(study: Study) -> None:
    real = shutil.copy(study.folder / "surfaces/a.surf.gii", study.folder / "real_L.surf.gii")
    study.config["fold"] = {
        "allow_volume": True,
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
    assert {("fold", "sub-a"), ("fold", "sub-b"), ("cohort_folding", "-"), ("cohort_page", "-")} <= jobs
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


def test_folds_of_cases_with_spheres_make_a_population(study: Study) -> None:
    folder, cases = study.folder / "surfaces", []
    for number, name in enumerate("abcd"):
        egg = surface(number)
        case = replace(study.case(name), surface=folder / f"{name}.surf.gii", sphere=folder / f"{name}.sphere.surf.gii")
        write_surface(egg, Path(case.surface))
        write_surface(
            TriSurface(egg.points / np.linalg.norm(egg.points, axis=1)[:, None], egg.faces), Path(case.sphere)
        )
        cases.append(replace(case, extra={"group": "ab"[number % 2]}))
    study.write_cases(cases)
    study.config |= {
        "resample": {"subdivisions": 3},
        "fold": {"cases": "all", "allow_volume": True, "end": 24.1, "thickness": 3.0, "surfaces": [24.1]},
        "biomarkers": {"model": ["group"], "measures": ["depth", "area_growth"], "permutations": 20},
    }
    jobs = study.jobs_of_run("biomarkers", "methods")
    assert {("common_maps", f"sub-{name}") for name in "abcd"} | {("biomarkers", "-")} <= jobs
    stack = nib.load(study.outputs / "cohort/biomarkers/hemi-L_week-24.1_areagrowth.func.gii")
    assert [array.meta["Name"] for array in stack.darrays] == [f"sub-{name}_hemi-L" for name in "abcd"]
    maps = read_fields(study.outputs / "cohort/biomarkers/hemi-L_week-24.1_areagrowth.shape.gii")
    assert set(maps) == {"mean", "spread", "t_group[b]", "p_group[b]"} and (maps["mean"] > 1).mean() > 0.9
    with (study.outputs / "cohort/biomarkers.tsv").open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    assert len(rows) == 4 * 2 and {row["parcel"] for row in rows} == {"all"}
    said = json.loads((study.outputs / "cohort/biomarkers.json").read_text())
    assert said["Model"]["hemi-L_week-24.1"]["folds"] == 4
    assert study.planned_jobs("biomarkers") == set()
    usual = study.config["biomarkers"]
    for changed, words in (
        ({"model": ["weight"]}, "hemi-L_week-24.1: biomarkers.model: sub-a_hemi-L, .* without a value of weight"),
        ({"parcels": "lobe"}, "biomarkers.parcels: no folded case has the field lobe"),
    ):  # said before anything is folded, and the earlier result is kept
        study.config["biomarkers"] = usual | changed
        refused = study.run("biomarkers")
        assert refused.returncode and re.search(words, refused.stdout + refused.stderr)
        assert (study.outputs / "cohort/biomarkers.tsv").exists()
    study.config["biomarkers"] = usual
    study.jobs_of_run("methods")
    assert "general linear model of group" in (study.outputs / "cohort/methods.md").read_text()
