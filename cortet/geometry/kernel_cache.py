"""Where Numba keeps compiled kernels: one copy per machine, user and source, not one per checkout.

Numba's own cache lies beside the source. It notices an edit of the kernel's file, but not an edit of a file from which
the kernel takes functions or constants. Here the key is the source of the kernel's module and of every module of cortet
that it imports, directly or not. So a stale kernel cannot be used, and a fresh clone finds what another clone has
compiled. Numba's own index holds the processor and the versions of Python and Numba.

`cortet/__init__.py` names this class in `NUMBA_CACHE_LOCATOR_CLASSES`, before Numba is imported.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import logging
import os
import stat
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

from cortet.errors import CortetError

logger = logging.getLogger(__name__)

#: processes that were forked after threads of GNU OpenMP ran, which ends them at the first kernel, without a word
_FORKED: set[int] = set()
_PACKAGE = Path(__file__).parents[1]


class KernelCacheLocator(caching._SourceFileBackedLocatorMixin, caching._CacheLocator):
    """Tells Numba where the compiled kernels of this package are; None for functions of other packages."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._py_file = py_file
        self._lineno = py_func.__code__.co_firstlineno
        self._key = source_key(Path(py_file))

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> KernelCacheLocator | None:
        """The locator of a kernel; None if the kernel is not ours, or its folder cannot be written to."""
        if _PACKAGE not in Path(py_file).parents:
            return None
        found: KernelCacheLocator | None = super().from_function(py_func, py_file)  # type: ignore[no-untyped-call]
        return found

    def get_cache_path(self) -> str:
        """Folder of the compiled code."""
        return str(cache_folder() / self._key)

    def get_source_stamp(self) -> str:
        """The stamp that Numba compares before it uses compiled code."""
        return self._key


def require_threads() -> None:
    """Raise CortetError in a process that was forked after kernels ran in threads: OpenMP cannot run there."""
    if os.getpid() in _FORKED:
        raise CortetError(
            "this process was forked after cortet had run, and the threads of its kernels cannot run here",
            remedy='start processes with multiprocessing.get_context("spawn"), or use threads',
        )


def _note_fork() -> None:
    with contextlib.suppress(ValueError):  # no kernel has run in threads yet
        if numba.threading_layer() == "omp":  # type: ignore[attr-defined]
            _FORKED.add(os.getpid())


os.register_at_fork(after_in_child=_note_fork)


def cache_folder() -> Path:
    """Folder of all compiled kernels of this user; a temporary folder, with a warning, if the cache is not writable."""
    try:
        own = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
        home = Path(own) if own else Path.home() / ".cache"
        folder = home / "cortet" / "kernels"
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK | os.X_OK)
    except (OSError, RuntimeError):  # RuntimeError: there is no home
        writable = False
    if writable:
        return folder
    temporary = _own_temporary_folder()
    logger.warning("no folder for compiled code can be written to; cortet uses %s (or set XDG_CACHE_HOME)", temporary)
    os.environ["XDG_CACHE_HOME"] = str(temporary)  # for Snakemake and its jobs, too
    os.environ.pop("NUMBA_CACHE_DIR", None)
    return cache_folder()


def _own_temporary_folder() -> Path:
    """A folder that only this user can write to, the same in every process: compiled code is loaded from there."""
    folder = Path(tempfile.gettempdir()) / f"cortet-{os.getuid()}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077:
            return folder
    return Path(tempfile.mkdtemp(prefix="cortet-"))


@cache
def source_key(module: Path) -> str:
    """Hash of the source of a module and of all modules of cortet that it imports, directly or not."""
    known, waiting = {module}, [module]
    while waiting:
        for imported in _imports(waiting.pop()):
            if imported not in known:
                known.add(imported)
                waiting.append(imported)
    digest = hashlib.sha256()
    for path in sorted(known):
        digest.update(path.relative_to(_PACKAGE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:20]


@cache
def _imports(module: Path) -> list[Path]:
    """Files of the modules of cortet that a module imports when it is loaded."""
    names: list[str] = []
    for node in ast.parse(module.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    ours = [name.split(".")[1:] for name in names if name.startswith("cortet.")]
    paths = [_PACKAGE.joinpath(*parts).with_suffix(".py") for parts in ours]
    return [path for path in paths if path.is_file()]  # the others are packages, and names in modules
