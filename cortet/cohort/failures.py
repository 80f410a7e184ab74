"""`failure.json`: what a job leaves beside its log while it runs, and if it fails or is killed."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.errors import CortetError, InputError, StageError
from cortet.formats.atomic import write_json
from cortet.formats.ownership import json_of

#: reason of a job that Ctrl-C stopped, which has not failed; the logger plugin knows it, too
STOPPED = "stopped by you"


@dataclass(frozen=True)
class Failure:
    """A job that failed or was killed."""

    rule: str
    #: wildcards of the job
    job: Mapping[str, str]
    #: `Jobs.made_from`, when it was planned
    made_from: str
    reason: str
    #: what to do about it; empty if only its log can tell
    remedy: str
    log: Path
    #: whether it left no word, as one that was killed
    is_silent: bool

    def is_about(self, **wildcards: object) -> bool:
        """Whether the job worked for a mesh, as far as its wildcards say: one on a surface works for all its meshes."""
        return all(self.job.get(key, str(value)) == str(value) for key, value in wildcards.items())


def failure_path(log: Path) -> Path:
    """The file that says why the job failed that writes to `log`."""
    return log.with_suffix(".failure.json")


def write_failure(
    log: Path, rule: str, wildcards: Mapping[str, str], made_from: str | None, error: CortetError | None = None
) -> None:
    """Write `failure.json` of a job: of one that begins, which stays if it is killed, or why one failed.

    Parameters
    ----------
    made_from : `Jobs.made_from`; None for a job over all cases
    error : what happened, in which file, and the remedy; None for a job that begins, which deletes the file at its end
    """
    why = error or silent_end(log)
    record: dict[str, Any] = {"stage": rule, "wildcards": dict(wildcards), "made_from": made_from}
    record["reason"] = why.what if why.file is None else f"{why.file}: {why.what}"
    record |= {"remedy": why.remedy, "is_known": error is not None}
    path = failure_path(log)
    try:
        write_json(record, path)
    except (OSError, InputError):  # the disk is full; but the file of the job that began has its block
        if not path.exists():
            raise
        with path.open("r+", encoding="utf-8") as file:
            json.dump(record, file)
            file.truncate()


def failures(output: Path, *, ended: bool) -> list[Failure]:
    """Jobs below an output folder that did not succeed when they last ran.

    Parameters
    ----------
    ended : whether no job is running now; if one may be, only those count that said why they failed
    """
    found = []
    for path in sorted((output / "logs").rglob("*.failure.json")):
        told, log = json_of(path), path.with_name(path.name.replace(".failure.json", ".log"))
        is_known = told.get("is_known", "reason" in told)  # an earlier version gave a job that begins no reason
        if told.get("reason") == STOPPED or not (ended or is_known):
            continue
        if not is_known:
            why = silent_end(log)
            told |= {"reason": why.what, "remedy": why.remedy}
        job = told.get("wildcards", {})
        words = (str(told.get("reason", "")), told.get("remedy") or "")
        found.append(Failure(str(told.get("stage")), job, str(told.get("made_from")), *words, log, not is_known))
    return found


def silent_end(log: Path) -> StageError:
    """Why a job ended that left no word: what its log ends with.

    A job that took longer than `time_limit` leaves `Timeout (0:01:00)!` and its stack there (`faulthandler`).
    """
    remedy = "give the job more memory or time, and run again"
    text = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    if too_long := re.search(r"^Timeout \((.+)\)!$", text, re.MULTILINE):
        return StageError(f"took longer than {too_long[1]} (hours:minutes:seconds), the time_limit", remedy=remedy)
    return StageError("ended without a message: killed, or ran out of memory or time", remedy=remedy)
