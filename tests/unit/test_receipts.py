"""A result is used again only if its receipt says that it was made with what is asked for now."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cortet.cohort.receipts import (
    content,
    fingerprint,
    is_current,
    receipt_path,
    require_same_input,
    require_unchanged,
    write_receipt,
)
from cortet.errors import StageError

ASKED = {"arguments": {"thresholds": [0.7, 0.5]}, "version": 3, "input_sha256": {"surface": "a"}}


def test_a_receipt_is_current_for_the_same_parameters_only(tmp_path: Path) -> None:
    receipt = receipt_path(tmp_path, tmp_path / "logs/clean/sub-a/x.log")
    assert receipt == tmp_path / ".cortet/clean/sub-a/x.json"
    assert not is_current(receipt, ASKED)
    write_receipt(receipt, ASKED)
    assert is_current(receipt, ASKED | {"arguments": {"thresholds": (0.7, 0.5)}}), "JSON knows no tuples"
    for other in ({"version": 4}, {"arguments": {"thresholds": [0.7]}}, {"input_sha256": {"surface": "b"}}):
        assert not is_current(receipt, ASKED | other)


@pytest.mark.parametrize("text", ["", "[]", "{}", "{"])
def test_a_damaged_receipt_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text)
    assert not is_current(tmp_path / "x.json", ASKED)


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
