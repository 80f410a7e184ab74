"""A command never writes to its inputs, and replaces only files that cortet made and nobody changed since."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cortet.errors import InputError
from cortet.formats.atomic import atomic_folder, atomic_path, write_json
from cortet.formats.ownership import (
    MANIFEST,
    delete,
    delete_abandoned,
    delete_made,
    guarded,
    has_read,
    is_ours,
    may_write,
    record_of,
)

ROOT = Path(__file__).parents[2]


def made(path: Path, text: str = "made") -> Path:
    """A file that a command wrote."""
    with guarded([], files=[path]):
        write(path, text)
    return path


def write(path: Path, text: str = "new") -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text)


def refused(word: str, given: list[Path] | None = None, **outputs: Any) -> None:
    """A command with these inputs and outputs does not begin."""
    with pytest.raises(InputError, match=word), guarded(given or [], **outputs):
        raise AssertionError("it was let through")


@pytest.mark.parametrize("name", ["same", "link", "hard link", "other spelling", "through a linked folder"])
@pytest.mark.parametrize("force", [False, True])
def test_no_input_is_written_to_whatever_it_is_called(tmp_path: Path, name: str, force: bool) -> None:
    given = tmp_path / "given"
    given.write_text("mine")
    (tmp_path / "folder").symlink_to(tmp_path)
    (tmp_path / "link").symlink_to(given)
    os.link(given, tmp_path / "hard")
    spelled = {
        "same": given,
        "link": tmp_path / "link",
        "hard link": tmp_path / "hard",
        "other spelling": tmp_path / ".." / tmp_path.name / "given",
        "through a linked folder": tmp_path / "folder/given",
    }[name]
    refused("is an input", [given], files=[spelled], force=force)
    with guarded([given], force=force), pytest.raises(InputError, match="is an input"):
        write(spelled)
    assert given.read_text() == "mine" and spelled.exists()


def test_a_file_is_replaced_if_cortet_made_it_and_nobody_edited_it_or_when_forced(tmp_path: Path) -> None:
    notes = tmp_path / "notes"
    notes.write_text("mine")
    refused("--force", files=[notes])
    with guarded([], files=[notes], force=True):
        write(notes)
    assert notes.read_text() == "new"
    path = made(tmp_path / "x.mesh")
    with guarded([], files=[path]):
        write(path, "again")
    path.write_text("edited")
    refused("changed since", files=[path])


def test_many_commands_may_write_to_one_folder(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from tests.formats.test_ownership import made; made(Path(sys.argv[1]))"
    )
    files = [tmp_path / f"{number}.mesh" for number in range(6)]
    running = [subprocess.Popen([sys.executable, "-c", code, file], cwd=ROOT) for file in files]
    assert [one.wait() for one in running] == [0] * 6
    assert all(map(is_ours, files))


def test_no_file_of_several_moves_where_one_may_not(tmp_path: Path) -> None:
    (tmp_path / "b").write_text("mine")
    with guarded([]), pytest.raises(InputError, match=r"/b: exists"), atomic_folder(tmp_path / "a") as folder:
        (folder / "a").write_text("new")
        (folder / "b").write_text("new")
    assert not (tmp_path / "a").exists() and (tmp_path / "b").read_text() == "mine"


def test_only_what_a_record_lists_and_is_unchanged_is_deleted(tmp_path: Path) -> None:
    first, second, raw = (tmp_path / name for name in ("x.elem", "x.lon", "x.raw"))
    for path in (first, second, raw):
        path.write_text("made")
    record, of_others = tmp_path / "x.json", tmp_path / "y.json"
    content = record_of([first, second])
    write_json(content | {"files": content["files"] | {"../outside": "0", "x.gone": "0"}}, record)
    second.write_text("edited")
    delete_made(record)
    assert not first.exists() and second.exists() and not record.exists()
    for stranger in ({"name": "no record"}, {"files": record_of([raw])["files"]}):
        write_json(stranger, of_others)
        assert not is_ours(raw) and not is_ours(of_others)
        delete_made(of_others)
        assert raw.exists() and of_others.exists()


@pytest.mark.parametrize("content", ["{", "[]", '{"files": 3}', '{"files": {"x": 1}}', '{"files": {"x": ["1"]}}'])
def test_a_damaged_manifest_makes_nothing_ours(tmp_path: Path, content: str) -> None:
    (tmp_path / "x").write_text("mine")
    (tmp_path / MANIFEST).write_text(content)
    assert not is_ours(tmp_path / "x")
    with guarded([], force=True):
        write(tmp_path / "x")
    assert is_ours(tmp_path / "x")


def test_a_folder_is_filled_if_it_is_new_empty_or_cortets(tmp_path: Path) -> None:
    new, full, file = tmp_path / "new", tmp_path / "full", tmp_path / "file"
    full.mkdir()
    (full / "thesis").write_text("mine")
    file.touch()
    for _ in range(2):
        with guarded([], shared=[new]):
            write(new / "a")
            write(new / "b/c")
    assert (new / MANIFEST).exists()
    refused("that cortet did not make", shared=[full])
    refused("is a file", shared=[file])
    assert [path.name for path in full.iterdir()] == ["thesis"]


def test_a_file_of_a_folder_that_was_edited_is_neither_replaced_nor_deleted(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with guarded([], shared=[folder]):
        write(folder / "table")
        write(folder / "frame")
    (folder / "table").write_text("edited")
    with guarded([], shared=[folder]):
        for harm, files in ((write, ["table"]), (delete, ["table"]), (delete, ["frame", "table"])):
            with pytest.raises(InputError, match="/table"):
                harm(*(folder / name for name in files))
        assert (folder / "frame").exists(), "all of them or none"
        delete(folder / "frame")
        delete(folder / "frame")
    assert [path.name for path in folder.iterdir() if path.name != MANIFEST] == ["table"]


@pytest.mark.parametrize("force", [False, True])
def test_what_a_command_has_read_is_an_input(tmp_path: Path, force: bool) -> None:
    read = made(tmp_path / "x.mesh")
    with guarded([], force=force), pytest.raises(InputError, match="is an input"):
        has_read(read)
        write(read)
    with guarded([], files=[read], force=force), pytest.raises(InputError, match="is an input"):
        has_read(tmp_path / ".." / tmp_path.name / "x.mesh")
    assert read.read_text() == "made"


def test_a_command_may_write_again_what_it_has_written_and_read_back(tmp_path: Path) -> None:
    with guarded([], files=[tmp_path / "x"]):
        with atomic_path(tmp_path / "x") as temporary:
            temporary.write_text("one")
            has_read(temporary)
        has_read(tmp_path / "x")
        (tmp_path / "x").write_text("changed by itself")
        write(tmp_path / "x", "two")
    assert (tmp_path / "x").read_text() == "two"


def test_a_device_or_a_pipe_is_not_replaced_even_when_forced(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "x.png")
    refused("pipe", files=[pipe], force=True)
    assert pipe.is_fifo()


@pytest.mark.parametrize("letter", ["x", "\u00fc"])
def test_a_name_beside_which_no_temporary_file_fits_is_refused(tmp_path: Path, letter: str) -> None:
    """A file is written to a temporary name first, which is longer; a letter may have two bytes."""
    longest = os.pathconf(tmp_path, "PC_NAME_MAX") - len(f".{os.getpid()}-12345678.")
    fits = tmp_path / "new" / (letter * ((longest - 4) // len(letter.encode())) + ".vtu")
    with guarded([], files=[fits]):
        write(fits)
    assert fits.read_text() == "new"
    refused(f"at most {longest}", files=[fits.with_name(letter + fits.name)])
    assert list(fits.parent.glob(f"*{fits.suffix}")) == [fits]


def test_temporary_files_of_ended_processes_are_deleted_and_nothing_else(tmp_path: Path) -> None:
    ended = subprocess.Popen(["true"])
    ended.wait()
    left = [f".{ended.pid}-0123abcd.{name}" for name in ("fold.tsv", "frame_0001.vtu", MANIFEST)]
    kept = [
        f".{ended.pid}-0123abcd.mesh.vtu",  # of another command
        f".{os.getpid()}-0123abcd.fold.tsv",
        f".{ended.pid}-20241231.csv",
        f".{ended.pid}-notes-0123abcd.fold.tsv",
        f". {ended.pid} -0123abcd.fold.tsv",
        f".{10**30}-0123abcd.fold.tsv",
        f"deep/{left[0]}",
        "fold.tsv",
    ]
    (tmp_path / "deep").mkdir()
    for name in (*left, *kept):
        (tmp_path / name).touch()
    link = tmp_path / f".{ended.pid}-ffffffff.fold.tsv"
    link.symlink_to(tmp_path / "fold.tsv")
    with guarded([], files=[tmp_path / "new"]):
        delete_abandoned(tmp_path, "fold.tsv", "frame_*.vtu")
    assert not any((tmp_path / name).exists() for name in left)
    assert link.is_symlink() and all((tmp_path / name).exists() for name in kept)
    delete_abandoned(tmp_path / "nowhere", "fold.tsv")


def test_a_folder_of_the_command_is_known_by_any_name(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out/x.json").write_text("old")
    with guarded([], folders=[tmp_path / "out"]):
        may_write(tmp_path / "study/../out/x.json")


def test_temporary_folders_of_a_killed_command_go_with_the_next_file_of_that_name(tmp_path: Path) -> None:
    killed = subprocess.Popen(["true"])
    killed.wait()
    left = tmp_path / f".{killed.pid}-0123abcd.x.json"
    left.mkdir()
    (left / "x.vtu").touch()
    with atomic_folder(tmp_path / "x.json") as folder:
        (folder / "x.json").touch()
    assert [path.name for path in tmp_path.iterdir()] == ["x.json"]
