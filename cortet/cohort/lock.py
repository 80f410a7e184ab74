"""One run at a time writes to an output folder, wherever and on whatever machine it was started.

Snakemake's own lock lies in the folder it was started in, and does not know of a run of another checkout.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import socket
from pathlib import Path
from typing import IO

from cortet.errors import InputError

NAME = ".cortet.lock"
#: environment variable of a run whose parent holds the lock: the id of the parent
HELD_BY = "CORTET_LOCK_HELD_BY"

#: what file systems answer that know no locks
_WITHOUT_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL}

logger = logging.getLogger(__name__)


def hold(folder: Path) -> IO[str]:
    """Lock a folder, which is made if it is missing, until the file that is returned is closed or the process ends.

    It is a POSIX record lock: the system takes it back however the process ends, so there is never one to remove by
    hand, and NFS asks its server for it. The file stays; it says who has the lock. Children do not inherit the lock.

    Raises
    ------
    InputError
        another process has the lock, or the folder cannot be written to
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / NAME).open("a+", encoding="utf-8")
        _lock(file, folder)
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}, started in {Path.cwd()}")
        file.flush()
    except OSError as error:
        what = f"cannot be written to: {error.strerror}"
        raise InputError(what, file=folder, remedy="mend its permissions or space, or set output") from error
    return file


def is_held_by_parent() -> bool:
    """Whether the process that started this one holds the lock for it."""
    return os.environ.get(HELD_BY) == str(os.getppid())


def _lock(file: IO[str], folder: Path) -> None:
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _WITHOUT_LOCKS:
            logger.warning("%s: its file system has no locks; see to it that only one run writes there", folder)
            return
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            raise
        file.seek(0)
        owner = file.read() or "another process"
        file.close()
        raise InputError(
            f"another run writes to it: {owner}", file=folder, remedy="wait for its end, or set output"
        ) from None
