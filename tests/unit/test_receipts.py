"""A result is used again only if its receipt says that it was made with what is asked for now."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from cortet.cohort.receipts import (
    ask,
    begin,
    content,
    fingerprint,
    finish,
    forget,
    is_current,
    read,
    receipt_path,
    require_same_input,
    require_unchanged,
    unfinished,
)
from cortet.errors import InputError, StageError

ASKED = {"arguments": {"thresholds": [0.7, 0.5]}, "version": 3, "input_sha256": {"surface": "a"}}
OF = {"case": "sub-a", "folder": "sub-a"}


def made(receipt: Path) -> None:
    """Let the job of a receipt run."""
    finish(receipt, begin(receipt))


def test_a_receipt_is_old_for_the_same_parameters_only(tmp_path: Path) -> None:
    receipt = receipt_path(tmp_path, tmp_path / "logs/clean/sub-a/x.log")
    assert receipt == tmp_path / ".cortet/clean/sub-a/x/receipt.json"
    ask(receipt, "clean", OF, ASKED)
    assert not is_current(read(receipt))
    made(receipt)
    result = tmp_path / "mesh.vtu"
    result.touch()
    ask(receipt, "clean", OF, ASKED | {"arguments": {"thresholds": (0.7, 0.5)}})
    assert is_current(read(receipt)), "JSON knows no tuples"
    assert receipt.stat().st_mtime < result.stat().st_mtime
    for other in ({"version": 4}, {"arguments": {"thresholds": [0.7]}}, {"input_sha256": {"surface": "b"}}):
        before = receipt.read_bytes()
        ask(receipt, "clean", OF, ASKED | other)
        assert not is_current(read(receipt)) and receipt.read_bytes() != before
        assert receipt.stat().st_mtime_ns > result.stat().st_mtime_ns
    ask(receipt, "clean", OF, ASKED)
    assert receipt.stat().st_mtime < result.stat().st_mtime, "planned with others, and made with none of them"


def test_files_from_a_machine_whose_clock_was_fast_are_made_again_with_other_parameters(tmp_path: Path) -> None:
    receipt, result = tmp_path / "receipt.json", tmp_path / "mesh.vtu"
    ask(receipt, "clean", OF, ASKED)
    made(receipt)
    result.touch()
    tomorrow = time.time() + 86_400
    os.utime(result, (tomorrow, tomorrow))
    ask(receipt, "clean", OF, ASKED | {"version": 4})
    assert receipt.stat().st_mtime > result.stat().st_mtime


def test_what_was_changed_while_a_job_ran_is_made_again(tmp_path: Path) -> None:
    receipt = tmp_path / "receipt.json"
    ask(receipt, "clean", OF, ASKED)
    asked = begin(receipt)
    ask(receipt, "clean", OF, ASKED | {"version": 4})
    finish(receipt, asked)
    assert not is_current(read(receipt))


def test_files_that_are_gone_or_were_made_otherwise_are_made_again(tmp_path: Path) -> None:
    receipt = tmp_path / "receipt.json"
    for again in (lambda: ask(receipt, "export", OF, ASKED, again=True), lambda: forget(receipt)):
        ask(receipt, "export", OF, ASKED)
        made(receipt)
        again()
        ask(receipt, "export", OF, ASKED)
        assert not is_current(read(receipt))


def test_a_job_that_began_and_did_not_succeed_is_unfinished(tmp_path: Path) -> None:
    for name in ("killed", "done", "waiting"):
        log = tmp_path / f"logs/clean/{name}.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        log.touch()
        ask(receipt_path(tmp_path, log), "clean", {"case": name}, ASKED)
    begin(receipt_path(tmp_path, tmp_path / "logs/clean/killed.log"))
    made(receipt_path(tmp_path, tmp_path / "logs/clean/done.log"))
    (tmp_path / "logs/clean/waiting.log").unlink()
    ((record, log),) = unfinished(tmp_path)
    assert record["wildcards"] == {"case": "killed"} and log == tmp_path / "logs/clean/killed.log"


@pytest.mark.parametrize("text", ["", "[]", "{}", "{"])
def test_a_damaged_receipt_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    assert not is_current(read(tmp_path / "x.json"))
    ask(tmp_path / "x.json", "clean", OF, ASKED)
    assert read(tmp_path / "x.json")["rule"] == "clean"


def test_a_folder_that_cannot_be_written_to_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file: no file can be written to this folder"):
        ask(tmp_path / "file/receipt.json", "clean", OF, ASKED)


def test_it_does_not_matter_where_files_lie() -> None:
    here = {"arguments": {"source": "a/x.surf.gii", "allow_genus": 0}, "paths": {"surface": "a/x.surf.gii"}}
    there = {"arguments": {"source": "/b/x.surf.gii", "allow_genus": 0}, "paths": {"surface": "/b/x.surf.gii"}}
    assert fingerprint(here) == fingerprint(there)
    assert fingerprint(here) != fingerprint({**here, "arguments": {"source": "a/x.surf.gii", "allow_genus": 1}})


def test_content_is_seen_when_the_time_says_nothing(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_text("one")
    os.utime(path, (1000, 1000))
    planned = content({"surface": path})
    require_unchanged({"surface": path}, planned)
    other = tmp_path / "y"
    other.write_text("two")  # as long as the other
    os.utime(other, (1000, 1000))
    other.replace(path)
    assert content({"surface": path}) != planned
    with pytest.raises(StageError, match="has changed since this run was planned"):
        require_unchanged({"surface": path}, planned)


def test_a_file_that_is_not_there_has_no_content(tmp_path: Path) -> None:
    assert content({"surface": tmp_path / "none"}) == {"surface": None}


def test_a_report_on_another_input_is_refused() -> None:
    require_same_input("gate.json", {"input_sha256": {"surface": "a"}}, {"surface": "a"})
    require_same_input("gate.json", {"input_sha256": {"surface": "a"}}, {"surface": "a", "inner_white": "b"})
    with pytest.raises(StageError):
        require_same_input("gate.json", {}, {"surface": "a"})
    with pytest.raises(StageError, match=r"gate\.json: is about another version of the input"):
        require_same_input("gate.json", {"input_sha256": {"surface": "b"}}, {"surface": "a"})
