"""What every script does first: importing this module prepares the job.

The job logs to its rule's log file (libraries that print do so too), keeps to its rule's threads, and when it fails
leaves a last line `ERROR reason` there, which `cohort_status.tsv` quotes. Stopped by SIGTERM, as at the end of its time
on a cluster, or ended because it takes longer than `time_limit`, it leaves the place where it was. It ends with the
Snakemake that started it. Where a profile numbers attempts (resource `attempt`), only a job that was killed is tried
again. Import it before anything of cortet: Numba reads its number of threads once.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import faulthandler
import glob
import logging
import os
import shutil
import signal
import sys
import traceback
from pathlib import Path
from types import TracebackType
from typing import Any

import __main__

# what Snakemake puts into the script: input, output, params, log, ...
snakemake: Any = __main__.snakemake

os.environ["NUMBA_NUM_THREADS"] = str(snakemake.threads)
# the workflow runs the package beside it, also in a conda environment that has another one or none
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cortet.errors import CortetError  # noqa: E402

logger = logging.getLogger("cortet")


def _end_with_snakemake() -> None:
    """Die when the parent dies, so that what an interrupted run began never replaces what a later one made (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG, man 2 prctl


def _limit_time() -> None:
    """End after this many minutes, with the stack in the log, also inside a library that never returns."""
    if minutes := float(os.environ.get("CORTET_TIME_LIMIT", "0")):
        faulthandler.dump_traceback_later(60 * minutes, exit=True)


def _log_to(path: Path) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s", level=logging.INFO)
    logger.info("%s of %s with %s", snakemake.rule, dict(snakemake.wildcards), dict(snakemake.params))


def _end_hopeless_attempt(log: Path, earlier: Path) -> None:
    """Another attempt, with more memory, is no help to a job that was not killed."""
    from cortet.status import was_killed

    if earlier.exists() and not was_killed(earlier):
        shutil.copyfile(earlier, log)
        sys.exit(f"not tried again, the reason stands in {log}")


def _remember(log: Path, earlier: Path) -> None:
    """Keep the log, which Snakemake deletes before it tries again, under a second name until the job has succeeded."""
    earlier.unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # a file system without links: every failure is tried again
        os.link(log, earlier)
    atexit.register(_forget, earlier)


def _forget(earlier: Path) -> None:
    if not hasattr(sys, "last_value"):  # which the interpreter sets when an exception ends it
        earlier.unlink(missing_ok=True)


def _log_failure(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if isinstance(error, CortetError):
        logger.error("%s", error)
    else:
        traceback.print_exception(kind, error, trace)
        logger.error("%s: %s", kind.__name__, error)


def _delete_leftovers() -> None:
    """Delete the temporary files of an attempt that was killed (`cortet.formats.atomic` names them)."""
    for output in map(Path, snakemake.output):
        for leftover in output.parent.glob(f".*-*.{glob.escape(output.name)}"):
            shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()


_end_with_snakemake()
_log = Path(snakemake.log[0])
_earlier = _log.with_name(f".{_log.name}.attempt")
# 0: it is not said, and a failure is final
_attempt = snakemake.resources.get("attempt", 0)
if _attempt > 1:
    _end_hopeless_attempt(_log, _earlier)
_log_to(_log)
if _attempt:
    _remember(_log, _earlier)
_limit_time()
faulthandler.register(signal.SIGTERM, file=2, chain=True)
sys.excepthook = _log_failure
_delete_leftovers()


def parameters() -> dict[str, Any]:
    """Arguments of the stage function: the rule's `stage` parameter without the version, which Snakemake compares."""
    return {key: value for key, value in snakemake.params.stage.items() if key != "version"}
