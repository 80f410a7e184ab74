"""A file appears under its name only when it is complete."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cortet.errors import InputError
from cortet.formats.ownership import (
    about_to_write,
    delete_abandoned,
    delete_made,
    is_temporary,
    may_write,
    record_of,
    temporary_beside,
)


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary name beside `path`, with its suffixes, that is renamed to `path` when the block ends without error.

    A missing folder is created. After an error the temporary file is deleted and `path` is unchanged.
    """
    path = Path(path)
    may_write(path)
    _make_folder(path.parent)
    temporary = temporary_beside(path)
    try:
        with _full_disk_named(path):
            yield temporary
            about_to_write({temporary: path})
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: str | Path, *, replaced: Iterable[Path] = ()) -> Iterator[Path]:
    """A temporary folder beside `path`, whose files move to the folder of `path` when the block ends without error.

    Formats whose files name each other need this: in this folder the files have their final names. Nothing of an
    earlier command is deleted before all new files are complete.

    Parameters
    ----------
    replaced : records of an earlier command; they and the files that they list are deleted before the new files move

    Raises
    ------
    InputError
        the folder cannot be written to, or a command that is `guarded` may not write to one of the files; then none is
        moved
    """
    path = Path(path)
    may_write(path)
    _make_folder(path.parent)
    delete_abandoned(path.parent, path.name)
    temporary = temporary_beside(path)
    temporary.mkdir()
    try:
        with _full_disk_named(path):
            yield temporary
            # the file that was asked for, and its sidecar, come last: after a kill it is there only with all others
            files = sorted(temporary.iterdir(), key=lambda file: (file.name.startswith(path.name), file.name))
            for file in files:
                may_write(path.with_name(file.name))
            about_to_write({file: path.with_name(file.name) for file in files})
        for record in replaced:
            delete_made(record)
        for file in files:
            file.replace(path.with_name(file.name))
    finally:
        shutil.rmtree(temporary)


@contextmanager
def _full_disk_named(path: Path) -> Iterator[None]:
    """Raise InputError that names a file that could not be written, unless it lies in a temporary folder."""
    try:
        yield
    except OSError as error:
        if is_temporary(path.parent):
            raise
        if error.errno == errno.EIO:  # which names no file
            remedy = "check the disk, or give a folder on another one"
            raise InputError(f"cannot be written: {error.strerror}", file=path, remedy=remedy) from error
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        free = shutil.disk_usage(path.parent).free // 1000
        remedy = "free some space, or give a folder on another disk"
        raise InputError(f"cannot be written: its disk has only {free} kB left", file=path, remedy=remedy) from error


def _make_folder(folder: Path) -> None:
    """Make a folder if it is missing; raises InputError that names it if no file can be written there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        why = "" if os.access(folder, os.W_OK | os.X_OK) else "no permission, or a read-only file system"
    except OSError as error:
        why = str(error.strerror)
    if why:
        raise InputError(f"cannot write to this folder: {why}", file=folder, remedy="give another folder")


def write_json(data: Any, path: str | Path) -> None:
    """Write `data` as indented JSON, complete or not at all; NaN and infinity, which JSON lacks, raise ValueError."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(data, indent=2, allow_nan=False) + "\n")


def write_record(content: Mapping[str, Any], path: Path) -> None:
    """Write a report that lists the files beside it, which were made with it, so that a later run may replace them."""
    write_json({**content, **record_of(sorted(path.parent.iterdir()))}, path)
