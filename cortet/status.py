"""What became of every case of a cohort: one row per mesh that was asked for, and per excluded row of the sheet."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cortet.formats.atomic import write_json
from cortet.tables import write_tsv

#: column -> its explanation, as in a BIDS sidecar
COLUMNS: dict[str, dict[str, Any]] = {
    "case": {"Description": "Name of the case; files begin with it"},
    "cell_size_mm": {"Description": "Cell size h", "Units": "mm"},
    "mesher": {"Description": "Mesher of stage S1"},
    "stage": {"Description": "Last stage reached: the one that failed, or `certify`"},
    "state": {
        "Description": "What became of the case",
        "Levels": {
            "certified": "every number of its certificate is within its limit",
            "uncertified": "meshed, but its certificate says no; exported only if the configuration says so",
            "failed": "a stage refused its input, or broke down",
            "unfinished": "the run ended before the case was done",
            "excluded": "the sheet excludes it",
        },
    },
    "reason": {"Description": "Why the state is not `certified`"},
    "log": {"Description": "Log of the job that failed"},
}


def failure_reason(log: Path, *, since: float) -> str:
    """Why a job failed: the last error in its log, if the log was written after `since` (seconds since the epoch)."""
    lines = []
    if log.exists() and log.stat().st_mtime >= since:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    errors = [number for number, line in enumerate(lines) if " ERROR " in line]
    if not errors:
        return "ended without a message: killed, or out of memory or time"
    first, *more = lines[errors[-1] :]
    return "; ".join([first.partition(" ERROR ")[2], *more])


def status_rows(meshes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the table; what does not apply is missing from a row.

    Parameters
    ----------
    meshes : per mesh `case`; `cell_size_mm` and `mesher` unless excluded; what is known of its failure or exclusion
        (`stage`, `state`, `reason`, `log`); and the path of its `certificate` if it has one, whose no goes before a
        failure
    """
    rows = []
    for mesh in meshes:
        outcome = dict(mesh)
        if certificate := outcome.pop("certificate", None):
            content = json.loads(Path(certificate).read_text(encoding="utf-8"))
            if not content["certified"]:
                outcome |= {"stage": "certify", "state": "uncertified", "reason": "; ".join(content["reasons"])}
            elif "state" not in outcome:
                outcome |= {"stage": "certify", "state": "certified"}
        rows.append(outcome)
    return rows


def write_status(meshes: Sequence[Mapping[str, Any]], *, table: Path, sidecar: Path) -> None:
    """Write the table (TSV) of `status_rows` and the JSON file that explains its columns."""
    write_tsv(status_rows(meshes), list(COLUMNS), table)
    write_json(COLUMNS, sidecar)
