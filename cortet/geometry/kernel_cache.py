"""Where Numba keeps compiled kernels: once per machine, user and source, not once per checkout.

Numba's own cache lies beside the source and notices an edit of the file that a kernel stands in, not of one that it
calls or takes constants from. Here the key is the source of the kernel's module and of every module of cortet that it
imports, directly or not; so a stale kernel cannot be used, and a fresh clone finds what another one has compiled.
The processor and the versions of Python and Numba are in Numba's own index.

`cortet/__init__.py` names this class in `NUMBA_CACHE_LOCATOR_CLASSES`, before Numba is imported.
"""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching

_PACKAGE = Path(__file__).parents[1]


class KernelCacheLocator(caching._SourceFileBackedLocatorMixin, caching._CacheLocator):
    """Places the compiled kernels of this package; answers None for functions of others."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        self._py_file = py_file
        self._lineno = py_func.__code__.co_firstlineno
        self._key = source_key(Path(py_file))

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> KernelCacheLocator | None:
        """The place of a kernel; None where it is not ours or cannot be written to."""
        if _PACKAGE not in Path(py_file).parents:
            return None
        found: KernelCacheLocator | None = super().from_function(py_func, py_file)  # type: ignore[no-untyped-call]
        return found

    def get_cache_path(self) -> str:
        """Folder of the compiled code."""
        return str(cache_folder() / self._key)

    def get_source_stamp(self) -> str:
        """What Numba compares before it uses compiled code."""
        return self._key


def cache_folder() -> Path:
    """Folder of all compiled kernels of this user."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "cortet" / "kernels"


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
def _imports(module: Path) -> tuple[Path, ...]:
    """Files of the modules of cortet that a module imports when it is loaded."""
    body = ast.parse(module.read_text(encoding="utf-8")).body
    return tuple(path for node in body for name in _names(node) if (path := _file(name)) is not None)


def _names(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module:
        yield node.module
        yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _file(name: str) -> Path | None:
    """The file of a module of cortet; None for a package, a name in a module, or a module of others."""
    package, *parts = name.split(".")
    path = _PACKAGE.joinpath(*parts).with_suffix(".py")
    return path if package == "cortet" and parts and path.is_file() else None
