"""Plain `snakemake` in a folder of the user, with the package and nothing of its checkout."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from cortet.cli import main
from cortet.cohort.sheet import Case, write_sheet
from cortet.formats.gifti import write_surface
from tests.integration.study import CONFIG, ROOT, STATUS, surface

SNAKEMAKE = [str(Path(sys.executable).with_name("snakemake")), "--cores", "2"]


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A folder with one case, as `cortet workflow` prepares it."""
    assert main(["workflow", str(tmp_path / "study")]) == 0
    write_surface(surface(0), tmp_path / "study/a.surf.gii")
    write_sheet([Case("a", None, "L", 24.0, tmp_path / "study/a.surf.gii")], tmp_path / "study/cohort.tsv")
    return tmp_path / "study"


def snakemake(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [*SNAKEMAKE, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_a_prepared_folder_runs_and_swallows_no_target(study):
    done = snakemake(study, "--dry-run")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "  sub-a_hemi-L: gate, " in done.stdout and "cohort_page" in done.stdout
    done = snakemake(study, "--dry-run", "meshes")
    assert "cohort_page" not in done.stdout and "solver_ready" in done.stdout, done.stdout + done.stderr
    (study / "cohort.tsv").unlink()
    done = snakemake(study, "--dry-run")
    assert "no such sheet (create the sheet: cortet cohort scan DATASET -o cohort.tsv)" in done.stdout + done.stderr


def test_the_named_snakefile_takes_its_configuration_from_the_command(study, capsys):
    assert main(["workflow"]) == 0
    (named,) = capsys.readouterr().out.splitlines()[-1:]
    for file in ("config.yaml", "Snakefile"):
        (study / file).unlink()
    done = snakemake(study, "--snakefile", named, "--dry-run", "meshes", "--config", "cohort={sheet: cohort.tsv}")
    assert done.returncode == 0 and "  sub-a_hemi-L: gate, " in done.stdout, done.stdout + done.stderr


def test_ctrl_c_is_no_failure_and_the_next_run_goes_on(study):
    settings = yaml.safe_load((study / "config.yaml").read_text()) | {"certify": CONFIG["certify"]}
    (study / "config.yaml").write_text(yaml.safe_dump(settings | {"generate": {"cell_size": [2.0]}}))
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    # a shell lets what it runs in the background ignore Ctrl-C, and so these tests and what they start
    command = ["env", "--default-signal=INT", *SNAKEMAKE, "meshes", STATUS]
    with subprocess.Popen(
        command, cwd=study, env=environment, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as run:
        assert run.stdout
        for line in run.stdout:
            if "1 mesh to make" in line:
                break
        # a job has begun when its log is there
        while not list((study / "derivatives/cortet/logs").rglob("*.log")) and run.poll() is None:
            pass
        os.killpg(run.pid, signal.SIGINT)
        said = run.stdout.read().splitlines()
    assert said[-1].startswith("stopped by you after ") and "failed" not in "".join(said), said
    assert said[-2].startswith("1 case: 1 unfinished; ")
    table = (study / STATUS).read_text() if (study / STATUS).exists() else "unfinished"
    assert "unfinished" in table and "failed" not in table

    done = snakemake(study, STATUS)
    assert done.returncode == 0, done.stdout + done.stderr
    state = "1 case: 1 certified (1 with repaired surfaces or relaxed limits)"
    meshes = "derivatives/cortet/sub-*/**/mesh/*Solver_sets.vtu"
    assert done.stdout.splitlines()[-1] == f"{state}; meshes: {meshes}"
