"""What became of every case of a cohort: one row per requested mesh, and one per excluded row of the sheet."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cortet.errors import CortetError
from cortet.formats.atomic import write_json
from cortet.formats.ownership import json_of
from cortet.formats.tables import Column

#: parts of every certificate
_PARTS = {
    **dict.fromkeys(("reasons", "remarks", "regions"), list),
    **dict.fromkeys(("quality", "parameters", "reports"), dict),
}
#: reason of a job that Ctrl-C stopped, which has not failed; the logger plugin knows it, too
STOPPED = "stopped by you"
#: columns of `cohort_status.tsv`
COLUMNS = (
    Column("case", "Name of the case; files begin with it", heading="Case"),
    Column("cell_size_mm", "Cell size h", "mm", heading="h (mm)", form="g"),
    Column("mesher", "Mesher of stage S1", heading="Mesher"),
    Column("stage", "Last stage reached: the one that failed, or `certify`"),
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
    Column("verdict", "The verdict in words: how much of the surface repair made, and which limits were relaxed"),
    Column("reason", "Why the case is not certified; for a certified case, remarks"),
    Column("log", "Log of the job that failed, in the output folder"),
)


def failure_path(log: Path) -> Path:
    """The file that says why the job failed that writes to `log`."""
    return log.with_suffix(".failure.json")


def write_failure(
    log: Path, rule: str, wildcards: Mapping[str, str], made_from: str | None, error: BaseException | None = None
) -> None:
    """Write `failure.json` of a job: of one that begins, which stays if it is killed, or why one failed.

    Parameters
    ----------
    made_from : `Jobs.made_from`; None for a job over all cases
    error : what happened, in which file, and the remedy; None for a job that begins, which deletes the file at its end
    """
    record: dict[str, Any] = {"stage": rule, "wildcards": dict(wildcards), "made_from": made_from}
    if error is not None:
        told = error if isinstance(error, CortetError) else CortetError(f"{type(error).__name__}: {error}")
        record["reason"] = told.what if told.file is None else f"{told.file}: {told.what}"
        record["remedy"] = told.remedy
    write_json(record, failure_path(log))


def failure_reason(log: Path) -> str:
    """Why a job ended that left no word: what its log ends with.

    A job that took longer than `time_limit` leaves `Timeout (0:01:00)!` and its stack there (`faulthandler`).
    """
    text = log.read_text(encoding="utf-8", errors="replace") if log.exists() else ""
    if too_long := re.search(r"^Timeout \((.+)\)!$", text, re.MULTILINE):
        return f"took longer than {too_long[1]} (hours:minutes:seconds), the time_limit"
    return "ended without a message: killed, or ran out of memory or time"


def certificate_of(path: str | Path) -> dict[str, Any]:
    """Content of a certificate; empty if it is missing, damaged, edited, or of a version without `schema`.

    A verdict that does not follow from the checks beside it was edited, and so was a part of another form.
    """
    content = json_of(Path(path))
    checks = content.get("checks")
    if "schema" not in content or not isinstance(checks, list) or not all(isinstance(one, dict) for one in checks):
        return {}
    follows = content.get("certified") is all(check.get("passed") for check in checks)
    whole = all(isinstance(content.get(key), kind) for key, kind in _PARTS.items())
    return content if follows and whole and {"worst_q"} <= {check.get("id") for check in checks} else {}


def verdict_of(content: Mapping[str, Any]) -> str:
    """The verdict of a certificate in words; certificates of earlier versions hold only whether there is one."""
    return str(content.get("verdict") or ("certified" if content["certified"] else "NOT certified"))


def in_words(failure: Mapping[str, Any]) -> str:
    """The reason of a failure, and what to do about it if that is known."""
    remedy = failure.get("remedy")
    return f"{failure['reason']} ({remedy})" if remedy else str(failure["reason"])


def status_rows(meshes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the table, one per mesh; a row lacks the columns that do not apply to it.

    Parameters
    ----------
    meshes : `States.status`. A mesh that is not certified is `uncertified`, even if a later step failed, too
    """
    return [_row(mesh) for mesh in meshes]


def _row(mesh: Mapping[str, Any]) -> dict[str, Any]:
    row = {column: value for column, value in mesh.items() if column not in ("certificate", "earlier", "remedy")}
    if "reason" in row:
        row["reason"] = in_words(mesh)
    if "certificate" in mesh:
        content = certificate_of(mesh["certificate"])
        if not content["certified"]:
            row |= {"stage": "certify", "state": "uncertified", "reason": "; ".join(content["reasons"])}
        elif "state" not in row:
            row |= {"stage": "certify", "state": "certified", "reason": "; ".join(content.get("remarks", ()))}
        row["verdict"] = verdict_of(content)
    elif "earlier" in mesh:
        row["reason"] += f"; earlier results are in {mesh['earlier']}"
    return row
