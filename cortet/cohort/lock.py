"""Only one run at a time writes to an output folder, whatever folder or machine it was started in.

Snakemake's own lock is in the folder where it was started, so it does not know of a run of another checkout, and it
outlives a killed run; profiles/default switches it off.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import logging
import os
import socket
from pathlib import Path
from typing import IO

from cortet.errors import InputError

NAME = ".cortet.lock"
#: errors of file systems without locks
_WITHOUT_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}

logger = logging.getLogger(__name__)


def hold(folder: Path) -> IO[str]:
    """Lock a folder until the returned file is closed or the process ends; a missing folder is made.

    It is a POSIX record lock. The system releases it however the process ends, so nobody ever removes one by hand; on
    NFS the server keeps it. The file stays; it says who has the lock. Children do not inherit the lock. Raises
    InputError if another process has the lock.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / NAME).open("a+", encoding="utf-8")
        _lock(file, folder, fcntl.LOCK_EX)
        file.truncate(0)
        file.write(f"{_owner(os.getpid())}, started in {Path.cwd()}")
        file.flush()
    except OSError as error:
        what = f"cannot be written to: {error.strerror}"
        remedy = "correct its permissions, free some space, or choose another output folder"
        raise InputError(what, file=folder, remedy=remedy) from error
    return file


def require_free(folder: Path) -> None:
    """Raise InputError if another process has the lock of a folder, unless it started this one. Nothing is written.

    This process must not have the lock: it would lose it.
    """
    if is_held_by_parent(folder):
        return
    with contextlib.suppress(OSError), (folder / NAME).open(encoding="utf-8") as file:
        _lock(file, folder, fcntl.LOCK_SH)


def is_held_by_parent(folder: Path) -> bool:
    """Whether the process that started this one holds the lock of a folder."""
    with contextlib.suppress(OSError), (folder / NAME).open(encoding="utf-8") as file:
        if file.read().startswith(f"{_owner(os.getppid())},"):
            try:
                fcntl.lockf(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return True  # the text alone may be that of an earlier process with this number
    return False


def _owner(process: int) -> str:
    return f"process {process} on {socket.gethostname()}"


def _lock(file: IO[str], folder: Path, kind: int) -> None:
    try:
        fcntl.lockf(file, kind | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _WITHOUT_LOCKS:
            logger.warning("%s: the file system has no locks; make sure that only one run writes there", folder)
            return
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            raise
        file.seek(0)
        owner = file.read() or "another process"
        file.close()
        raise InputError(
            f"another run is writing to this folder: {owner}",
            file=folder,
            remedy="wait for that run to end, or choose another output folder",
        ) from None
