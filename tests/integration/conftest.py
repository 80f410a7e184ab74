"""A tiny cohort, meshed once; every test works on its own copy of the result."""

from __future__ import annotations

import fcntl
import shutil
from pathlib import Path

import pytest

from tests.integration.study import Study, surface


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Study:
    """Two cases, `a` and `b`, run to their end: once for all processes that run tests."""
    folder = tmp_path_factory.getbasetemp()
    folder = (folder if worker_id == "master" else folder.parent) / "finished"
    folder.mkdir(exist_ok=True)
    study = Study(folder)
    with (folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # the process that comes second waits for the first
        if not (folder / ".done").exists():
            for seed, participant in enumerate("ab"):
                study.add_case(study.case(participant), surface(seed))
            result = study.run()
            assert result.returncode == 0, result.stdout + result.stderr
            (folder / ".done").touch()
    return study


@pytest.fixture
def study(finished: Study, tmp_path: Path) -> Study:
    """A copy of the finished study, with the times of its files."""
    shutil.copytree(finished.folder, tmp_path / "study")
    return Study(tmp_path / "study")
