"""Whose a file is: a command never writes to its inputs, and replaces only files that cortet made.

`guarded` is the door. While a command runs within it, every function of cortet that replaces or deletes a file asks
`may_write` first, and every reader tells `has_read`: a file that a command has read is its input, also one that no
argument names, as a sidecar. What the command writes is listed with its SHA-256 in a hidden manifest of the folder. A
file that the manifest does not list, or that somebody changed since, belongs to the user. The workflow has no guard:
its rules name their outputs, and none of them is a file of the user. Its working folder has a marker instead.
"""

from __future__ import annotations

import fcntl
import json
import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cortet.errors import InputError
from cortet.formats.hashing import sha256

#: file that says of its folder that cortet made it; a folder of this name, in the output of a workflow, does not
MARKER = ".cortet"
#: file that lists what commands wrote to its folder: name -> the last SHA-256
MANIFEST = ".cortet.json"
#: hashes that a manifest keeps of a file: one that was replaced, or was about to be when the command was killed
_HASHES = 2
#: key and value by which a record is known from the JSON files of others
_SIGNATURE = {"made_by": "cortet"}
#: bytes of a record or a manifest
_LONGEST_RECORD = 100_000_000


@dataclass(frozen=True)
class _Guard:
    """What a command may write to."""

    #: device and inode of each input -> how it was named; those that are read on the way are added
    inputs: dict[tuple[int, int], Path]
    #: what the command is told to write
    files: tuple[Path, ...]
    #: below which it may write
    folders: tuple[Path, ...]
    #: the user has said that existing files may be replaced
    force: bool
    #: files that this command has written
    made: set[Path] = field(default_factory=set)

    def is_below_own_folder(self, place: Path) -> bool:
        """Whether a file lies in a folder of the command."""
        return any(map(place.is_relative_to, self.folders))


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
    """Run a command that reads some files and writes others; refuse it at once where it would harm the user's.

    Parameters
    ----------
    inputs : files that the command only reads
    files : what it is told to write
    shared : folders in which it writes files one by one, each guarded by itself
    folders : others, below which it may write
    force : existing files may be replaced, but never an input

    Raises
    ------
    InputError
        an output is an input, also by another name, or exists and was not made by cortet; or two have one name
    """
    known = {identity: path for path in inputs if (identity := _identity(path))}
    outputs = tuple(files)
    _refuse_repeated(outputs)
    token = _guard.set(_Guard(known, outputs, tuple(folder.absolute() for folder in folders), force))
    try:
        for path in outputs:
            may_write(path)
        for folder in shared:
            _require_own_folder(folder, force=force)
        yield
    finally:
        _guard.reset(token)


def may_write(path: Path) -> None:
    """Raise InputError unless a file may be written, replaced or deleted; without a guard, all with short names may."""
    _require_short(path)
    guard = _guard.get()
    if guard is None:
        return
    _refuse_input(path, guard)
    place = path.absolute()
    if path.is_dir() and not path.is_symlink():
        raise InputError("is a folder", file=path, remedy="give the name of a file")
    if path.exists() and not path.is_file():
        raise InputError("is a device or a pipe, not a file", file=path, remedy="give the name of a file")
    allowed = guard.force or place in guard.made or guard.is_below_own_folder(place)
    if not allowed and os.path.lexists(path) and not is_ours(path):
        raise InputError(
            "exists, and cortet did not make it as it is now",
            file=path,
            remedy="give another name, or add --force to replace it",
        )


def mark(folder: Path) -> None:
    """Say of a folder that cortet made it."""
    if not (folder / MARKER).is_dir():
        (folder / MARKER).touch()


def has_read(path: Path) -> None:
    """Note that the command reads a file: it is an input from now on, unless it lies where the command may write.

    Raises
    ------
    InputError
        the command is told to write to this file
    """
    guard = _guard.get()
    place = path.absolute()
    if guard is None or place in guard.made or guard.is_below_own_folder(place):
        return
    if identity := _identity(path):
        guard.inputs.setdefault(identity, path)
        for output in guard.files:
            if output.absolute() not in guard.made:
                _refuse_input(output, guard)


def about_to_write(temporary: Path, path: Path) -> None:
    """Note that a file is about to get its name. The manifest lists it before, so that a kill does no harm."""
    guard = _guard.get()
    if guard is None:
        return
    place = path.absolute()
    guard.made.add(place)
    if identity := _identity(temporary):
        guard.inputs.pop(identity, None)  # it was read back before it got its name
    within_temporary = path.parent.name.startswith(_own_prefix())  # the files of a folder get their names together
    if not within_temporary and not guard.is_below_own_folder(place):
        _list_in_manifest(path, sha256(temporary))


def temporary_beside(path: Path) -> Path:
    """A name of no file beside one, with its suffixes, for what will be renamed to it."""
    return path.with_name(f"{_own_prefix()}{secrets.token_hex(4)}.{path.name}")


