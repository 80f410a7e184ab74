"""What every script of the workflow begins with: `job = start(snakemake)`.

A job writes everything to its log. While it runs, and if it fails, a file beside the log says so
(`cortet.cohort.failures`); a job that succeeds deletes it. To run a job again in a debugger, let Snakemake keep its
script, which holds the job: `snakemake --cores 1 --skip-script-cleanup FILE`, then
`python -m pdb -c continue .snakemake/scripts/*.gate.py`.
"""

from __future__ import annotations

import atexit
import faulthandler
import gc
import glob
import hashlib
import logging
import os
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

# the workflow runs the package it comes with (beside it in a checkout, around it in an installed package), even in a
# conda environment that has another one or none
_folder = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(_folder if (_folder / "cortet").is_dir() else _folder.parents[1]))

from cortet.cohort.failures import STOPPED, failure_path, write_failure
from cortet.errors import CortetError
from cortet.formats import child
from cortet.formats.ownership import delete_abandoned

if TYPE_CHECKING:
    from cortet.formats.electrodes import Contact
    from cortet.meshes import TriSurface
    from cortet.stages.stage import State

logger = logging.getLogger("cortet")


@dataclass(frozen=True)
class Job:
    """What a script needs to know of its job: parts of Snakemake's job."""

    input: Any
    output: Any
    params: Any
    wildcards: Any

    def state(self) -> State:
        """The mesh of the job, the surface that was meshed with its inner ones, and its fields, where it has them."""
        from cortet.formats import gifti, vtu
        from cortet.stages.stage import State

        surface = gifti.read_nested(self.input.surface, self.input.inner, self.input.get("fields"))
        return State(surface, mesh=vtu.read(self.input.mesh)) if self.input.get("mesh") else State(surface)

    def contacts(self, surface: TriSurface) -> tuple[Contact, ...]:
        """The contacts of electrodes of the case, in the coordinates of the surface that is meshed."""
        from cortet.formats.electrodes import contacts_of

        file = self.params.get("paths", {}).get("electrodes")
        return contacts_of(file, surface.frame, self.params.to_mm) if file else ()

    def through(self, state: State, **known: Any) -> tuple[State, dict[str, dict[str, Any]]]:
        """Take a state through the stages of the job; returns also their reports by stage. `known` is about it."""
        from cortet.config import Config
        from cortet.stages import STAGES
        from cortet.stages.stage import About

        reports = {}
        for name, step in self.params.steps.items():
            about = About(**step["about"], **known)
            state, reports[name] = STAGES[name].run(state, Config(**step["settings"]), about)
        return state, reports

    def require_unchanged_input(self) -> None:
        """Raise StageError if a file of the user that the job has read is not the one it was planned with."""
        from cortet.cohort.user_files import require_unchanged

        require_unchanged(self.params.get("paths", {}), self.params.input_sha256)

    def record(self, report: Mapping[str, Any]) -> dict[str, Any]:
        """The report, with its origin, the inputs that its file was made from, and their space.

        Raises
        ------
        StageError
            a file of the user that the job has read is not the one it was planned with
        """
        from cortet.cohort.bids import Places, provenance

        self.require_unchanged_input()
        places = Places(*map(Path, self.params.roots))
        about = {"origin": self.params.origin, "input_sha256": self.params.input_sha256}
        about |= {"made_from": self.params.made_from} if self.params.get("made_from") else {}
        return {**about, **provenance(self.input, self.params.get("space"), places), **report}


def start(snakemake: Any) -> Job:
    """Prepare the process for a job: log, limits, handling of failures. Call it before Numba is imported."""
    os.environ["NUMBA_NUM_THREADS"] = str(snakemake.threads)  # Numba reads it only once
    atexit.register(gc.freeze)  # the system takes all memory back: looking for garbage in it takes 0.1 s
    log = Path(snakemake.log[0])
    child.end_with_parent()  # so that files begun by an interrupted run never replace those of a later one
    _use_own_temporary_folder(log)
    made_from = snakemake.params.get("made_from")
    tell = partial(write_failure, log, snakemake.rule, dict(snakemake.wildcards), made_from)
    sys.excepthook = partial(_log_failure, tell)  # before there is a log: who sees one may press Ctrl-C
    if "pdb" not in sys.modules:  # a debugger has the terminal
        _log_to(log)
    tell()
    atexit.register(_forget, failure_path(log))
    logger.info("%s of %s with %s", snakemake.rule, dict(snakemake.wildcards), dict(snakemake.params))
    if seconds := snakemake.resources.get("time_limit", 0):
        # with the stack in the log, even inside a library that never returns
        faulthandler.dump_traceback_later(seconds, exit=True)
    faulthandler.register(signal.SIGTERM, file=2, chain=True)
    for output in map(Path, snakemake.output):  # what an attempt that was killed has left
        delete_abandoned(output.parent, glob.escape(output.name))
    return Job(snakemake.input, snakemake.output, snakemake.params, snakemake.wildcards)


def _use_own_temporary_folder(log: Path) -> None:
    """Give the job a folder for temporary files; another attempt deletes what one that was killed has left there."""
    name = hashlib.sha256(os.fsencode(log.absolute())).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / f"cortet-job-{os.getuid()}-{name}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    os.environ["TMPDIR"] = tempfile.tempdir = str(folder)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)


def _log_to(path: Path) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s", level=logging.INFO)


def _forget(path: Path) -> None:
    """Delete a file unless an exception is ending the interpreter."""
    if not hasattr(sys, "last_value"):
        path.unlink(missing_ok=True)


def _log_failure(
    tell: Callable[..., None], kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    if issubclass(kind, KeyboardInterrupt):
        error = CortetError(STOPPED)
    elif not isinstance(error, CortetError):
        traceback.print_exception(kind, error, trace)
        error = CortetError(": ".join(filter(None, (kind.__name__, str(error)))))
    logger.error("%s", error)
    tell(error=error)
