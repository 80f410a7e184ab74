"""Files appear complete or not at all; inputs are never written to, and files of others are not replaced."""

from __future__ import annotations

import errno
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


# --- complete or not at all


def test_a_file_has_its_name_only_when_it_is_complete(tmp_path):
    final = tmp_path / "sub-1" / "x.surf.gii"
    with atomic_path(final) as temporary:
        assert temporary.parent == final.parent and temporary.name.endswith(".surf.gii")
        temporary.write_text("whole")
        assert not final.exists()
    with pytest.raises(ZeroDivisionError), atomic_path(final) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert final.read_text() == "whole" and [path.name for path in final.parent.iterdir()] == ["x.surf.gii"]


def test_on_a_full_disk_no_part_of_a_file_is_left(tmp_path):
    for opened in (atomic_path, atomic_folder):
        with pytest.raises(InputError, match=r"m\.vtu.*disk"), opened(tmp_path / "m.vtu") as temporary:
            (temporary if opened is atomic_path else temporary / "m.vtu").write_text("half")
            raise OSError(errno.ENOSPC, "no space")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("why", ["read only", "a file is in its place"])
def test_a_folder_that_cannot_be_written_to_is_named(why, tmp_path, monkeypatch):
    folder = tmp_path / "out"
    if why == "read only":
        monkeypatch.setattr("os.access", lambda path, mode: path != folder)  # root may write anywhere
    else:
        folder.write_text("")
    for opened in (atomic_path, atomic_folder):
        with pytest.raises(InputError, match="out: "):
            opened(folder / "m.vtu").__enter__()


# --- inputs


@pytest.mark.parametrize("force", [False, True])
def test_no_input_is_written_to_whatever_it_is_called(tmp_path, force):
    given = tmp_path / "given"
    given.write_text("mine")
    (tmp_path / "folder").symlink_to(tmp_path)
    (tmp_path / "link").symlink_to(given)
    os.link(given, tmp_path / "hard")
    for name in ("given", "link", "hard", f"../{tmp_path.name}/given", "folder/given"):
        refused("is an input", [given], files=[tmp_path / name], force=force)
        with guarded([given], force=force), pytest.raises(InputError, match="is an input"):
            write(tmp_path / name)
    assert given.read_text() == "mine"


@pytest.mark.parametrize("force", [False, True])
def test_what_a_command_has_read_is_an_input(tmp_path, force):
    read = made(tmp_path / "x.mesh")
    with guarded([], force=force), pytest.raises(InputError, match="is an input"):
        has_read(read)
        write(read)
    with guarded([], files=[read], force=force), pytest.raises(InputError, match="is an input"):
        has_read(tmp_path / ".." / tmp_path.name / "x.mesh")
    with guarded([], files=[tmp_path / "y"]):  # not what it wrote itself
        with atomic_path(tmp_path / "y") as temporary:
            temporary.write_text("one")
            has_read(temporary)
        has_read(tmp_path / "y")
        write(tmp_path / "y", "two")


# --- files of others


def test_a_file_is_replaced_if_cortet_made_it_and_nobody_edited_it_or_when_forced(tmp_path):
    notes = tmp_path / "notes"
    notes.write_text("mine")
    refused("--force", files=[notes])
    with guarded([], files=[notes], force=True):
        write(notes)
    path = made(tmp_path / "x.mesh")
    assert made(path, "again").read_text() == "again"
    path.write_text("edited")
    refused("changed since", files=[path])
    (tmp_path / MANIFEST).write_bytes(b"\xff{damaged\n")
    assert not is_ours(notes)
    os.mkfifo(pipe := tmp_path / "x.png")
    refused("pipe", files=[pipe], force=True)
    refused("name", files=[tmp_path / "y", tmp_path / "." / "y"])