def is_ours(path: Path) -> bool:
    """Whether the manifest of its folder lists a file with the SHA-256 that it has now."""
    if not path.is_file() or path.is_symlink():
        return False
    listed = _manifest(path.parent).get(path.name)
    return listed is not None and sha256(path) in listed


def delete(*paths: Path) -> None:
    """Delete files, those that there are, or none of them where one may not be; raises InputError as `may_write`."""
    for path in paths:
        may_write(path)
    for path in paths:
        path.unlink(missing_ok=True)


def record_of(paths: Iterable[Path]) -> dict[str, Any]:
    """What makes a JSON file the record of the files that were made with it."""
    return {**_SIGNATURE, "files": {path.name: sha256(path) for path in paths}}


def files_of(record: Path) -> dict[str, str]:
    """Name -> SHA-256 of the files that a record lists; nothing where the file is no record of cortet."""
    data = json_of(record)
    files = data.get("files") if data.items() >= _SIGNATURE.items() else None
    return {str(name): str(digest) for name, digest in files.items()} if isinstance(files, dict) else {}


def delete_made(record: Path) -> None:
    """Delete the files that a record lists, where they are as it lists them, and the record itself."""
    files = files_of(record)
    for name, digest in files.items():
        path = record.parent / name
        own = Path(name).name == name and os.path.isfile(path)  # noqa: PTH113, false of names that no file can have
        if own and not path.is_symlink() and sha256(path) == digest:
            delete(path)
    if files:
        delete(record)


def json_of(file: Path) -> dict[str, Any]:
    """Content of a JSON file; nothing where it is none."""
    try:
        data = json.loads(file.read_text("utf-8")) if file.stat().st_size < _LONGEST_RECORD else None
    except (OSError, ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _manifest(folder: Path) -> dict[str, list[str]]:
    """Name -> hashes; nothing where there is no manifest, or a damaged one."""
    files = json_of(folder / MANIFEST).get("files")
    if not isinstance(files, dict):
        return {}
    return {str(name): [str(one) for one in found] for name, found in files.items() if isinstance(found, list)}


def _list_in_manifest(path: Path, digest: str) -> None:
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(folder, fcntl.LOCK_EX)
        files = _manifest(path.parent)
        known = [one for one in files.get(path.name, []) if one != digest]
        files[path.name] = [*known, digest][-_HASHES:]
        manifest = path.with_name(MANIFEST)
        temporary = temporary_beside(manifest)
        temporary.write_text(json.dumps({"files": files}, indent=1) + "\n", encoding="utf-8")
        temporary.replace(manifest)
    finally:
        os.close(folder)


def _require_own_folder(folder: Path, *, force: bool) -> None:
    """Raise InputError for a folder with files, but without a manifest of what cortet wrote there."""
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError("is a file", file=folder, remedy="give the name of a folder")
    if folder.is_dir() and not (folder / MANIFEST).is_file() and any(folder.iterdir()) and not force:
        raise InputError(
            "holds files that cortet did not make", file=folder, remedy="give an empty or a new folder, or add --force"
        )


def _require_short(path: Path) -> None:
    """Raise InputError for a name that is too long, or that of the temporary file beside it would be."""
    folder = next((one for one in path.absolute().parents if one.is_dir()), Path("/"))
    longest = os.pathconf(folder, "PC_NAME_MAX") - len(temporary_beside(path).name) + len(path.name)
    if (size := len(os.fsencode(path.name))) > longest:
        what = f"has a name of {size} bytes, and one of at most {longest} can be written"
        raise InputError(what, file=path, remedy="give a shorter name")


def _refuse_repeated(outputs: tuple[Path, ...]) -> None:
    """Raise InputError where two outputs have one name: the second would replace the first."""
    places = [os.path.realpath(path) for path in outputs]
    for path, place in zip(outputs, places, strict=True):
        if places.count(place) > 1:
            raise InputError("is named twice, for two outputs", file=path, remedy="give each a name of its own")


def _refuse_input(path: Path, guard: _Guard) -> None:
    """Raise InputError where a file is an input, also by another name."""
    identity = _identity(path)
    given = guard.inputs.get(identity) if identity else None
    if given is None or _identity(given) != identity:  # a file that is gone: another one has got its place on the disk
        return
    also = "" if given == path else f", {given}"
    raise InputError(f"is an input of this command{also}", file=path, remedy="give the output another name")


def _own_prefix() -> str:
    """What temporary names of this process begin with."""
    return f".{os.getpid()}-"


def _identity(path: Path) -> tuple[int, int] | None:
    """What a file is on its disk, whatever its name; None where there is none."""
    try:
        stat = path.stat()
    except (OSError, ValueError):
        return None
    return stat.st_dev, stat.st_ino
