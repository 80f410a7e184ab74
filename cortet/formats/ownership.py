"""Which files a command may write: never an input, and no existing file that cortet did not make, unless forced.

A command runs within `guarded`. Every function of cortet that replaces or deletes a file asks `may_write` first, and
every reader calls `has_read`: a file that a command has read is an input, even if no argument names it. A hidden list
in each folder has a line per file that a command wrote, its SHA-256 and its name, as `sha256sum` prints them. A file
that the list lacks, or that changed since, belongs to the user. The workflow has no guard: its rules name their
outputs. Its working folder has a marker instead.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NoReturn

from cortet.errors import InputError
from cortet.formats.hashing import sha256

#: file that marks its folder as made by cortet; a folder of this name, in the output of a workflow, marks nothing
MARKER = ".cortet"
#: list of the files that commands wrote to its folder
MANIFEST = ".cortet.sha256"
_TEXT: dict[str, Any] = {"encoding": "utf-8", "errors": "surrogateescape"}
#: temporary names: the number of their process, a token, and the name of the file
_TEMPORARY = re.compile(r"\.([0-9]{1,9})-[0-9a-f]{8}\.(.+)")
#: key and value that distinguish a record from other JSON files
_SIGNATURE = {"made_by": "cortet"}


@dataclass(frozen=True)
class _Guard:
    """What a command may write to; files that are read later become inputs."""

    inputs: set[Path]
    #: files that the command is told to write
    files: tuple[Path, ...]
    #: folders below which it may write
    folders: tuple[Path, ...]
    #: the user has said that existing files may be replaced
    force: bool
    #: files that this command has written
    made: set[Path] = field(default_factory=set)

    def is_in_own_folder(self, path: Path) -> bool:
        """Whether a file lies in a folder of the command, whatever `..` its name has."""
        return any(map(_absolute(path).is_relative_to, self.folders))

    def owns(self, path: Path) -> bool:
        """Whether the command has made a file, or may write anything in its folder."""
        return _absolute(path) in self.made or self.is_in_own_folder(path)


_guard: ContextVar[_Guard | None] = ContextVar("_guard", default=None)


@contextmanager
def guarded(
    inputs: Iterable[Path],
    *,
    files: Iterable[Path] = (),
    shared: Iterable[Path] = (),
    folders: Iterable[Path] = (),
    force: bool = False,
) -> Iterator[None]:
    """Run a command that reads some files and writes others; refuses at once if it would harm files of the user.

    Parameters
    ----------
    inputs : files that the command only reads
    files : files that it is told to write
    shared : folders in which it writes single files, each guarded individually
    folders : other folders, below which it may write
    force : existing files may be replaced, but never an input

    Raises
    ------
    InputError
        an output is an input (even by another name), exists and was not made by cortet, or has the name of another
    """
    outputs = tuple(files)
    token = _guard.set(_Guard(set(inputs), outputs, tuple(map(_absolute, folders)), force))
    try:
        for path in outputs:
            may_write(path)
        if len({*map(os.path.realpath, outputs)}) < len(outputs):
            refuse_companion(outputs[-1])
        for folder in shared:
            _require_own_folder(folder, force=force)
        yield
    except FileNotFoundError as error:
        if error.filename is not None:
            raise
        remedy = "change to another folder, or give absolute paths"
        raise InputError("the working folder of this process was deleted", remedy=remedy) from error
    finally:
        _guard.reset(token)


def may_write(path: Path) -> None:
    """Raise InputError unless a file may be written, replaced or deleted; without a guard, any file may."""
    guard = _guard.get()
    if guard is None:
        return
    for given in guard.inputs:
        _refuse_same(path, given)
    if path.exists() and not path.is_file():
        raise InputError("is a folder, a device or a pipe", file=path, remedy="give the name of a file")
    if os.path.lexists(path) and not (guard.force or guard.owns(path) or is_ours(path)):
        raise InputError(
            "exists, but is not a file of cortet, or was changed since",
            file=path,
            remedy="give another name, or add --force to replace it",
        )


def mark(folder: Path) -> None:
    """Mark a folder as made by cortet."""
    if not (folder / MARKER).is_dir():
        (folder / MARKER).touch()


def has_read(path: Path) -> None:
    """Record that the command reads a file: it is an input from now on, unless it lies where the command may write."""
    guard = _guard.get()
    if guard is None or guard.owns(path):
        return
    guard.inputs.add(path)
    for output in guard.files:
        if not guard.owns(output):
            _refuse_same(output, path)


def about_to_write(files: Mapping[Path, Path]) -> None:
    """Record that files of one folder are about to get their names; the list has them before, in case of a kill.

    Parameters
    ----------
    files : temporary name -> name
    """
    guard = _guard.get()
    for temporary, path in files.items() if guard else ():
        assert guard
        # all files of a temporary folder get their names together
        if not (is_temporary(path.parent) or guard.is_in_own_folder(path)):
            if (manifest := path.with_name(MANIFEST)).is_symlink():
                what = "is a link, and cortet would write its list of files to where that leads"
                raise InputError(what, file=manifest, remedy="delete the link, or give another folder")
            with manifest.open("a", **_TEXT) as listed:
                listed.write(f"{sha256(temporary)}  {path.name}\n")
        guard.made.add(_absolute(path))


def final_name(path: Path) -> Path:
    """The name that a file gets if it lies in a temporary folder; else its own."""
    return path.parent.with_name(path.name) if is_temporary(path.parent) else path


def is_temporary(folder: Path) -> bool:
    """Whether a folder is a temporary one of this process."""
    return folder.name.startswith(f".{os.getpid()}-")


def refuse_companion(path: Path) -> NoReturn:
    """Raise InputError for an output whose name another file has that the same command writes."""
    raise InputError("is also the name of another file that this command writes", file=path, remedy="give another name")


def temporary_beside(path: Path) -> Path:
    """An unused name beside `path`, with its suffixes, for a file that will be renamed to `path`."""
    return path.with_name(f".{os.getpid()}-{secrets.token_hex(4)}.{path.name}")


def delete_abandoned(folder: Path, *names: str) -> None:
    """Delete temporary files and folders for these names or patterns whose processes have ended."""
    for path in sorted(folder.glob(".*")):
        found = _TEMPORARY.fullmatch(path.name)
        if found and any(fnmatchcase(found[2], name) for name in names) and not _runs(int(found[1])):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)


def is_ours(path: Path) -> bool:
    """Whether the list of its folder has a file with its current SHA-256."""
    manifest = path.with_name(MANIFEST)
    if path.is_symlink() or not (path.is_file() and manifest.is_file()):
        return False
    return f"{sha256(path)}  {path.name}" in manifest.read_text(**_TEXT).split("\n")


def delete(*paths: Path) -> None:
    """Delete the files that exist, or none if one may not be deleted; raises InputError as `may_write`."""
    for path in paths:
        may_write(path)
    for path in paths:
        path.unlink(missing_ok=True)


def record_of(paths: Iterable[Path]) -> dict[str, Any]:
    """The entries with which a JSON file records the files that were made with it."""
    return {**_SIGNATURE, "files": {path.name: sha256(path) for path in paths}}


def files_of(record: Path) -> dict[str, str]:
    """Name -> SHA-256 of the files that a record lists; empty if the file is not a record of cortet."""
    data = json_of(record)
    files = data.get("files") if is_record(data) else None
    return files if isinstance(files, dict) and all(map(_is_plain, files)) else {}


def is_record(data: Mapping[str, Any]) -> bool:
    """Whether the content of a JSON file is a record that cortet wrote."""
    return data.get("made_by") == _SIGNATURE["made_by"]


def _is_plain(name: str) -> bool:
    """Whether a name is that of a file, without a folder."""
    return bool(name) and "\0" not in name and Path(name).name == name


def changed_of(record: Path) -> list[Path]:
    """The files that a record lists and that have another content now; only those newer than the record are read."""
    beside = {record.parent / name: digest for name, digest in files_of(record).items()}
    newer = [path for path in beside if path.stat().st_mtime_ns > record.stat().st_mtime_ns]
    return [path for path in newer if sha256(path) != beside[path]]


def mesh_of(record: Path) -> str | None:
    """`hashing.mesh_sha256` of the mesh that a file was written from, by its sidecar; None if that does not say."""
    made_from = json_of(record).get("made_from")
    return made_from.get("mesh_sha256") if isinstance(made_from, dict) else None


def delete_made(record: Path) -> None:
    """Delete the files that a record lists, unless they changed since, and the record itself."""
    files = files_of(record)
    for name, digest in files.items():
        path = record.with_name(Path(name).name)
        if path.is_file() and not path.is_symlink() and sha256(path) == digest:
            delete(path)
    if files:
        delete(record)


def json_of(file: Path) -> dict[str, Any]:
    """Content of a JSON file; empty if it is not a JSON file, or not a file."""
    try:
        data = json.loads(file.read_text("utf-8")) if file.is_file() else {}
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _require_own_folder(folder: Path, *, force: bool) -> None:
    """Raise InputError for a folder with visible files and without a list of what cortet wrote there."""
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError("is a file", file=folder, remedy="give the name of a folder")
    unlisted = folder.is_dir() and not force and not (folder / MANIFEST).is_file()
    if unlisted and any(path.is_file() and not path.name.startswith(".") for path in folder.iterdir()):
        remedy = "give an empty or a new folder, or add --force"
        raise InputError("holds files that cortet did not make", file=folder, remedy=remedy)


def _refuse_same(output: Path, given: Path) -> None:
    """Raise InputError if an output is an input, even by another name."""
    try:
        same = output.samefile(given)
    except (OSError, ValueError):  # one of them is not there, or is a text that names no file
        return
    if same:
        also = "" if given == output else f", {given}"
        raise InputError(f"is an input of this command{also}", file=output, remedy="give the output another name")


def _runs(process: int) -> bool:
    """Whether a process of this machine may run; one that has ended and that nothing waits for does not."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):  # another user's, or no number of a process
        return True
    try:  # in a container, the first process may collect no ended ones
        status = Path(f"/proc/{process}/stat").read_text(**_TEXT)
    except OSError:  # a system without this folder
        return True
    return not status.rpartition(")")[2].lstrip().startswith("Z")


def _absolute(path: Path) -> Path:
    return Path(os.path.abspath(path))  # noqa: PTH100, `..` goes, links stay
