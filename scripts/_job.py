"""First step of every script: `job = start(snakemake)`.

The job logs to its rule's log file (libraries that print do so too) and keeps to its rule's threads. If it fails, the
last line of the log is `ERROR reason`, which `cohort_status.tsv` quotes. One that Ctrl-C stops has not failed. If
SIGTERM stops it, as at the end of its time on a cluster, or if it takes longer than `time_limit`, the log shows where
it was. It ends with the Snakemake that started it. If a profile numbers attempts (resource `attempt`), only a job that
was killed is tried again.

A job is saved beside its log, as a file `.job`, until it has succeeded. `python -m pdb scripts/_job.py FILE.job` runs
one that failed or was killed again, with its messages on the terminal. Its log and Snakemake's last messages name the
command.
"""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import gc
import glob
import logging
import os
import runpy
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

# the workflow runs the package it comes with (beside it in a checkout, around it in an installed package), even in a
# conda environment that has another one or none
_folder = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(_folder if (_folder / "cortet").is_dir() else _folder.parents[1]))

from cortet.cohort import receipts, saved_jobs
from cortet.cohort.status import failure_path, was_killed, write_failure
from cortet.errors import CortetError
from cortet.formats import child

logger = logging.getLogger("cortet")


@dataclass(frozen=True)
class Job:
    """What a script needs to know of its job; the first four are Snakemake's."""

    input: Any
    output: Any
    params: Any
    wildcards: Any

    @property
    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of the function that the script calls."""
        return dict(self.params.arguments)

    @property
    def to_mm(self) -> Any:
        """Matrix from the coordinates of the case to mm, or None; InputError if the plan could not determine it."""
        if isinstance(self.params.to_mm, str):
            raise CortetError(self.params.to_mm)
        return self.params.to_mm

    def require_unchanged_input(self) -> None:
        """Raise StageError if a file of the user that the job has read is not the one it was planned with."""
        from cortet.cohort.receipts import require_unchanged

        require_unchanged(self.params.paths, self.params.input_sha256)

    def record(self, report: Mapping[str, Any]) -> dict[str, Any]:
        """The report, with its origin; for files of a case, also with the inputs they were made from and their space.

        Raises
        ------
        StageError
            a file of the user that the job has read is not the one it was planned with
        """
        if self.params.get("paths"):
            self.require_unchanged_input()
        made_from = {"input_sha256": hashes} if (hashes := self.params.get("input_sha256")) is not None else {}
        return {"origin": self.params.origin, **made_from, **self._provenance(), **report}

    def _provenance(self) -> dict[str, object]:
        if "CORTET_OUTPUT" not in os.environ:  # a saved job
            return {}
        from cortet.cohort.bids import Places, provenance

        places = Places(Path(os.environ["CORTET_OUTPUT"]), Path(os.environ["CORTET_RAW"]))
        sources = (path for path in self.input if path != self.input.receipt)
        return provenance(sources, self.params.get("space"), places)


def start(snakemake: Any) -> Job:
    """Prepare the process for a job: log, limits, handling of failures. Call it before Numba is imported."""
    os.environ["NUMBA_NUM_THREADS"] = str(snakemake.threads)  # Numba reads it only once
    atexit.register(gc.freeze)  # the system takes all memory back: looking for garbage in it takes 0.1 s
    if snakemake.log:
        _guard(snakemake)
    _delete_leftovers(snakemake.output)
    return Job(snakemake.input, snakemake.output, snakemake.params, snakemake.wildcards)


def _guard(snakemake: Any) -> None:
    """Tie the job to the Snakemake that started it, to its log and to its limits."""
    # so that files begun by an interrupted run never replace those of a later one
    child.end_with_parent()
    _use_own_temporary_folder()
    log = Path(snakemake.log[0])
    earlier = log.with_name(f".{log.name}.attempt")
    attempt = snakemake.resources.get("attempt", 0)  # 0: not given, and a failure is final
    if attempt > 1:
        _end_useless_attempt(log, earlier)
    _log_to(log)
    sys.excepthook = partial(_log_failure, log, snakemake)
    _keep_receipt(snakemake, log)
    _save(snakemake, log)
    logger.info("%s of %s with %s", snakemake.rule, dict(snakemake.wildcards), dict(snakemake.params))
    if attempt:
        _remember(log, earlier)
    _limit_time()
    faulthandler.register(signal.SIGTERM, file=2, chain=True)


def _save(snakemake: Any, log: Path) -> None:
    """Save the job for a debugger, until it has succeeded; now, as it may be killed; not if the disk is full."""
    script = Path(
        getattr(sys.modules["__main__"], "__file__", None) or ""
    ).name  # Snakemake runs a copy that names its original
    with contextlib.suppress(OSError):
        atexit.register(_forget, saved_jobs.save(script, snakemake, log))


def _run_saved(path: Path) -> None:
    """Run a saved job in this process, in the folder of its study."""
    job, folder = saved_jobs.saved_job(path)
    os.chdir(folder)
    script = Path(__file__).resolve().with_name(job.script)
    runpy.run_path(str(script), init_globals={"snakemake": job.for_debugger()}, run_name="__main__")


def _keep_receipt(snakemake: Any, log: Path) -> None:
    """Say in the receipt that the job has begun, and that it is done once it has succeeded."""
    path = Path(snakemake.input.receipt)
    asked = receipts.begin(path)
    failure_path(log).unlink(missing_ok=True)
    atexit.register(lambda: None if _has_failed() else receipts.finish(path, asked))


def _use_own_temporary_folder() -> None:
    """Give the job a folder for temporary files that is deleted when the job ends, even if it is killed.

    A shell waits for the end of a pipe whose other end only this process holds, and then deletes the folder.
    """
    folder = tempfile.mkdtemp(prefix="cortet-job-")
    os.environ["TMPDIR"] = tempfile.tempdir = folder
    end, _ = os.pipe()  # the other end is closed when this process ends; programs that it calls do not inherit it
    waiting = ["sh", "-c", 'read -r _; rm -rf "$0"', folder]
    subprocess.Popen(waiting, stdin=end, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    os.close(end)


def _limit_time() -> None:
    """End after `CORTET_TIME_LIMIT` minutes, with the stack in the log, even inside a library that never returns."""
    if minutes := float(os.environ.get("CORTET_TIME_LIMIT", "0")):
        faulthandler.dump_traceback_later(60 * minutes, exit=True)


def _log_to(path: Path) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s", level=logging.INFO)


def _end_useless_attempt(log: Path, earlier: Path) -> None:
    """End a job whose earlier attempt was not killed: another attempt, with more memory, does not help it."""
    if earlier.exists() and not was_killed(earlier):
        shutil.copyfile(earlier, log)
        sys.exit(f"not tried again, the reason stands in {log}")


def _remember(log: Path, earlier: Path) -> None:
    """Keep the log under a second name until the job has succeeded; Snakemake deletes it before another attempt."""
    earlier.unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # a file system without links: every failure is tried again
        os.link(log, earlier)
    atexit.register(_forget, earlier)


def _forget(path: Path) -> None:
    if not _has_failed():
        path.unlink(missing_ok=True)


def _has_failed() -> bool:
    """Whether an exception is ending the interpreter."""
    return hasattr(sys, "last_value")


def _log_failure(
    log: Path, snakemake: Any, kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    if issubclass(kind, KeyboardInterrupt):  # the last line of the log says so
        traceback.print_exception(kind, error, trace)
        return
    with contextlib.suppress(OSError):  # the disk may be full
        write_failure(log, snakemake.rule, dict(snakemake.wildcards), error)
    # before the error, which must be the last line of a log
    if saved_jobs.saved_path(log).exists():
        logger.info("to run it again in a debugger: %s", saved_jobs.debug_command(log, Path(__file__)))
    if isinstance(error, CortetError):
        logger.error("%s", error)
    else:
        traceback.print_exception(kind, error, trace)
        logger.error("%s: %s", kind.__name__, error)


def _delete_leftovers(outputs: Any) -> None:
    """Delete the temporary files of an attempt that was killed (`cortet.formats.atomic` names them)."""
    for output in map(Path, outputs):
        for leftover in output.parent.glob(f".*-*.{glob.escape(output.name)}"):
            shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()


if __name__ == "__main__":
    _run_saved(Path(sys.argv[1]))
