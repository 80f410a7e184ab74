"""A tiny cohort, meshed once; every test works on its own copy of the result."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.integration.study import Study, surface


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """Two cases, `a` and `b`, run to their end."""
    study = Study(tmp_path_factory.mktemp("finished"))
    for seed, participant in enumerate("ab"):
        study.add_case(study.case(participant), surface(seed))
    result = study.run()
    assert result.returncode == 0, result.stdout + result.stderr
    return study


@pytest.fixture
def study(finished: Study, tmp_path: Path) -> Study:
    """A copy of the finished study, with the times of its files."""
    shutil.copytree(finished.folder, tmp_path / "study")
    return Study(tmp_path / "study")
