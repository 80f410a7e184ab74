"""The status table: one row per mesh, and a reason that is never an earlier run's."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

from cortet.status import COLUMNS, failure_reason, status_rows, write_status


def test_the_verdict_of_the_certificate_is_the_state(tmp_path: Path) -> None:
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps({"certified": False, "reasons": ["q_max 0.71 is not below 0.6", "Euler number 0"]}))
    (row,) = status_rows([{"case": "sub-1", "cell_size_mm": 0.6, "mesher": "cgal", "certificate": str(path)}])
    assert row["state"] == "uncertified"
    assert row["reason"] == "q_max 0.71 is not below 0.6; Euler number 0"


def test_a_failure_and_an_exclusion_are_rows_too(tmp_path: Path) -> None:
    meshes = [
        {
            "case": "sub-1",
            "cell_size_mm": 0.6,
            "mesher": "cgal",
            "stage": "gate",
            "state": "failed",
            "reason": "two\tbodies\n",
            "log": "a.log",
        },
        {"case": "sub-2", "state": "excluded", "reason": "motion"},
    ]
    write_status(meshes, table=tmp_path / "status.tsv", sidecar=tmp_path / "status.json")
    with (tmp_path / "status.tsv").open(newline="") as file:
        failed, excluded = csv.DictReader(file, delimiter="\t")
    assert (failed["stage"], failed["reason"], failed["log"]) == ("gate", "two bodies", "a.log")
    assert (excluded["stage"], excluded["cell_size_mm"], excluded["reason"]) == ("n/a", "n/a", "motion")
    assert json.loads((tmp_path / "status.json").read_text()).keys() == COLUMNS.keys()


def test_the_reason_is_the_last_error_of_the_log(tmp_path: Path) -> None:
    log = tmp_path / "job.log"
    log.write_text("10:00 INFO begun\nTraceback ...\n10:01 ERROR a.gii: is open\n  edge 3\n")
    assert failure_reason(log, since=0) == "a.gii: is open;   edge 3"


def test_a_log_without_an_error_means_the_job_was_killed(tmp_path: Path) -> None:
    log = tmp_path / "job.log"
    log.write_text("10:00 INFO begun\n")
    assert "killed" in failure_reason(log, since=0)
    assert "killed" in failure_reason(tmp_path / "none.log", since=0)


def test_the_log_of_an_earlier_run_gives_no_reason(tmp_path: Path) -> None:
    log = tmp_path / "job.log"
    log.write_text("10:01 ERROR a.gii: is open\n")
    os.utime(log, (1000, 1000))
    assert "killed" in failure_reason(log, since=2000)
