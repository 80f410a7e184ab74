"""A file under its final name is always complete."""

import json
from pathlib import Path

import pytest

from cortet.errors import InputError
from cortet.formats.atomic import atomic_folder, atomic_path, write_json


def test_the_file_appears_when_the_block_ends(tmp_path):
    final = tmp_path / "sub-1" / "x.surf.gii"
    with atomic_path(final) as temporary:
        assert temporary.parent == final.parent and temporary.name.endswith(".surf.gii")
        temporary.write_text("whole")
        assert not final.exists()
    assert final.read_text() == "whole" and [p.name for p in final.parent.iterdir()] == ["x.surf.gii"]


def test_a_failure_leaves_the_old_file_and_no_litter(tmp_path):
    final = tmp_path / "x.json"
    final.write_text("old")

    def fail_half_way() -> None:
        with atomic_path(final) as temporary:
            temporary.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_half_way()
    assert final.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["x.json"]


def test_the_file_that_was_asked_for_comes_after_those_that_belong_to_it(tmp_path, monkeypatch):
    moved, replace = [], Path.replace
    monkeypatch.setattr(Path, "replace", lambda file, to: (moved.append(to.name), replace(file, to)))
    with atomic_folder(tmp_path / "x.inp") as folder:
        for name in ("x.inp", "x.inp.json", "x_fields.inp"):
            (folder / name).touch()
    assert moved == ["x_fields.inp", "x.inp", "x.inp.json"]


def test_json_is_readable_and_strict(tmp_path):
    write_json({"mean_q": 0.125}, tmp_path / "x.json")
    assert json.loads((tmp_path / "x.json").read_text()) == {"mean_q": 0.125}
    with pytest.raises(ValueError, match="JSON"):
        write_json({"mean_q": float("nan")}, tmp_path / "x.json")
    assert json.loads((tmp_path / "x.json").read_text()) == {"mean_q": 0.125}


@pytest.mark.parametrize("why", ["read only", "a file is in its place"])
def test_a_folder_that_cannot_be_written_to_is_named_and_not_a_temporary_file(why, tmp_path, monkeypatch):
    folder = tmp_path / "out"
    if why == "read only":
        monkeypatch.setattr("os.access", lambda path, mode: path != folder)  # root may write anywhere
    else:
        folder.write_text("")
    for opened in (atomic_path, atomic_folder):
        with pytest.raises(InputError, match="out: .*another folder"):
            opened(folder / "m.vtu").__enter__()
