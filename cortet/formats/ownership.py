"""Which files cortet owns: a command never writes to its inputs, and replaces only files that cortet made.

A command runs within `guarded`. Every function of cortet that replaces or deletes a file then asks `may_write` first,
and every reader calls `has_read`. Every file that a command has read is an input, even if no argument names it, such as
a sidecar. A hidden manifest in the folder lists each file that the command writes, with its SHA-256. A file belongs to
the user if the manifest does not list it, or if it changed since. The workflow has no guard: its rules name their
outputs, none of which is a file of the user. Its working folder has a marker instead.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from cortet.errors import InputError
from cortet.formats.hashing import sha256

#: file that marks its folder as made by cortet; a folder of this name, in the output of a workflow, marks nothing
MARKER = ".cortet"
#: file that lists what commands wrote to its folder: name -> the last SHA-256
MANIFEST = ".cortet.json"
#: hashes that a manifest keeps per file: the current one and, in case the command is killed, the one it replaces
_HASHES = 2
#: temporary names: the number of their process, a token, and the name of the file
_TEMPORARY = re.compile(r"\.([0-9]+)-[0-9a-f]{8}\.(.+)")
#: key and value that distinguish a record from other JSON files
_SIGNATURE = {"made_by": "cortet"}


@dataclass(frozen=True)
class _Guard:
    """What a command may write to."""

    #: device and inode of each input -> the path that named it; files that are read later are added
    inputs: dict[tuple[int, int], Path]
    #: files that the command is told to write
    files: tuple[Path, ...]
    #: folders below which it may write
    folders: tuple[Path, ...]
    #: the user has said that existing files may be replaced
    force: bool
    #: files that this command has written
    made: set[Path] = field(default_factory=set)

    def is_below_own_folder(self, place: Path) -> bool:
        """Whether a file lies in a folder of the command, whatever `..` its name has."""
        return any(map(Path(os.path.normpath(place)).is_relative_to, self.folders))


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
    known = {identity: path for path in inputs if (identity := _identity(path))}
    outputs = tuple(files)
    _refuse_repeated(outputs)
    below = tuple(Path(os.path.normpath(folder.absolute())) for folder in folders)
    token = _guard.set(_Guard(known, outputs, below, force))
    try:
        for path in outputs:
            may_write(path)
        for folder in shared:
            _require_own_folder(folder, force=force)
        yield
    finally:
        _guard.reset(token)


def may_write(path: Path) -> None:
    """Raise InputError unless a file may be written, replaced or deleted; without a guard, any short name may."""
    _require_short(path)
    guard = _guard.get()
    if guard is None:
        return
    _refuse_input(path, guard)
    place = path.absolute()
    if path.exists() and not path.is_file():
        raise InputError("is a folder, a device or a pipe", file=path, remedy="give the name of a file")
    allowed = guard.force or place in guard.made or guard.is_below_own_folder(place)
    if not allowed and os.path.lexists(path) and not is_ours(path):
        raise InputError(
            "exists, and cortet did not make it, or it has changed since",
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
    place = path.absolute()
    if guard is None or place in guard.made or guard.is_below_own_folder(place):
        return
    if identity := _identity(path):
        guard.inputs.setdefault(identity, path)
        for output in guard.files:
            if output.absolute() not in guard.made:
                _refuse_input(output, guard)


def about_to_write(files: Mapping[Path, Path]) -> None:
    """Record that files of one folder are about to get their names; the manifest lists them before, in case of a kill.

    Parameters
    ----------
    files : temporary name -> name
    """
    guard = _guard.get()
    if guard is None:
        return
    guard.made.update(path.absolute() for path in files.values())
    for temporary in files:
        if identity := _identity(temporary):
            guard.inputs.pop(identity, None)  # the command read the file back before it got its name
    listed = {
        path: sha256(temporary)
        for temporary, path in files.items()
        # all files of a temporary folder get their names together
        if not is_temporary(path.parent) and not guard.is_below_own_folder(path.absolute())
    }
    if listed:
        _list_in_manifest(listed)


def final_name(path: Path) -> Path:
    """The name that a file gets if it lies in a temporary folder; else its own."""
    return path.parent.with_name(path.name) if is_temporary(path.parent) else path


def is_temporary(folder: Path) -> bool:
    """Whether a folder is a temporary one of this process."""
    return folder.name.startswith(_own_prefix())


def refuse_companion(path: Path) -> None:
    """Raise InputError for an output whose name another file has that the same command writes."""
    raise InputError("is the name of another file that this command writes", file=path, remedy="give another name")


def temporary_beside(path: Path) -> Path:
    """An unused name beside `path`, with its suffixes, for a file that will be renamed to `path`."""
    return path.with_name(f"{_own_prefix()}{secrets.token_hex(4)}.{path.name}")


def delete_abandoned(folder: Path, *names: str) -> None:
    """Delete temporary files and folders for the manifest and for these names or patterns whose processes have ended.

    No manifest lists temporary files, so only their names tell that they are cortet's.
    """
    for path in sorted(folder.glob(".*")):
        found = _TEMPORARY.fullmatch(path.name)
        if not found or path.is_symlink() or _runs(int(found[1])):
            continue
        if any(fnmatchcase(found[2], name) for name in (MANIFEST, *names)):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def is_ours(path: Path) -> bool:
    """Whether the manifest of its folder lists a file with its current SHA-256."""
    if not path.is_file() or path.is_symlink():
        return False
    listed = _manifest(path.parent).get(path.name)
    return listed is not None and sha256(path) in listed


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
    files = data.get("files") if data.items() >= _SIGNATURE.items() else None
    return {str(name): str(digest) for name, digest in files.items()} if isinstance(files, dict) else {}


def changed_of(record: Path) -> list[Path]:
    """The files that a record lists and that have another content now; only those newer than the record are read."""
    beside = {record.parent / name: digest for name, digest in files_of(record).items()}
    newer = [path for path in beside if path.stat().st_mtime_ns > record.stat().st_mtime_ns]
    return [path for path in newer if sha256(path) != beside[path]]


def delete_made(record: Path) -> None:
    """Delete the files that a record lists, unless they changed since, and the record itself."""
    files = files_of(record)
    for name, digest in files.items():
        path = record.parent / name
        own = Path(name).name == name and os.path.isfile(path)  # noqa: PTH113, false of names that no file can have
        if own and not path.is_symlink() and sha256(path) == digest:
            delete(path)
    if files:
        delete(record)


def json_of(file: Path) -> dict[str, Any]:
    """Content of a JSON file; empty if it is not a JSON file."""
    try:
        data = json.loads(file.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _manifest(folder: Path) -> dict[str, list[str]]:
    """Name -> hashes; empty if the manifest is missing or damaged."""
    files = json_of(folder / MANIFEST).get("files")
    if not isinstance(files, dict):
        return {}
    return {str(name): [str(one) for one in found] for name, found in files.items() if isinstance(found, list)}


def _list_in_manifest(listed: Mapping[Path, str]) -> None:
    """Add files of one folder with their SHA-256 to its manifest."""
    manifest = next(iter(listed)).with_name(MANIFEST)
    temporary = temporary_beside(manifest)
    folder = os.open(manifest.parent, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(folder, fcntl.LOCK_EX)
        files = _manifest(manifest.parent)
        for path, digest in listed.items():
            known = [one for one in files.get(path.name, []) if one != digest]
            files[path.name] = [*known, digest][-_HASHES:]
        temporary.write_text(json.dumps({"files": files}, indent=1) + "\n", encoding="utf-8")
        temporary.replace(manifest)
    finally:
        temporary.unlink(missing_ok=True)
        os.close(folder)


def _require_own_folder(folder: Path, *, force: bool) -> None:
    """Raise InputError for a folder without a manifest of cortet that holds more than a killed command leaves there."""
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError("is a file", file=folder, remedy="give the name of a folder")
    unlisted = folder.is_dir() and not (folder / MANIFEST).is_file()
    if unlisted and not force and not all(_left_by_a_kill(path) for path in folder.iterdir()):
        raise InputError(
            "holds files that cortet did not make", file=folder, remedy="give an empty or a new folder, or add --force"
        )


def _left_by_a_kill(path: Path) -> bool:
    """Whether cortet may have made this before the manifest beside it: a temporary file, or a folder with such."""
    if path.is_dir() and not path.is_symlink():
        return any(one.name == MANIFEST or _TEMPORARY.fullmatch(one.name) for one in path.iterdir())
    return _TEMPORARY.fullmatch(path.name) is not None


def _require_short(path: Path) -> None:
    """Raise InputError if the name, or the name of the temporary file beside it, would be too long."""
    folder = next((one for one in path.absolute().parents if one.is_dir()), Path("/"))
    longest = os.pathconf(folder, "PC_NAME_MAX") - len(temporary_beside(path).name) + len(path.name)
    if (size := len(os.fsencode(path.name))) > longest:
        what = f"has a name of {size} bytes, but at most {longest} are allowed here"
        raise InputError(what, file=path, remedy="give a shorter name")


def _refuse_repeated(outputs: tuple[Path, ...]) -> None:
    """Raise InputError if two outputs have the same name: the second would replace the first."""
    places = [os.path.realpath(path) for path in outputs]
    for path, place in zip(outputs, places, strict=True):
        if places.count(place) > 1:
            raise InputError("is named twice, for two outputs", file=path, remedy="give each a name of its own")


def _refuse_input(path: Path, guard: _Guard) -> None:
    """Raise InputError if a file is an input, even by another name."""
    identity = _identity(path)
    given = guard.inputs.get(identity) if identity else None
    if given is None or _identity(given) != identity:  # the input is gone, and another file has its inode
        return
    also = "" if given == path else f", {given}"
    raise InputError(f"is an input of this command{also}", file=path, remedy="give the output another name")


def _own_prefix() -> str:
    """Beginning of the temporary names of this process."""
    return f".{os.getpid()}-"


def _runs(process: int) -> bool:
    """Whether a process of this machine may run."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):  # another user's, or no number of a process
        return True
    return True


def _identity(path: Path) -> tuple[int, int] | None:
    """Device and inode of a file, which no other name changes; None if there is no file."""
    try:
        stat = path.stat()
    except (OSError, ValueError):
        return None
    return stat.st_dev, stat.st_ino
