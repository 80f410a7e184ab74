"""Results over all cases, and what they wait for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cortet.report.over_all import OverAll
from tests.unit.test_plan import GOOD, MADE, plan


def test_a_result_that_leaves_out_meshes_without_a_certificate_waits_for_the_certificates() -> None:
    labelled = replace(GOOD, volumes={"tissue": Path("tissue.nii.gz")})
    asked = plan(labelled, MADE)
    results = OverAll(asked)
    for rule in ("cohort_quality", "cohort_stages", "cohort_tissues", "cohort_maps_L", "citation", "methods"):
        assert set(asked.measured_certificates()) <= set(results[rule].inputs()), rule


def test_what_says_whether_meshes_are_certified_waits_for_their_certificates() -> None:
    experiments = {"resolution": {"cell_size": [2.0, 3.0]}, "series": {"cases": "all"}}
    asked = plan(GOOD, MADE, experiments=experiments)
    results = OverAll(asked)
    for rule in ("table_resolution", "table_measures", "figure_series"):
        certificates = {path for path in results[rule].inputs() if path.endswith("certificate.json")}
        assert certificates == set(asked.measured_certificates()), rule


def test_a_map_that_failed_is_left_out_of_the_means() -> None:
    resampled = replace(GOOD, sphere=Path("sphere.surf.gii"))
    other = replace(resampled, participant="other")
    failed = {(resampled.name, 2000, "lattice"): {"stage": "case_maps", "state": "failed", "reason": "a hole"}}
    assert list(plan(resampled, other).maps("L")) == [resampled.name, other.name]
    assert list(plan(resampled, other, failures=failed).maps("L")) == [other.name]
