"""A job that has not succeeded lies beside its log, from where it can be run again in a debugger."""

from __future__ import annotations

import os
import pickle
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

#: what scripts use of Snakemake's job; not the configuration or the environment, which may hold secrets
_PARTS = ("rule", "input", "output", "params", "wildcards", "threads")


@dataclass(frozen=True)
class SavedJob:
    """A job as its script saw it: name of the script, its parts of Snakemake's job, its log and working folder."""

    script: str
    parts: dict[str, Any]
    log: Path
    folder: Path

    def for_debugger(self) -> SimpleNamespace:
        """The job without a log, so that a debugger and its messages have the terminal."""
        return SimpleNamespace(**self.parts, log=[])


def saved_path(log: Path) -> Path:
    """Where the job that writes to `log` is saved."""
    return log.with_suffix(".job")


def save(script: str, job: Any, log: Path) -> Path:
    """Save a job of Snakemake beside its log; its file, which only its owner can read."""
    saved = SavedJob(script, {part: getattr(job, part) for part in _PARTS}, log, Path.cwd())
    path = saved_path(log)
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        pickle.dump(saved, file)
    return path


def saved_job(path: Path) -> tuple[SavedJob, Path]:
    """A saved job, and the folder to run it in: the present folder of the study, even if it was moved.

    Like any pickle, the file runs code when it is read: open none that somebody else has made.
    """
    saved: SavedJob = pickle.loads(path.read_bytes())
    return saved, saved.folder if saved.log.is_absolute() else path.resolve().parents[len(saved.log.parts) - 1]


def debug_command(log: Path, runner: Path) -> str:
    """Command that opens the saved job of a log in a debugger, from any folder; `runner` is scripts/_job.py."""
    return shlex.join([sys.executable, "-m", "pdb", str(runner), str(saved_path(log).resolve())])
