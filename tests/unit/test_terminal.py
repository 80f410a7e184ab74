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

from cortet.cohort.plan import AFTER_CERTIFICATE
from snakemake_logger_plugin_cortet import _AFTER, LogHandler, Progress, end_older_timers, mesh_name, reason

ROOT = Path(__file__).parents[2]
WILDCARDS = {"case": "sub-01_hemi-L", "res": "0600", "mesher": "lattice", "setting": ""}


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
    run.planned({"certify": meshes, "total": jobs})
    return run, now


def test_the_command_snakemake_knows_the_logger_wherever_it_is_started(tmp_path: Path) -> None:
    command = [str(Path(sys.executable).with_name("snakemake")), "--logger", "cortet", "--version"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[-300:]


def test_a_certified_mesh_is_one_line_with_its_numbers_and_minutes(tmp_path: Path) -> None:
    run, now = progress()
    run.started(1, "repair", WILDCARDS)
    now[0] = 60.0
    assert not run.ended(1)
    run.started(2, "certify", WILDCARDS, [str(certificate(tmp_path))])
    now[0] = 90.0
    line = run.ended(2)
    assert line == "1/1  sub-01_hemi-L (0.6 mm)  certified, worst q 0.335, 41,487 tetrahedra, 1.5 min"


def test_a_mesh_that_is_not_certified_says_why(tmp_path: Path) -> None:
    run, _ = progress()
    run.started(2, "certify", WILDCARDS, [str(certificate(tmp_path, certified=False))])
    line = run.ended(2)
    assert "not certified" in line and line.endswith(": worst q is 0.7; it has a void")
    run.started(3, "export", WILDCARDS)
    assert run.failed(3, str(tmp_path / "export.log")) == "", "that it is not exported follows"


def test_a_fold_is_one_line_with_its_verdict(tmp_path: Path) -> None:
    verdict = tmp_path / "verdict.json"
    verdict.write_text(json.dumps({"reason": "folded from 22 to 34 weeks", "gyrification_index_last": 1.2451}))
    run, now = progress()
    assert run.planned({"certify": 2, "fold": 3, "total": 40}) == "2 meshes to make, 3 to fold, 40 jobs"
    run.started(7, "fold", {**WILDCARDS, "variant": "Thin"}, [str(verdict)])
    now[0] = 120.0
    assert run.ended(7) == (
        "0/2  sub-01_hemi-L (0.6 mm, Thin)  folded from 22 to 34 weeks; gyrification index 1.25, 2.0 min"
    )


def test_a_job_that_failed_names_its_rule_its_reason_and_its_log(tmp_path: Path) -> None:
    log = tmp_path / "repair.log"
    log.write_text("12:00 INFO begins\n12:01 ERROR x.surf.gii: truncated\n")
    run, _ = progress(meshes=12)
    run.started(1, "repair", WILDCARDS)
    line = run.failed(1, str(log))
    assert line == f" 1/12  sub-01_hemi-L (0.6 mm)  failed in repair: x.surf.gii: truncated\n       more in {log}"
    assert run.failures == {"sub-01_hemi-L"}


def test_a_job_that_fails_after_the_certificate_does_not_count_its_mesh_again(tmp_path: Path) -> None:
    run, _ = progress()
    run.started(1, "certify", WILDCARDS, [str(certificate(tmp_path))])
    run.ended(1)
    run.started(2, "export", WILDCARDS)
    assert run.failed(2, "").startswith("1/1  sub-01_hemi-L (0.6 mm)  failed in export")


def test_a_mesh_of_an_earlier_run_does_not_count_where_its_export_fails() -> None:
    run, _ = progress()
    run.started(1, "export", WILDCARDS)
    assert run.failed(1, "").startswith("0/1  sub-01_hemi-L (0.6 mm)  failed in export")
    assert set(AFTER_CERTIFICATE) == _AFTER  # which the plugin cannot import


@pytest.mark.parametrize("content", [None, "", "begins\n"])
def test_a_job_without_last_words_was_killed(tmp_path: Path, content: str | None) -> None:
    log = tmp_path / "x.log"
    if content is not None:
        log.write_text(content)
    assert reason(str(log)) == ("it left no log" if content is None else "it was killed, or ended without a word")


def test_the_time_that_is_left_follows_from_the_jobs_that_are_done() -> None:
    run, now = progress(jobs=100)
    run.started(1, "repair", WILDCARDS)
    now[0] = 600.0
    assert run.left() == ""
    run.jobs = (20, 100)
    assert run.left() == ", about 40 min left"
    run.jobs = (90, 100)
    assert run.left() == ", about a minute left"
    run.jobs = (99, 100)
    assert run.left() == ", nearly done"
    run.jobs = (100, 100)
    assert run.left() == ""


def test_names_of_meshes() -> None:
    assert mesh_name({"case": "a", "res": "0600", "mesher": "cgal", "setting": "Published"}) == (
        "a (0.6 mm, cgalPublished)"
    )
    assert mesh_name({"case": "a"}) == "a" and mesh_name({}) == ""


def new_handler() -> LogHandler:
    return LogHandler(SimpleNamespace(dryrun=False, verbose=False), None)  # type: ignore[arg-type]


def emit(handler: LogHandler, message: str = "", level: int = logging.INFO, path: str = "", **known: Any) -> None:
    record = logging.LogRecord("snakemake", level, path, 0, message, (), None)
    record.__dict__.update(known)
    handler.emit(record)


def test_errors_of_snakemake_are_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    handler = new_handler()
    emit(handler, event=LogEvent.RUN_INFO, stats={"certify": 1, "total": 3})
    emit(handler, event=LogEvent.JOB_INFO, jobid=1, rule_name="repair", wildcards=WILDCARDS, output=[])
    emit(handler, "long words", logging.ERROR, event=LogEvent.ERROR, exception="RuleException")
    for _ in range(2):  # by Snakemake 9.0
        emit(handler, event=LogEvent.JOB_ERROR, jobid=1, rule_name="repair", log=[str(tmp_path / "x.log")])
    emit(handler, "jobs failed", logging.ERROR)
    emit(handler, "sub-01_hemi-L: repair: it left no log", logging.ERROR, "/x/rules/end.smk")
    emit(handler, "jobs failed", logging.ERROR, event=LogEvent.ERROR, exception="WorkflowError")
    assert capsys.readouterr().out.splitlines() == [
        "1 mesh to make, 3 jobs",
        "1/1  sub-01_hemi-L (0.6 mm)  failed in repair: it left no log",
        f"     more in {tmp_path / 'x.log'}",
    ]


def test_a_dry_run_names_what_would_be_done_to_each_case(capsys: pytest.CaptureFixture[str]) -> None:
    handler = LogHandler(SimpleNamespace(dryrun=True, verbose=False), None)  # type: ignore[arg-type]
    stats = {"certify": 2, "total": 5}
    emit(handler, event=LogEvent.RUN_INFO, stats=stats)
    for rule, known in (("repair", {"case": "b"}), ("export", {"case": "a"}), ("export", {"case": "a"}), ("all", None)):
        emit(handler, event=LogEvent.JOB_INFO, jobid=1, rule_name=rule, wildcards=known, output=[])
    emit(handler, event=LogEvent.RUN_INFO, stats=stats)
    assert capsys.readouterr().out.splitlines() == [
        "2 meshes to make, 5 jobs",
        "  a: export (2)",
        "  b: repair",
        "  over all cases: all",
    ]


def test_a_run_that_is_stopped_has_no_failures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    handler, log = new_handler(), tmp_path / "x.log"
    log.write_text("Traceback (most recent call last):\nKeyboardInterrupt\n")
    emit(handler, event=LogEvent.RUN_INFO, stats={"certify": 1, "total": 3})
    emit(handler, event=LogEvent.JOB_INFO, jobid=1, rule_name="repair", wildcards=WILDCARDS, output=[])
    emit(handler, event=LogEvent.PROGRESS, done=1, total=3)
    emit(handler, event=LogEvent.JOB_ERROR, jobid=1, rule_name="repair", log=[str(log)])
    emit(handler, "Terminating processes on user request, this might take some time.")
    emit(handler, event=LogEvent.JOB_ERROR, jobid=2, rule_name="gate", log=[])
    emit(handler, "jobs failed", logging.ERROR, event=LogEvent.ERROR, exception="WorkflowError")
    handler.close()
    handler.close()
    assert capsys.readouterr().out.splitlines() == [
        "1 mesh to make, 3 jobs",
        "stopped by you after 1 of 3 jobs; the same command goes on from there",
    ]


def test_answers_to_options_of_snakemake_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    handler = new_handler()
    emit(handler, "Lints for rule x (line 4, x.smk):", logging.WARNING, "/x/snakemake/linting/__init__.py")
    emit(handler, "Unlocked working directory.")
    handler.close()
    assert capsys.readouterr().out.splitlines() == ["Lints for rule x (line 4, x.smk):", "Unlocked working directory."]


def test_verbose_is_as_snakemake_says_it(capsys: pytest.CaptureFixture[str]) -> None:
    handler = LogHandler(SimpleNamespace(dryrun=False, verbose=True), None)  # type: ignore[arg-type]
    assert not handler.has_filter and not handler.has_formatter, "so Snakemake adds its own"
    emit(handler, "Building DAG of jobs...")
    assert capsys.readouterr().out == "Building DAG of jobs...\n"


def test_other_errors_of_snakemake_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    handler = new_handler()
    emit(handler, "Building DAG of jobs...")
    emit(handler, "Target rules may not contain wildcards.", logging.ERROR, event=LogEvent.ERROR, exception="X")
    handler.close()
    assert capsys.readouterr().out.splitlines() == ["Target rules may not contain wildcards."]


@pytest.mark.parametrize("kind", ["MissingOutputException", "WorkflowError"])
def test_an_error_that_is_not_about_a_failed_job_is_shown_after_one(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    handler = new_handler()
    emit(handler, event=LogEvent.JOB_INFO, jobid=1, rule_name="repair", wildcards=WILDCARDS, output=[])
    emit(handler, event=LogEvent.JOB_ERROR, jobid=1, rule_name="repair", log=[str(tmp_path / "x.log")])
    emit(handler, "a job needs more memory than there is", logging.ERROR, event=LogEvent.ERROR, exception=kind)
    assert "more memory" in capsys.readouterr().out


def test_a_run_without_jobs_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    handler = new_handler()
    emit(handler, "Building DAG of jobs...")
    emit(handler, event=LogEvent.WORKFLOW_STARTED)
    emit(handler, "Nothing to be done (all requested files are present and up to date).")
    handler.close()
    assert capsys.readouterr().out.splitlines() == ["nothing to do: everything is up to date"]


def test_warnings_are_shown_and_remarks_of_a_run_are_not(capsys: pytest.CaptureFixture[str]) -> None:
    handler = new_handler()
    emit(handler, "Assuming unrestricted shared filesystem usage.")
    emit(handler, event=LogEvent.WORKFLOW_STARTED)
    emit(handler, "Using shell: /usr/bin/bash")
    emit(handler, event=LogEvent.RUN_INFO, stats={"total": 1})
    emit(handler, "2 cases without an age", logging.WARNING, "/x/rules/common.smk")
    handler.close()
    assert capsys.readouterr().out.splitlines() == ["1 jobs", "2 cases without an age"]


def test_a_log_file_says_what_is_running_after_a_minute_of_silence(capsys: pytest.CaptureFixture[str]) -> None:
    handler, now = new_handler(), [0.0]
    handler.progress.clock = lambda: now[0]
    emit(handler, event=LogEvent.RUN_INFO, stats={"total": 40})
    emit(handler, event=LogEvent.JOB_INFO, jobid=1, rule_name="baseline", wildcards=WILDCARDS, output=[])
    for now[0], done in ((50.0, 10), (61.0, 11), (100.0, 12), (122.0, 20)):
        emit(handler, event=LogEvent.PROGRESS, done=done, total=40)
    assert capsys.readouterr().out.splitlines() == [
        "40 jobs",
        "11/40 jobs, about 3 min left  baseline sub-01_hemi-L (0.6 mm)",
        "20/40 jobs, about 2 min left  baseline sub-01_hemi-L (0.6 mm)",
    ]


def test_a_record_that_cannot_be_read_does_not_end_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    handler = new_handler()
    emit(handler, event=LogEvent.JOB_INFO, jobid=1, rule_name="certify", wildcards=WILDCARDS, output=["nosuch.json"])
    emit(handler, event=LogEvent.JOB_FINISHED, job_id=1)
    assert "nosuch.json" in capsys.readouterr().err


def test_the_plugin_imports_nothing_of_cortet() -> None:
    """Snakemake loads it before the Snakefile, which may belong to another checkout."""
    code = (
        "import sys, snakemake_logger_plugin_cortet; print([name for name in sys.modules if name.startswith('cortet')])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_of_the_timers_of_the_queue_the_last_alone_stays() -> None:
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
