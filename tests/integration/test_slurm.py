"""The workflow through a SLURM of its own, where one is installed: the same files, and retries that make sense."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
from importlib.util import find_spec

import pytest

from tests.integration.study import ROOT, Study

PROGRAMS = ("slurmctld", "slurmd", "slurmdbd", "munged", "mariadbd")
missing = [name for name in PROGRAMS if not shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin:/sbin")]
if not find_spec("snakemake_executor_plugin_slurm"):
    missing.append("snakemake-executor-plugin-slurm")
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}"),
]

#: Snakemake that looks at its jobs every second, where the plugin waits ten seconds longer after each look in vain
IMPATIENT = """
import asyncio
from snakemake.cli import main
from snakemake_interface_executor_plugins.executors.remote import RemoteExecutor
RemoteExecutor.sleep = lambda executor: asyncio.sleep(1)
main()
"""


def hashes(study: Study) -> dict[str, str]:
    """SHA-256 of every output of the good case."""
    root = study.folder / "derivatives/cortet"
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.glob("sub-a/**/*"))
        if path.is_file()
    }


def test_slurm_makes_the_same_files_and_tries_a_failed_job_again(finished, tmp_path):
    study = Study(tmp_path / "study")
    shutil.copytree(finished.folder / "surfaces", study.folder / "surfaces")
    bad = study.folder / "surfaces/c.surf.gii"
    bad.write_text("no surface")
    study.write_cases([study.case(participant) for participant in "ac"])
    arguments = study.command()
    arguments[1:3] = ["-c", IMPATIENT]
    arguments[arguments.index("--cores") :] = ["--profile", str(ROOT / "profiles/slurm")]
    arguments += ["--slurm-init-seconds-before-status-checks", "2"]
    columns = {"SLURM_COLUMNS": "JobID,State,Comment%-80"}
    result = subprocess.run(
        [str(ROOT / "tools/slurm.sh"), *arguments],
        cwd=study.folder,
        env={**os.environ, **columns},
        capture_output=True,
        text=True,
        check=False,
    )
    if "NODELIST" not in result.stdout:
        pytest.skip(f"SLURM does not start on this machine: {result.stderr.strip().splitlines()[-1:]}")
    states = re.findall(r"^\d+ +(\w+) +rule_", result.stdout, flags=re.MULTILINE)
    assert result.returncode == 1, result.stdout + result.stderr
    assert {case: row["state"] for case, row in study.status().items()} == {
        "sub-a_hemi-L": "certified",
        "sub-c_hemi-L": "failed",
    }
    assert "as GIfTI" in study.status()["sub-c_hemi-L"]["reason"]
    assert hashes(study) == hashes(finished)
    # the case in three jobs (S1 is not measured here), and the bad one, three times
    assert sorted(states) == ["COMPLETED"] * 3 + ["FAILED"] * 3
