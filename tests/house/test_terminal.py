"""What a run says on a terminal, from the events of Snakemake."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import threading
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from cortet.cohort.status import began as writes_that_it_began
from cortet.cohort.status import write_failure
from cortet.errors import InputError
from snakemake_logger_plugin_cortet import LogHandler, Progress, end_older_timers

ROOT = Path(__file__).parents[2]
WILDCARDS = {"case": "sub-01_hemi-L", "res": "0600", "mesher": "lattice", "setting": ""}
MESH = "sub-01_hemi-L (0.6 mm)"


def certificate(folder: Path, certified: bool = True) -> Path:
    path = folder / "sub-01_certificate.json"
    reasons = [] if certified else ["worst q is 0.7", "it has a void"]
    record = {"certified": certified, "reasons": reasons, "quality": {"q": {"max": 0.33488}, "tets": 41487}}
    path.write_text(json.dumps(record))
    return path


def progress(meshes: int = 1, jobs: int = 10) -> tuple[Progress, list[float]]:
    """Progress of a planned run, and its clock."""
    now = [0.0]
    run = Progress(clock=lambda: now[0])
    run.planned({"solver_ready": meshes, "total": jobs})
    return run, now


# --- a line for each mesh


@pytest.mark.parametrize(
    ("certified", "said"),
    [
        (True, "certified, worst q 0.335, 41,487 tetrahedra, 1.5 min"),
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


def test_a_fold_is_one_line_with_its_verdict(tmp_path):
    verdict = tmp_path / "verdict.json"
    verdict.write_text(json.dumps({"reason": "folded from 22 to 34 weeks", "gyrification_index_last": 1.2451}))
    run, now = progress()
    assert run.planned({"solver_ready": 2, "fold": 3, "total": 40}) == "2 meshes to make, 3 to fold, 40 jobs"
    run.started(7, "fold", {**WILDCARDS, "variant": "Thin"}, [str(verdict)])
    now[0] = 120.0
    fold = "sub-01_hemi-L (0.6 mm, Thin)"
    assert run.ended(7) == f"{fold}  folded from 22 to 34 weeks; gyrification index 1.25, 2.0 min"


def test_a_job_that_failed_names_its_rule_its_reason_and_its_log(tmp_path):
    log = tmp_path / "repair.log"
    log.write_text("12:00 INFO begins\n")
    writes_that_it_began(log, "repair", WILDCARDS)
    run, _ = progress()
    run.started(1, "repair", WILDCARDS)
    assert "killed" in run.failure(1, str(log))
    write_failure(log, "repair", WILDCARDS, InputError("truncated", file="x.surf.gii"))
    run.started(2, "repair", WILDCARDS)
    assert run.failure(2, str(log)) == f"failed: {MESH} in repair: x.surf.gii: truncated\n  more in {log}"


# --- what Snakemake says


def handler(dryrun: bool = False) -> LogHandler:
    return LogHandler(SimpleNamespace(dryrun=dryrun, verbose=False), None)  # type: ignore[arg-type]


def emit(to: LogHandler, message: str = "", level: int = logging.INFO, path: str = "", **known: Any) -> None:
    record = logging.LogRecord("snakemake", level, path, 0, message, (), None)
    record.__dict__.update(known)
    to.emit(record)


def info(message: str) -> dict[str, Any]:
    return {"message": message}


def error(message: str, **known: Any) -> dict[str, Any]:
    return {"message": message, "level": logging.ERROR, **known}


def planned(**stats: int) -> dict[str, Any]:
    return {"event": LogEvent.RUN_INFO, "stats": stats}


def began(rule: str = "repair", wildcards: dict[str, str] | None = WILDCARDS) -> dict[str, Any]:
    return {"event": LogEvent.JOB_INFO, "jobid": 1, "rule_name": rule, "wildcards": wildcards, "output": []}


def failed(log: str = "x.log", jobid: int = 1) -> dict[str, Any]:
    return {"event": LogEvent.JOB_ERROR, "jobid": jobid, "rule_name": "repair", "log": [log]}


STARTED = {"event": LogEvent.WORKFLOW_STARTED}
GAVE_UP = error("jobs failed", event=LogEvent.ERROR, exception="WorkflowError")
FAILED = [f"failed: {MESH} in repair: it left no word; see its log", "  more in x.log"]
#: records of Snakemake, and the lines that they become
SAID: dict[str, tuple[list[dict[str, Any]], list[str]]] = {
    "errors are said once": (
        [
            planned(solver_ready=1, total=3),
            began(),
            error("long words", event=LogEvent.ERROR, exception="RuleException"),
            failed(),
            failed(),  # by Snakemake 9.0
            error("jobs failed"),
            error("sub-01_hemi-L: repair: it left no log", path="/x/rules/end.smk"),
            GAVE_UP,
        ],
        ["1 mesh to make, 3 jobs", *FAILED],
    ),
    "a run that is stopped has no failures": (
        [
            planned(solver_ready=1, total=3),
            began(),
            {"event": LogEvent.PROGRESS, "done": 1, "total": 3},
            failed("stopped.log"),
            failed(jobid=2),
            GAVE_UP,
        ],
        ["1 mesh to make, 3 jobs", "stopped by you after 1 of 3 jobs; the same command goes on from there"],
    ),
    "nothing to do": (
        [info("Building DAG of jobs..."), STARTED, info("Nothing to be done (all requested files are present).")],
        ["nothing to do: everything is up to date"],
    ),
    "warnings and no remarks": (
        [
            info("Assuming unrestricted shared filesystem usage."),
            STARTED,
            info("Using shell: /usr/bin/bash"),
            planned(total=1),
            {"message": "2 cases without an age", "level": logging.WARNING, "path": "/x/rules/common.smk"},
        ],
        ["1 jobs", "2 cases without an age"],
    ),
}


@pytest.mark.parametrize("case", SAID)
def test_records_become_lines(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("stopped.log").write_text("Traceback (most recent call last):\nKeyboardInterrupt\n")
    writes_that_it_began(Path("stopped.log"), "repair", WILDCARDS)
    records, lines = SAID[case]
    to = handler()
    for record in records:
        emit(to, **record)
    to.close()
    to.close()
    assert capsys.readouterr().out.splitlines() == lines


def test_a_dry_run_names_what_would_be_done_to_each_case(capsys):
    to = handler(dryrun=True)
    jobs = (("repair", {"case": "b"}), ("export", {"case": "a"}), ("export", {"case": "a"}), ("all", None))
    for record in (planned(solver_ready=2, total=5), *(began(*job) for job in jobs), planned(solver_ready=2, total=5)):
        emit(to, **record)
    lines = ["2 meshes to make, 5 jobs", "  a: export (2)", "  b: repair", "  over all cases: all"]
    assert capsys.readouterr().out.splitlines() == lines


# --- the plugin


def test_the_command_snakemake_knows_the_logger_wherever_it_is_started(tmp_path):
    command = [str(Path(sys.executable).with_name("snakemake")), "--logger", "cortet", "--version"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[-300:]


def test_the_plugin_imports_nothing_of_cortet():
    """Snakemake loads it before the Snakefile, which may belong to another checkout."""
    code = "import sys, snakemake_logger_plugin_cortet; print([name for name in sys.modules if name[:6] == 'cortet'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_of_the_timers_of_the_queue_the_last_alone_stays():
    class JobScheduler:
        def look_again(self) -> threading.Timer:
            timer = threading.Timer(60, lambda: self)
            timer.start()
            return timer

    scheduler, other = JobScheduler(), threading.Timer(60, print)
    other.start()
    timers = [scheduler.look_again() for _ in range(3)]
    end_older_timers()
    for timer in timers[:-1]:
        timer.join(5)
    alive = [timer.is_alive() for timer in (*timers, other)]
    for timer in (timers[-1], other):
        timer.cancel()
    assert alive == [False, False, True, True]
    assert find_spec("snakemake.scheduling.job_scheduler"), "where Snakemake has the class of this name"
