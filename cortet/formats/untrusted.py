"""What every reader does: it takes the decompressed bytes of a file, and checks what it made of them.

Coordinates are finite, indices are in range, and an error names the file and the remedy. A file that is read becomes an
input, which nothing writes over (`cortet.formats.ownership`).
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from html import unescape
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError, counted
from cortet.formats.ownership import has_read
from cortet.meshes import MeshSets, TetMesh, TriSurface

_LONGEST_NAME = 80
#: first bytes of what is packed by gzip
GZIP = b"\x1f\x8b"
#: names of the files that hold what a file shows, by its ending
_NAMED = {
    ".pvd": rb'<DataSet\b[^>]*\bfile="([^"]+)"',
    ".pvtu": rb'<Piece\b[^>]*\bSource="([^"]+)"',
    ".xdmf": rb"([^\s/>]{1,255}\.h5):",
}
#: what is said of a file that cannot be opened
_READABLE = "check the path and its permissions"

_T = TypeVar("_T")


def is_there(path: str | Path) -> bool:
    """Whether a file exists, or a link to one whose content may be elsewhere."""
    return Path(path).is_file() or Path(path).is_symlink()


def content_is_elsewhere(path: str | Path) -> bool:
    """Whether a file is a link to what is not here, as DataLad and git-annex leave it until `datalad get`."""
    return Path(path).is_symlink() and not Path(path).exists()


def elsewhere(path: str | Path) -> InputError:
    """The error for a link to what is not here."""
    target = Path(path).readlink()
    if "annex" in target.parts or ".git" in target.parts:
        return InputError("is a link to a file that was not downloaded", file=path, remedy=f"datalad get {path}")
    return InputError(
        f"is a link to {target}, which is missing", file=path, remedy="restore that file, or name another"
    )


def require_named_files(path: Path) -> None:
    """Raise InputError if a file that a file of ParaView or XDMF names is missing: their readers say something else."""
    kind = path.suffix.lower()
    if kind not in _NAMED:
        return
    found = dict.fromkeys(re.findall(_NAMED[kind], content(path)))
    named = [unescape(name.decode("utf-8", "replace")) for name in found]
    missing = [name for name in named if not is_there(path.parent / name)]
    if missing:
        what = f"names {counted(len(missing), 'file that is', 'files that are')} missing, of {len(named)}: {missing[0]}"
        raise InputError(what, file=path, remedy="put them next to it, or correct their names in it")
    if not named and kind != ".xdmf":  # which may hold its values itself
        raise InputError("names no file", file=path, remedy="save it again: it is empty or damaged")
    for name in named:
        check_file(path.parent / name)


def check_file(path: str | Path) -> None:
    """Raise InputError unless a regular file is there; an input must not become an output."""
    if content_is_elsewhere(path):
        raise elsewhere(path)
    if not Path(path).is_file():
        what = "is not a file" if Path(path).exists() else "cannot be read: No such file or directory"
        raise InputError(what, file=path, remedy=_READABLE)
    has_read(Path(path))


def content(path: str | Path) -> bytes:
    """All bytes of a file, decompressed if gzipped. Raises InputError as `check_file`, or if they are damaged."""
    check_file(path)
    try:
        data = Path(path).read_bytes()
        return gzip.decompress(data) if data.startswith(GZIP) else data
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise DamagedFileError(f"cannot be decompressed: {error}", file=path) from error
    except OSError as error:
        raise unreadable(path, error) from error


def unreadable(path: str | Path, error: OSError) -> InputError:
    """The error for a file that the system cannot read, which in the middle of a file does not name it."""
    return InputError(f"cannot be read: {error.strerror}", file=path, remedy=_READABLE)


@contextmanager
def by_library(what: str, path: str | Path, kind_of: Callable[[Path], str] = lambda _: "") -> Iterator[None]:
    """Turn whatever a library raises for a file that it cannot read as `what` into InputError; one of cortet stays.

    Parameters
    ----------
    kind_of : says what the file is instead; empty if that is not known
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        told = f"is {kind}, not {what}" if (kind := kind_of(Path(path))) else f"cannot be read as {what}"
        raise DamagedFileError(f"{told}: {' '.join(str(error).split()) or type(error).__name__}", file=path) from error


def safe_name(text: str) -> str:
    """A name of a field or set, safe as part of a file name: without slashes, `..`, control and turning characters."""
    return (
        re.sub(r"[\x00-\x1f\x7f/\\\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]+|\.\.+", "_", text).strip()[
            :_LONGEST_NAME
        ]
        or "unnamed"
    )


def safely_named(values: Mapping[str, _T] | Iterable[tuple[str, _T]]) -> dict[str, _T]:
    """The same values by safe names; if a name is taken, a later value gets a number appended to it."""
    result: dict[str, _T] = {}
    for text, value in values.items() if isinstance(values, Mapping) else values:
        name, number = safe_name(text), 1
        while (numbered := name if number == 1 else f"{name}_{number}") in result:
            number += 1
        result[numbered] = value
    return result


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Name the file that arrays were read from in an InputError about these arrays."""
    try:
        yield
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(error.what, file=path, remedy="export it again") from None


def require_finite_points(points: NDArray[Any], path: str | Path) -> None:
    """Raise InputError if a coordinate (n, 3) is not finite."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        what = (
            f"{counted(len(bad), 'vertex has', 'vertices have')} coordinates that are not finite; the first "
            f"is vertex {bad[0]}"
        )
        raise DamagedFileError(what, file=path)


def triangulated(points: NDArray[Any], corners: NDArray[Any], path: str | Path) -> TriSurface:
    """The surface of vertices (n, 3) and triangles (m, 3) that were read, whole numbers of any type."""
    if not len(points) or not len(corners):
        raise DamagedFileError("holds no vertices or no triangles", file=path)
    require_finite_points(points, path)
    with naming(path):
        return TriSurface(points, corners)


def sound(
    path: str | Path,
    points: NDArray[Any],
    cells: NDArray[Any],
    point_data: Mapping[str, NDArray[Any]] | None = None,
    cell_data: Mapping[str, NDArray[Any]] | None = None,
    sets: MeshSets | None = None,
) -> TetMesh:
    """The mesh of arrays and sets that were read, shaped as in `TetMesh`, by safe names; InputError if not so."""
    require_finite_points(points, path)
    given = sets or MeshSets()
    named = MeshSets(*(safely_named(some) for some in (given.nodes, given.faces, given.cells)))
    with naming(path):
        return TetMesh(points, cells, safely_named(point_data or {}), safely_named(cell_data or {}), named)
