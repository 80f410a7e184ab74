"""Results over all cases, and what they wait for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cortet.study.over_all import OverAll
from tests.unit.test_plan import GOOD, MADE, plan


def test_a_result_that_leaves_out_meshes_without_a_certificate_waits_for_the_certificates() -> None:
    labelled = replace(GOOD, volumes={"tissue": Path("tissue.nii.gz")})
    asked = plan(labelled, MADE)
    results = OverAll(asked)
    for rule in ("cohort_quality", "cohort_stages", "cohort_tissues", "cohort_maps_L", "citation", "methods"):
        assert set(asked.measured_certificates()) <= set(results[rule].inputs()), rule
