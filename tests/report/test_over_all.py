"""Results over all cases, and what they wait for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cortet.over_all import results
from tests.cohort.test_plan import GOOD, MADE, plan


def test_what_says_whether_meshes_are_certified_waits_for_their_certificates():
    labelled = replace(GOOD, volumes={"tissue": Path("tissue.nii.gz")})
    experiments = {"resolution": {"cell_size": [2.0, 3.0]}, "series": {"cases": "all"}}
    asked = plan(labelled, MADE, experiments=experiments)
    made = results(asked)
    for rule in ("cohort_tables", "tables", "figures"):
        certificates = {path for path in made[rule].inputs() if path.endswith("certificate.json")}
        assert certificates == set(asked.measured_certificates()), rule
    assert set(made["cohort_page"].inputs()) & set(made["cohort_tables"].files), "the page is made of the tables"


def test_means_on_the_common_mesh_are_of_the_maps_that_exist(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    resampled = replace(GOOD, sphere=Path("sphere.surf.gii"))
    other = replace(resampled, participant="other")
    planned = plan(resampled, other).maps("L")
    assert list(planned) == [resampled.name, other.name]
    assert set(planned.values()) <= set(plan(resampled, other).files_of_cases()), "the level group needs them"
    assert list(replace(plan(resampled, other), chosen=frozenset({other.name})).maps("L")) == [other.name]
    made = Path(planned[other.name])
    made.parent.mkdir(parents=True)
    made.touch()
    assert list(replace(plan(resampled, other), failed=[]).maps("L")) == [other.name]
