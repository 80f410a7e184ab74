"""What every reader does: it takes the bytes of a file, unpacked, and checks what it made of them.

Coordinates are finite, indices are in range, and an error names the file and the remedy. A file that is read becomes an
input, which nothing writes over (`cortet.formats.ownership`).
"""

from __future__ import annotations

import gzip
import re
import stat
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.ownership import has_read
from cortet.meshes import MeshSets, TetMesh, TriSurface

_LONGEST_NAME = 80
#: first bytes of what is packed by gzip
GZIP = b"\x1f\x8b"
#: what is said of a link whose content is not here
ELSEWHERE = "is a link whose content is not here"
#: errors that parsers raise for XML that is truncated, not well-formed, or in an unknown encoding
XML_ERRORS = (ElementTree.ParseError, LookupError, ValueError)

_T = TypeVar("_T")


def is_there(path: str | Path) -> bool:
    """Whether a file exists, or a link to one whose content may be elsewhere."""
    return Path(path).is_file() or Path(path).is_symlink()


def content_is_elsewhere(path: str | Path) -> bool:
    """Whether a file is a link to what is not here, as DataLad and git-annex leave it until `datalad get`."""
    return Path(path).is_symlink() and not Path(path).exists()


def check_file(path: str | Path) -> None:
    """Raise InputError unless a regular file is there, and may be read; an input must not become an output."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError) as error:
        if content_is_elsewhere(path):
            raise InputError(ELSEWHERE, file=path, remedy=f"datalad get {path}") from error
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read: {reason}", file=path, remedy="check the path and its permissions") from error
    if not stat.S_ISREG(found.st_mode):
        raise InputError("is not a file", file=path, remedy="name a file, not a folder or a device")
    has_read(Path(path))


def content(path: str | Path) -> bytes:
    """All bytes of a file, unpacked from gzip. Raises InputError as `check_file`, or if they cannot be unpacked."""
    check_file(path)
    try:
        data = Path(path).read_bytes()
        return gzip.decompress(data) if data.startswith(GZIP) else data
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise DamagedFileError(f"cannot be unpacked: {error}", file=path) from error
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror}", file=path, remedy="check the path and its permissions"
        ) from error


def xml_root(text: bytes, path: str | Path) -> ElementTree.Element:
    """The tree of an XML text; raises DamagedFileError if it is truncated or not well-formed."""
    try:
        return ElementTree.fromstring(text)
    except XML_ERRORS as error:
        raise DamagedFileError(f"is not well-formed XML: {error}", file=path) from error


def numbers(text: str, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The numbers of a text, separated by white space; ValueError if one is not a number of `dtype`."""
    kind = int if np.issubdtype(dtype, np.integer) else float
    try:
        return np.fromiter(map(kind, text.split()), dtype)
    except OverflowError as error:
        raise ValueError(f"a number is too large for {dtype}") from error


def safe_name(text: str) -> str:
    """A name of a field or set, safe as part of a file name: without slashes, `..` and control characters."""
    return re.sub(r"[\x00-\x1f\x7f/\\\u2028\u2029\ud800-\udfff]+|\.\.+", "_", text).strip()[:_LONGEST_NAME] or "unnamed"


def safely_named(values: Mapping[str, _T] | Iterable[tuple[str, _T]]) -> dict[str, _T]:
    """The same values by safe names; if a name is taken, a later value gets a number appended to it."""
    result: dict[str, _T] = {}
    times: Counter[str] = Counter()
    for text, value in values.items() if isinstance(values, Mapping) else values:
        name = base = safe_name(text)
        while name in result:
            times[base] += 1
            name = f"{base}_{times[base] + 1}"
        result[name] = value
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


def in_range(indices: NDArray[Any], count: int, what: str, path: str | Path) -> NDArray[np.int32]:
    """Indices as int32; InputError unless all are at least 0 and below `count`."""
    outside = (indices < 0) | (indices >= count)
    if outside.any():
        raise DamagedFileError(f"{what} {indices[outside][0]} does not exist: there are {count:,}", file=path)
    return indices.astype(np.int32)


def require_ascii(names: Iterable[str], path: str | Path) -> None:
    """Raise InputError for a name that a file of ASCII characters cannot hold."""
    if other := [name for name in names if not name.isascii()]:
        what = f"the name {other[0]!r} contains characters that the format does not allow"
        raise InputError(what, file=path, remedy="use plain letters in the names of fields and sets")


def triangulated(points: NDArray[Any], corners: NDArray[Any], path: str | Path) -> TriSurface:
    """The surface of vertices (n, 3) and triangles (m, 3) that were read, whole numbers of any type."""
    remedy = "export the surface again"
    if not len(points) or not len(corners):
        raise InputError("holds no vertices or no triangles", file=path, remedy=remedy)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        what = f"{len(bad)} vertices have coordinates that are not finite, the first is vertex {bad[0]}"
        raise InputError(what, file=path, remedy=remedy)
    outside = ~((corners >= 0) & (corners < len(points))).all(axis=1) | (corners != np.floor(corners)).any(axis=1)
    if outside.any():
        first = int(np.argmax(outside))
        what = f"triangle {first} is {corners[first].tolist()}, but vertices run from 0 to {len(points) - 1}"
        raise InputError(what, file=path, remedy=remedy)
    return TriSurface(points, corners.astype(np.int32))


def sound(
    path: str | Path,
    points: NDArray[Any],
    cells: NDArray[Any],
    point_data: Mapping[str, NDArray[Any]] | None = None,
    cell_data: Mapping[str, NDArray[Any]] | None = None,
    sets: MeshSets | None = None,
) -> TetMesh:
    """The mesh of arrays and sets that were read, shaped as in `TetMesh`, with safe names.

    Raises
    ------
    InputError
        a coordinate is not finite; the shape of an array is not that of `TetMesh`; a field does not have one value per
        node or tetrahedron; a tetrahedron or set names a node or tetrahedron that does not exist
    """
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        what = f"{len(bad)} nodes have coordinates that are not finite, the first is {points[bad[0]].tolist()}"
        raise InputError(what, file=path, remedy="export the mesh again")
    given = sets or MeshSets()
    within = MeshSets(
        {name: in_range(members, len(points), "node", path) for name, members in safely_named(given.nodes).items()},
        {name: in_range(members, len(points), "node", path) for name, members in safely_named(given.faces).items()},
        {name: in_range(members, len(cells), "element", path) for name, members in safely_named(given.cells).items()},
    )
    with naming(path):
        return TetMesh(points, cells, safely_named(point_data or {}), safely_named(cell_data or {}), within)