def test_many_commands_may_write_to_one_folder(tmp_path):
    code = (
        "import sys; from pathlib import Path; from tests.formats.test_ownership import made; made(Path(sys.argv[1]))"
    )
    files = [tmp_path / f"{number}.mesh" for number in range(6)]
    running = [subprocess.Popen([sys.executable, "-c", code, file], cwd=ROOT) for file in files]
    assert [one.wait() for one in running] == [0] * 6
    assert all(map(is_ours, files))


def test_no_file_of_several_moves_where_one_may_not(tmp_path):
    (tmp_path / "b").write_text("mine")
    with guarded([]), pytest.raises(InputError, match=r"/b: exists"), atomic_folder(tmp_path / "a") as folder:
        (folder / "a").write_text("new")
        (folder / "b").write_text("new")
    assert not (tmp_path / "a").exists() and (tmp_path / "b").read_text() == "mine"


def test_only_what_a_record_lists_and_is_unchanged_is_deleted(tmp_path):
    first, second, stranger = (tmp_path / name for name in ("x.elem", "x.lon", "y.json"))
    for path in (first, second):
        path.write_text("made")
    write_json(record_of([first, second]), record := tmp_path / "x.json")
    second.write_text("edited")
    delete_made(record)
    assert not first.exists() and second.exists() and not record.exists()
    write_json({"files": record_of([second])["files"]}, stranger)
    delete_made(stranger)
    assert second.exists() and stranger.exists()


def test_a_folder_is_filled_if_it_is_new_empty_or_cortets_and_edited_files_stay(tmp_path):
    new, full, file = tmp_path / "new", tmp_path / "full", tmp_path / "file"
    full.mkdir()
    (full / "thesis").write_text("mine")
    file.touch()
    for _ in range(2):
        with guarded([], shared=[new]):
            write(new / "a")
            write(new / "b/c")
    refused("that cortet did not make", shared=[full])
    refused("is a file", shared=[file])
    (new / "a").write_text("edited")
    with guarded([], shared=[new]):
        for harm, names in ((write, ["a"]), (delete, ["b/c", "a"])):
            with pytest.raises(InputError, match="/a"):
                harm(*(new / name for name in names))
        assert (new / "b/c").exists(), "all of them or none"
        delete(new / "b/c")
    with guarded([], folders=[new]):
        may_write(full / "../new/a")


def test_temporary_files_of_ended_processes_are_deleted_and_nothing_else(tmp_path):
    ended = subprocess.Popen(["true"])
    ended.wait()
    left = [f".{ended.pid}-0123abcd.{name}" for name in ("fold.tsv", "frame_0001.vtu")]
    kept = [
        f".{ended.pid}-0123abcd.mesh.vtu",  # of another command
        *(f".{os.getpid()}-0123abcd.fold.tsv", f".{ended.pid}-20241231.csv", f"deep/{left[0]}", "fold.tsv"),
    ]
    (tmp_path / "deep").mkdir()
    for name in (*left, *kept):
        (tmp_path / name).touch()
    delete_abandoned(tmp_path, "fold.tsv", "frame_*.vtu")
    assert not any((tmp_path / name).exists() for name in left)
    assert all((tmp_path / name).exists() for name in kept)
    folder = tmp_path / f".{ended.pid}-0123abcd.x.json"
    folder.mkdir()
    with atomic_folder(tmp_path / "x.json") as own:
        (own / "x.json").touch()
    assert not folder.exists()


def test_a_list_that_is_a_link_is_never_written_to(tmp_path):
    """It would have added lines to any file of the user that a link in a shared folder names."""
    (tmp_path / "notes.txt").write_text("mine")
    (folder := tmp_path / "shared").mkdir()
    (folder / MANIFEST).symlink_to(tmp_path / "notes.txt")
    out = folder / "x.txt"
    with guarded([], files=[out]), pytest.raises(InputError, match="is a link"), atomic_path(out) as new:
        new.write_text("x")
    assert (tmp_path / "notes.txt").read_text() == "mine" and not out.exists()
