"""What a run says on a terminal: a line for each mesh and each fold."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cortet.errors import counted
from snakemake_logger_plugin_cortet import Progress

ROOT = Path(__file__).parents[2]
WILDCARDS = {"case": "sub-01_hemi-L", "res": "0600", "mesher": "lattice", "setting": ""}
MESH = "sub-01_hemi-L (0.6 mm)"


def certificate(folder: Path, certified: bool = True) -> Path:
    path = folder / "sub-01_certificate.json"
    reasons = [] if certified else ["worst q is 0.7", "it has a void"]
    verdict = "certified, 7 % of the surface repaired" if certified else "NOT certified"
    record = {
        "certified": certified,
        "verdict": verdict,
        "reasons": reasons,
        "quality": {"q": {"max": 0.33488}, "tets": 41487},
    }
    path.write_text(json.dumps(record))
    return path


def progress(meshes: int = 1, jobs: int = 10) -> tuple[Progress, list[float]]:
    """Progress of a planned run, and its clock."""
    now = [0.0]
    run = Progress(clock=lambda: now[0])
    run.planned({"solver_ready": meshes, "total": jobs})
    return run, now


@pytest.mark.parametrize(
    ("certified", "said"),
    [
        (True, "certified, 7 % of the surface repaired, worst q 0.335, 41,487 tetrahedra, 1.5 min"),
        (False, "NOT certified: worst q is 0.7; it has a void; worst q 0.335, 41,487 tetrahedra, 1.5 min"),
    ],
)
def test_a_mesh_is_one_line_with_its_verdict(tmp_path, certified, said):
    run, now = progress()
    run.started(1, "repair", WILDCARDS)
    now[0] = 60.0
    assert not run.ended(1)
    run.started(2, "solver_ready", WILDCARDS, [str(certificate(tmp_path, certified))])
    now[0] = 90.0
    ended = run.ended(2)
    assert ended.startswith(f"1/1  {MESH}  ") and ended.endswith(said)
    run.started(3, "export", WILDCARDS)
    told = run.failure(3, str(tmp_path / "export.log"))
    assert told.startswith(f"failed: {MESH} in export") if certified else told == "", "that it is not exported follows"


def test_meshes_that_a_checkpoint_adds_are_counted(tmp_path):
    run, _ = progress(meshes=1)
    told = []
    for number in (1, 2):
        run.started(number, "solver_ready", WILDCARDS, [str(certificate(tmp_path, certified=True))])
        told.append(run.ended(number))
    assert [line[:3] for line in told] == ["1/1", "2/2"]


def test_a_fold_is_one_line_with_its_verdict(tmp_path):
    verdict = tmp_path / "verdict.json"
    verdict.write_text(json.dumps({"reason": "folded from 22 to 34 weeks", "gyrification_index_last": 1.2451}))
    run, now = progress()
    assert run.planned({"solver_ready": 2, "fold": 3, "total": 40}) == "2 meshes to make, 3 to fold, 40 jobs"
    fold = "sub-01_hemi-L (0.6 mm, Thin)"
    begun = run.started(7, "fold", {**WILDCARDS, "variant": "Thin"}, [str(verdict)])
    assert begun == f"{fold}  folding begins; its log says how far it is"
    now[0], run.jobs = 120.0, (39, 40)
    assert not run.left(), "folds take longer than all other jobs"
    assert run.ended(7) == f"{fold}  folded from 22 to 34 weeks; gyrification index 1.25, 2.0 min"


def test_one_is_not_counted_in_the_plural():
    assert counted(1, "open edge") == "1 open edge"
    assert counted(np.count_nonzero([True]), "node belongs", "nodes belong") == "1 node belongs"
    assert counted(1234, "vertex", "vertices") == "1,234 vertices" and counted(0, "hole") == "0 holes"


def test_a_run_that_ends_early_without_a_failure_says_how_to_go_on(tmp_path):
    """After SIGINT to Snakemake alone, whose jobs end well, the last line was "At least one job did not complete"."""
    run, _ = progress()
    run.started(1, "gate", WILDCARDS)
    run.ended(1)
    run.jobs = (1, 10)
    assert run.ending() == "stopped though no job failed after 1 of 10 jobs; the same command goes on from there"
    run.started(2, "generate", WILDCARDS)
    run.failure(2, str(tmp_path / "generate.log"))
    assert not run.ending(), "why is said already"
    run.jobs = (10, 10)
    assert not progress()[0].ending()


def test_the_plugin_imports_nothing_of_cortet():
    """Snakemake loads it before the Snakefile, which may belong to another checkout."""
    code = "import sys, snakemake_logger_plugin_cortet; print([name for name in sys.modules if name[:6] == 'cortet'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
