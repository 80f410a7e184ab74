"""What became of every case of a cohort: one row per requested mesh, and one per excluded row of the sheet."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cortet.errors import CortetError, InputError
from cortet.formats.atomic import write_json
from cortet.formats.tables import Column

#: reason of a job that Ctrl-C stopped, which has not failed; the logger plugin knows it, too
STOPPED = "stopped by you"
#: columns of `cohort_status.tsv`
COLUMNS = (
    Column("case", "Name of the case; files begin with it", heading="Case"),
    Column("cell_size_mm", "Cell size h", "mm", heading="h (mm)", form="g"),
    Column("mesher", "Mesher of stage S1", heading="Mesher"),
    Column("stage", "The job that failed or has to run again; `certify` for a mesh with its certificate"),
    Column(
        "state",
        "State of the case",
        levels={
            "certified": "every number of its certificate is within its limit",
            "uncertified": "meshed, but not certified; exported only if the configuration allows it",
            "failed": "a stage refused its input, or failed",
            "unfinished": "the run ended before the case was done",
            "excluded": "the sheet excludes it",
        },
        heading="State",
    ),
    Column("verdict_in_words", "The verdict: how much of the surface repair made, and which limits were relaxed"),
    Column("reason", "Why the case is not certified; for a certified case, remarks"),
    Column("log", "Log of the job that failed, in the output folder"),
)


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
    record: dict[str, Any] = {"stage": rule, "wildcards": dict(wildcards), "made_from": made_from}
    if error is not None:
        record["reason"] = error.what if error.file is None else f"{error.file}: {error.what}"
        record["remedy"] = error.remedy
    path = failure_path(log)
    try:
        write_json(record, path)
    except (OSError, InputError):  # the disk is full; but the file of the job that began has its block
        if not path.exists():
            raise
        with path.open("r+", encoding="utf-8") as file:
            json.dump(record, file)
            file.truncate()


def failure_reason(log: Path) -> str:
    """Why a job ended that left no word: what its log ends with.

    A job that took longer than `time_limit` leaves `Timeout (0:01:00)!` and its stack there (`faulthandler`).
    """
    text = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    if too_long := re.search(r"^Timeout \((.+)\)!$", text, re.MULTILINE):
        return f"took longer than {too_long[1]} (hours:minutes:seconds), the time_limit"
    return "ended without a message: killed, or ran out of memory or time"


def in_words(failure: Mapping[str, Any]) -> str:
    """The reason of a failure, what to do about it if that is known, and where earlier results are."""
    remedy = f" ({failure['remedy']})" if failure.get("remedy") else ""
    earlier = f"; earlier results are in {failure['earlier']}" if "earlier" in failure else ""
    return f"{failure['reason']}{remedy}{earlier}"
