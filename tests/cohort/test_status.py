"""The status table: one row per mesh, and a reason that is never an earlier run's."""

from __future__ import annotations

import json
from unittest.mock import Mock

import pytest

from cortet.cohort import failures
from cortet.cohort.app import outcome
from cortet.cohort.failures import failure_path, silent_end, write_failure
from cortet.cohort.outdated import set_aside
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import Case
from cortet.cohort.states import PLANNED, State, States
from cortet.config import Config, load
from cortet.errors import InputError
from cortet.formats.certificates import certificate_of, sealed

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
    assert silent_end(log).what == reason


def test_a_job_on_a_full_disk_says_why_it_failed(tmp_path, monkeypatch):
    """Its file said that it had been killed: the longer one found no room."""
    log = tmp_path / "job.log"
    write_failure(log, "export", {"case": "sub-a"}, "made")
    full = InputError("its disk has only 0 kB left", file="x.vtu", remedy="free some space")
    monkeypatch.setattr(failures, "write_json", Mock(side_effect=full))
    write_failure(log, "export", {"case": "sub-a"}, "made", full)
    told = json.loads(failure_path(log).read_text())
    assert (told["reason"], told["remedy"]) == (
        "x.vtu: its disk has only 0 kB left",
        "free some space",
    )


def test_an_excluded_row_without_a_reason_says_so():
    out = Case("a", None, "L", 24.0, "a.gii", include=False)
    (row,) = States(Plan({"": Config()}, [out])).rows()
    assert row == {"case": "sub-a_hemi-L", "state": "excluded", "reason": "no reason given"}


def test_the_files_of_an_uncertified_mesh_stay_when_its_certificate_is_edited(tmp_path):
    """They moved aside, with the false word that the mesh had another verdict."""
    output = tmp_path / "out"
    case = Case("a", None, "L", 24.0, tmp_path / "a.gii")
    config = load({"output": str(output), "export": {"uncertified": True}})
    plan = Plan({"": config}, [case])
    (mesh,) = plan.meshes()
    certificate = plan.certificate(mesh)
    certificate.parent.mkdir(parents=True)
    content = sealed({"schema": 3, "certified": False, "mesh_sha256": "1"})
    certificate.write_text(json.dumps(content))
    (export,) = plan.exports(mesh)
    assert "Uncertified" in export.name
    export.touch()
    certificate.write_text(json.dumps({**content, "mesh_sha256": "2"}))
    assert not set_aside(States(plan)) and plan.exports(mesh) == [export]
    certificate.write_text(json.dumps(sealed({**content, "certified": True})))
    (told,) = set_aside(States(plan))
    assert "another mesh or verdict" in told and not export.exists()


def test_the_end_of_a_run_names_no_files_of_meshes_with_other_settings(tmp_path):
    """It said "1 unfinished; meshes: *Solver_sets.vtu" of files that an earlier run had made with other settings."""
    plan = Plan({"": load({"output": str(tmp_path)})}, [Case("a", None, "L", 24.0, tmp_path / "a.gii")])
    (mesh,) = plan.meshes()
    (export,) = plan.exports(mesh)
    export.parent.mkdir(parents=True)
    export.touch()
    said = [
        outcome(States(plan, {mesh: one}), tmp_path, page=False) for one in (PLANNED, State("generate", "unfinished"))
    ]
    assert said[0].endswith("*Solver_sets.vtu") and said[1] == "1 case: 1 unfinished; no mesh"


CERTIFICATE = {"schema": 3, "certified": False, "checks": [{"id": "worst_q", "passed": False}], "quality": {"q": 0.7}}


@pytest.mark.parametrize(
    "edited",
    [
        {"checks": []},
        {"checks": [], "certified": True},
        {"quality": {"q": 0.3}},
        {"content_sha256": ""},
        {"schema": 2},
    ],
)
def test_a_certificate_that_was_edited_is_none(tmp_path, edited):
    """With the checks cut down, or other numbers, it passed as certified."""
    file, content = tmp_path / "c.json", sealed(CERTIFICATE)
    file.write_text(json.dumps(content, indent=3, sort_keys=True))
    assert certificate_of(file) == content
    file.write_text(json.dumps({**content, "files": {"x.vtu": "1"}, "made_by": "cortet"}))
    assert certificate_of(file)["certified"] is False, "what was written with it is no part of it"
    file.write_text(json.dumps({**content, **edited}))
    assert certificate_of(file) == {}
