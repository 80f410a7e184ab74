"""What the user's files hold decides whether a job runs again, not their names or times."""

from __future__ import annotations

import os

import pytest

from cortet.cohort.user_files import content, require_same_input, require_unchanged
from cortet.errors import StageError


def test_content_is_seen_when_the_time_says_nothing(tmp_path):
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
    assert content({"surface": tmp_path / "none"}) == {"surface": None}
    with pytest.raises(StageError, match="changed since"):
        require_unchanged({"surface": path}, planned)


def test_a_report_on_another_input_is_refused():
    require_same_input("gate.json", {"input_sha256": {"surface": "a"}}, {"surface": "a"})
    require_same_input("gate.json", {"input_sha256": {"surface": "a"}}, {"surface": "a", "inner_white": "b"})
    with pytest.raises(StageError):
        require_same_input("gate.json", {}, {"surface": "a"})
    with pytest.raises(StageError, match=r"gate\.json: describes an earlier version"):
        require_same_input("gate.json", {"input_sha256": {"surface": "b"}}, {"surface": "a"})
