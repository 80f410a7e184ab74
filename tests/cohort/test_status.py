"""The status table: one row per mesh, and a reason that is never an earlier run's."""

from __future__ import annotations

import json

import pytest

from cortet.cohort.status import COLUMNS, certificate_of, failure_reason, status_rows
from cortet.cohort.user_files import require_same_input
from cortet.errors import StageError
from cortet.formats.tables import names, write_table
from cortet.formats.tsv import read_tsv


def test_a_failure_and_an_exclusion_are_rows_too(tmp_path):
    meshes = [
        {
            "case": "sub-1",
            "cell_size_mm": 0.6,
            "mesher": "cgal",
            "stage": "gate",
            "state": "failed",
            "reason": 'two\t"bodies"\n',
            "log": "a.log",
        },
        {"case": "sub-2", "state": "excluded", "reason": "motion"},
    ]
    write_table(COLUMNS, status_rows(meshes), tmp_path / "status.tsv", tmp_path / "status.json")
    failed, excluded = read_tsv(tmp_path / "status.tsv").to_dict("records")
    assert (failed["stage"], failed["reason"], failed["log"]) == ("gate", 'two "bodies"', "a.log")
    assert (excluded["stage"], excluded["cell_size_mm"], excluded["reason"]) == ("n/a", "n/a", "motion")
    assert list(json.loads((tmp_path / "status.json").read_text())) == names(COLUMNS)


STACK = 'Current thread 0x00007f (most recent call first):\n  File "/x/a.py", line 3 in fill\n  File "b.py", line 4\n'


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"Timeout (0:00:01)!\n{STACK}", "took longer than 0:00:01 (hours:minutes:seconds), the time_limit"),
        ("", "ended without a message: killed, or ran out of memory or time"),
        (None, "ended without a message: killed, or ran out of memory or time"),
    ],
)
def test_why_a_job_that_left_no_word_ended_follows_from_its_log(tmp_path, text, reason):
    log = tmp_path / "job.log"
    if text is not None:
        log.write_text(f"10:00 INFO begun\n{text}")
    assert failure_reason(log) == reason


def test_a_report_on_another_input_is_refused():
    require_same_input("gate.json", {"input_sha256": {"surface": "a"}}, {"surface": "a"})
    require_same_input("gate.json", {"input_sha256": {"surface": "a"}}, {"surface": "a", "inner_white": "b"})
    with pytest.raises(StageError):
        require_same_input("gate.json", {}, {"surface": "a"})
    with pytest.raises(StageError, match=r"gate\.json: describes an earlier version"):
        require_same_input("gate.json", {"input_sha256": {"surface": "b"}}, {"surface": "a"})


CERTIFICATE = {
    "schema": 1,
    "certified": True,
    "checks": [{"id": "worst_q", "passed": True}],
    "reasons": [],
    "remarks": [],
    "regions": [],
    "quality": {},
    "parameters": {},
    "reports": {},
}


@pytest.mark.parametrize(
    "edited",
    [
        {"checks": [{"id": "other", "passed": True}]},
        {"checks": [[]]},
        {"checks": {}},
        {"quality": []},
        {"reasons": "x"},
    ],
)
def test_a_certificate_edited_to_another_form_is_none(tmp_path, edited):
    """A page ended with `StopIteration:`."""
    (path := tmp_path / "c.json").write_text(json.dumps(CERTIFICATE))
    assert certificate_of(path) == CERTIFICATE
    path.write_text(json.dumps({**CERTIFICATE, **edited}))
    assert certificate_of(path) == {}
