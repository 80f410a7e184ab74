"""`keep_intermediates: false` leaves the last mesh of every case, and still only what changed runs again."""

from __future__ import annotations

import pytest

from tests.integration.study import scaled
from tests.integration.test_reruns import COHORT, FROM_GATE, jobs

pytestmark = pytest.mark.thorough

FROM_GENERATE = FROM_GATE - {"gate", "smooth_surface"}


def test_without_intermediates_only_what_changed_runs_again(study):
    study.config["keep_intermediates"] = False
    assert study.planned_jobs() == set()
    deleted = study.run("--delete-temp-output")
    assert deleted.returncode == 0, deleted.stdout + deleted.stderr
    assert len(study.files("*_tetmesh.vtu")) == len(study.files("*Solver_tetmesh.vtu")) == 2
    assert study.planned_jobs() == set()

    study.config["clean"] = {"thresholds": [0.65]}
    assert study.planned_jobs() == jobs(FROM_GENERATE, "a", "b") | COHORT
    del study.config["clean"]

    first, second = study.files("*_sets.vtu")
    before = first.read_bytes(), second.read_bytes()
    scaled(study.folder / "surfaces/a.surf.gii", 1.05)
    assert study.jobs_of_run() == jobs(FROM_GATE, "a") | COHORT
    assert first.read_bytes() != before[0] and second.read_bytes() == before[1]
    assert len(study.files("*_tetmesh.vtu")) == 2
    assert study.planned_jobs() == set()
