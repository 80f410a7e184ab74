"""What became of every case of a cohort: one row per mesh that was asked for, and per excluded row of the sheet."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cortet.formats.atomic import atomic_path, write_json

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
MISSING = "n/a"


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


def status_rows(meshes: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Rows of the table.

    Parameters
    ----------
    meshes : per mesh `case`; `cell_size_mm` and `mesher` unless excluded; and either what is known of its failure
        (`stage`, `state`, `reason`, `log`) or the path of its `certificate`, whose verdict and reasons are the row's
    """
    rows = []
    for mesh in meshes:
        outcome = dict(mesh)
        if certificate := outcome.pop("certificate", None):
            content = json.loads(Path(certificate).read_text(encoding="utf-8"))
            outcome |= {
                "stage": "certify",
                "state": "certified" if content["certified"] else "uncertified",
                "reason": "; ".join(content["reasons"]),
            }
        rows.append({column: _cell(outcome.get(column)) for column in COLUMNS})
    return rows


def write_status(meshes: Sequence[Mapping[str, Any]], table: Path, sidecar: Path) -> None:
    """Write the table (TSV) and the JSON sidecar that explains its columns."""
    with atomic_path(table) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(COLUMNS), delimiter="\t", lineterminator="\n", quoting=csv.QUOTE_NONE)
        writer.writeheader()
        writer.writerows(status_rows(meshes))
    write_json(COLUMNS, sidecar)


def _cell(value: Any) -> str:
    """One cell of a TSV: no tabs, no line ends, never empty."""
    return " ".join(str(value).split()) if value not in (None, "") else MISSING
