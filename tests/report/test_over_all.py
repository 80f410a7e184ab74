"""Results over all cases, and what they wait for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cortet.over_all import results
from tests.cohort.test_plan import GOOD, MADE, plan


def test_what_says_whether_meshes_are_certified_waits_for_their_certificates() -> None:
    labelled = replace(GOOD, volumes={"tissue": Path("tissue.nii.gz")})
    experiments = {"resolution": {"cell_size": [2.0, 3.0]}, "series": {"cases": "all"}}
    asked = plan(labelled, MADE, experiments=experiments)
    made = results(asked)
    for rule in ("cohort_tables", "tables", "figures"):
        certificates = {path for path in made[rule].inputs() if path.endswith("certificate.json")}
        assert certificates == set(asked.measured_certificates()), rule
    assert set(made["cohort_page"].inputs()) & set(made["cohort_tables"].files), "the page is made of the tables"


def test_a_map_that_failed_is_left_out_of_the_means() -> None:
    resampled = replace(GOOD, sphere=Path("sphere.surf.gii"))
    other = replace(resampled, participant="other")
    failed = {(resampled.name, 2000, "lattice"): {"stage": "case_maps", "state": "failed", "reason": "a hole"}}
    assert list(plan(resampled, other).maps("L")) == [resampled.name, other.name]
    assert list(plan(resampled, other, failures=failed).maps("L")) == [other.name]
