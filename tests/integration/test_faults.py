"""Bad days: killed, full, read-only, twice at once, hanging. Nothing is lost, and nothing passes for what it is not."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cortet.cohort.lock import NAME
from cortet.config import Config, load
from cortet.formats.gifti import write_surface
from cortet.stages import stages_of
from tests.integration.study import STATUS, Study, is_result, surface

pytestmark = pytest.mark.thorough

SABOTAGE = Path(__file__).parent / "sabotage"
STAGES = [stage.name for stage in stages_of(Config()) if stage.name != "repair"]  # part of the job `gate`
JOBS = (*STAGES, "export")


def sabotaged(study: Study, **plan: list[tuple[str, str]]) -> dict[str, str]:
    """Environment in which jobs are killed, wait or hang: rule and part of the name of its first output."""
    folder = study.folder / "sabotage"
    folder.mkdir(exist_ok=True)
    return {**os.environ, "PYTHONPATH": str(SABOTAGE), "SABOTAGE": json.dumps({"folder": str(folder), **plan})}


def sums(folder: Path, pattern: str = "*") -> dict[str, str]:
    """SHA-256 of every output of a study, by its name."""
    outputs = folder / "derivatives/cortet"
    files = [path for path in outputs.rglob(pattern) if path.is_file() and is_result(path, outputs)]
    files = [path for path in files if path.name != NAME]
    return {str(path.relative_to(outputs)): hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(files)}


def wait_for(path: Path, process: subprocess.Popen[Any]) -> None:
    end = time.time() + 600
    while not path.exists() and time.time() < end and process.poll() is None:
        time.sleep(0.05)
    assert path.exists(), "the job never came there"


def test_every_job_killed_in_its_last_moment_is_done_again_with_the_same_bits(finished, tmp_path):
    study = Study(tmp_path / "study")
    (tmp_path / "study").mkdir()
    study.add_case(study.case("a"), surface(0))
    result = study.run("--retries", "1", "meshes", env=sabotaged(study, kill=[("*", "sub-a")]))
    assert result.returncode == 0, result.stdout + result.stderr
    marks = {path.name.split("-")[1]: path.read_text() for path in (study.folder / "sabotage").glob("kill-*")}
    assert marks == dict.fromkeys(JOBS, "not there")  # though complete under another name
    made = sums(study.folder, "sub-a*")
    assert len(made) > 15 and made.items() <= sums(finished.folder, "sub-a*").items()
    assert not [name for name in sums(study.folder) if "/." in name]


def test_a_twin_whose_jobs_were_killed_has_the_same_bits_after_the_other_stages_and_folded(tmp_path):
    study = Study(tmp_path)
    study.config |= {"resample": {"subdivisions": 3}, "smooth_boundary": {"enabled": True}, "snap": {"enabled": True}}
    study.config["fold"] = {"cases": "all", "force": True, "end": 24.1, "thickness": 3.0}
    egg = surface(0)
    for twin in "ab":
        inner, sphere = (tmp_path / f"surfaces/{twin}_{what}.surf.gii" for what in ("white", "sphere"))
        study.add_case(replace(study.case(twin), inner={"white": inner}, sphere=sphere), egg)
        write_surface(replace(egg, points=0.7 * egg.points), inner)
        write_surface(replace(egg, points=egg.points / np.linalg.norm(egg.points, axis=1)[:, None]), sphere)
    rules = {stage.name for stage in stages_of(load(study.config), nested=True, registered=True)} - {*JOBS, "repair"}
    plan = [*((rule, "sub-a") for rule in rules), ("fold", "")]
    folded = "derivatives/cortet/sub-{0}/simulation/sub-{0}_hemi-L_res-4000um_desc-latticeFolded/fold.tsv"
    targets = ["meshes", *map(folded.format, "ab")]
    result = study.run("--retries", "1", *targets, env=sabotaged(study, kill=plan))
    assert result.returncode == 0, result.stdout + result.stderr
    killed = {path.name.split("-")[1] for path in (study.folder / "sabotage").glob("kill-*")}
    assert killed == rules | {"fold"} and killed > {"separate", "smooth_boundary", "snap", "resample"}
    meshes = {
        name: value
        for name, value in sums(study.folder).items()
        if name.endswith((".vtu", ".gii", ".mesh", "fold.tsv"))
    }
    a, b = (
        {name.replace(f"sub-{twin}", ""): meshes[name] for name in meshes if f"sub-{twin}" in name} for twin in "ab"
    )
    assert len(a) > 15 and a == b


def test_two_runs_on_one_output_and_kill_9_of_snakemake_alone(study, tmp_path):
    before = sums(study.folder, "sub-*")
    study.config["export"] = {"carp_unit": "mm"}  # another parameter, the same result
    environment = sabotaged(study, wait=[("export", "sub-a")])
    first = subprocess.Popen(study.command(), cwd=study.folder, env=environment, stdout=subprocess.DEVNULL, stderr=-3)
    mark = next(iter(f"wait-export-{path.name}" for path in study.files("sub-a*_sets.vtu")))
    wait_for(study.folder / "sabotage" / mark, first)

    for words in ((), ("--dry-run",)):
        again = study.run(*words)
        assert again.returncode != 0 and "another run is writing to" in again.stdout + again.stderr

    (tmp_path / "clone").mkdir()
    clone = Study(tmp_path / "clone", {**study.config, "output": str(study.folder / "derivatives/cortet")})
    clone.config["cohort"] = {"sheet": str(study.folder / "cohort.tsv")}
    words = [word for word in clone.command() if word != "--verbose"]  # which shows Snakemake's own traceback
    other = subprocess.run(words, cwd=clone.folder, capture_output=True, text=True, check=False)
    assert other.returncode != 0
    assert f"another run is writing to this folder: process {first.pid} on" in other.stdout + other.stderr
    assert "Traceback" not in other.stdout + other.stderr

    first.send_signal(signal.SIGKILL)
    first.wait()
    page = study.outputs / "cohort/index.html"
    assert "has not ended. The results below are older" in page.read_text()
    assert {row["state"] for row in study.status().values()} == {"certified"}, "their certificates stay"
    (study.folder / "sabotage/go").touch()  # a job that outlived its Snakemake would now write
    done = study.run()
    assert done.returncode == 0, done.stdout + done.stderr
    assert sums(study.folder, "sub-*") == before
    assert {row["state"] for row in study.status().values()} == {"certified"}
    assert "has not ended" not in page.read_text()
    assert not [path for path in study.files(".*") if path.name not in (NAME, ".bidsignore")]


@pytest.fixture
def small_disk(study: Study) -> Iterator[Path]:
    """The outputs of the study on a file system of their own, which is almost full."""
    outputs = study.folder / "derivatives"
    aside = study.folder / "aside"
    outputs.rename(aside)
    outputs.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", outputs], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"needs to mount a file system: {mounted.stderr.decode().strip()}")
    try:
        subprocess.run(["cp", "-a", f"{aside}/.", outputs], check=True)
        yield outputs
    finally:
        subprocess.run(["umount", "-l", outputs], check=True)


def remount(folder: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", folder], check=True)


def test_a_full_disk_and_one_that_cannot_be_written_to(study, small_disk):
    before = sums(study.folder, "*tetmesh*")
    study.config["export"] = {"formats": ["braingrowth", "abaqus"]}

    remount(small_disk, "ro")
    refused = study.run()
    assert refused.returncode != 0
    assert "is not readable and writable" in refused.stdout + refused.stderr
    assert sums(study.folder, "*tetmesh*") == before

    remount(small_disk, "rw")
    # one job at a time: another one must not find the full disk first
    full = study.run("--cores", "1", env=sabotaged(study, fill=[("export", "sub-a")]))
    assert full.returncode != 0
    # the table of states finds no room either, nor perhaps the end of a log
    assert "sub-a_hemi-L: export: " in full.stdout + full.stderr
    assert "[Errno 28] No space left on device" in full.stdout + full.stderr
    assert before.items() <= sums(study.folder, "*tetmesh*").items()

    for filler in study.files("filler"):
        filler.unlink()
    assert study.run().returncode == 0
    assert before.items() < sums(study.folder, "*tetmesh*").items()
    assert len(study.files("*.inp")) == len(study.cases())
    assert not [path for path in study.files(".*") if path.name not in (NAME, ".bidsignore")]


def test_outputs_that_are_seen_late_are_waited_for(study):
    before = sums(study.folder, "sub-a*")
    study.config["export"] = {"carp_unit": "mm"}  # another parameter, the same result
    done = study.run("--forcerun", "clean", "--", "meshes", env=sabotaged(study, late=[("*", "sub-a")]))
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(list((study.folder / "sabotage").glob("late-*"))) > 3
    assert sums(study.folder, "sub-a*") == before


def test_a_case_that_hangs_and_a_surface_that_was_cut_off_fail_and_the_others_stay(study):
    before = sums(study.folder, "sub-a*")
    study.add_case(study.case("hangs"), surface(2))
    cut = study.folder / "surfaces/b.surf.gii"
    cut.write_bytes(cut.read_bytes()[:3000])
    study.config["time_limit"] = 0.2
    result = study.run(STATUS, env=sabotaged(study, hang=[("gate", "sub-hangs")]))
    assert result.returncode != 0
    status = {case.removeprefix("sub-").removesuffix("_hemi-L"): row for case, row in study.status().items()}
    assert {name: (row["stage"], row["state"]) for name, row in status.items()} == {
        "a": ("certify", "certified"),
        "b": ("gate", "failed"),
        "hangs": ("gate", "failed"),
    }
    assert "as GIfTI" in status["b"]["reason"] and "b.surf.gii" in status["b"]["reason"]
    assert "took longer than 0:00:12" in status["hangs"]["reason"]
    assert "write_json" in (study.outputs / status["hangs"]["log"]).read_text()  # where it was
    assert sums(study.folder, "sub-a*") == before
