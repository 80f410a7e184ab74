"""FreeSurfer files: surfaces (`lh.white`), and values (`lh.thickness`) and annotations (`lh.aparc.annot`) of vertices.

nibabel reads surfaces. This module reads values and annotations, since nibabel reserves whatever memory a damaged file
states.

Coordinates are in the tool's own space ("surface RAS", mm). The way to the scanner's space, if the file has it, becomes
the matrix of the coordinate frame (`formats.frames`).
"""

from __future__ import annotations

import logging
import struct
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from nibabel.freesurfer.io import read_geometry
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import frames
from cortet.formats.untrusted import GZIP, check_file, content, safe_name
from cortet.meshes import CoordinateFrame, TriSurface

logger = logging.getLogger(__name__)

#: first bytes of a file of triangles, of quadrangles, and of values or quadrangles with rounded coordinates
TRIANGLES, QUADRANGLES, VALUES = b"\xff\xff\xfe", b"\xff\xff\xfd", b"\xff\xff\xff"
_REMEDY = "run recon-all again, or export it as GIfTI (mris_convert)"
#: annotations: key of unlabelled vertices, most labels, and most characters of a name
_NONE, _MOST_LABELS, _LONGEST_NAME = -1, 100_000, 10_000


class Annotation(NamedTuple):
    """Content of an annotation."""

    #: name of the file's field -> (n,) int32, entry of the table for each vertex, -1 for no label
    field: dict[str, NDArray[np.int32]]
    #: entry -> name of the label
    names: dict[int, str]


def is_surface(head: bytes, size: int) -> bool:
    """Whether a file of `size` bytes that begins with `head` is a surface."""
    if head.startswith(VALUES):
        vertices, quadrangles = (int.from_bytes(head[begin : begin + 3], "big") for begin in (3, 6))
        return size == 9 + 6 * vertices + 12 * quadrangles
    return head.startswith((TRIANGLES, QUADRANGLES))


def is_values(head: bytes, size: int) -> bool:
    """Whether a file of `size` bytes that begins with `head` is a file of values."""
    return head.startswith(VALUES) and not is_surface(head, size)


def read_surface(path: Path, *, finite: bool = True) -> TriSurface:
    """Read a surface, of quadrangles two triangles each; if `finite` is false, its coordinates need not be finite."""
    remedy = "run recon-all again, or export the surface as GIfTI (mris_convert)"
    check_file(path)
    with path.open("rb") as file:
        if file.read(len(GZIP)) == GZIP:
            raise InputError("is a FreeSurfer surface packed by gzip", file=path, remedy="gunzip it")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without a footer is complete
        try:
            points, faces, footer = read_geometry(str(path), read_metadata=True)  # type: ignore[no-untyped-call]
        except (OSError, ValueError, IndexError, OverflowError, MemoryError, UnicodeDecodeError) as error:
            raise InputError(f"no complete FreeSurfer surface ({error})", file=path, remedy=remedy) from None
    if finite and not np.isfinite(points).all():
        raise InputError("coordinates are not finite", file=path, remedy=remedy)
    if len(faces) and not (faces.min() >= 0 and faces.max() < len(points)):
        what = f"triangles refer to vertices {faces.min()} to {faces.max()}, but there are {len(points)}"
        raise InputError(what, file=path, remedy=remedy)
    return TriSurface(points, faces, frame=_frame(footer, path))


def read_values(path: Path) -> dict[str, NDArray[Any]]:
    """The values of a file such as `lh.thickness`, named by the end of its name: (n,) float32."""
    data = content(path)
    try:
        vertices, _, columns = np.frombuffer(data, ">i4", 3, len(VALUES)).tolist()
        start = len(VALUES) + 12
        if columns != 1 or len(data) - start != 4 * vertices:
            raise ValueError(f"{len(data) - start} bytes for {vertices} x {columns} values")
        values = np.frombuffer(data, ">f4", vertices, start).astype(np.float32)
    except ValueError as error:
        raise InputError(f"no complete file of FreeSurfer's values ({error})", file=path, remedy=_REMEDY) from None
    return {_field_name(path): values}


def is_annotation(head: bytes, size: int) -> bool:
    """Whether a file of `size` bytes that begins with `head` is an annotation, whose vertices count from 0."""
    count = int(np.frombuffer(head[:4].ljust(4, b"\0"), ">i4")[0])
    if not (count > 0 and 4 + 8 * count <= size):
        return False
    numbered = np.frombuffer(head[4 : 4 + 8 * min(count, 100)], ">i4")[::2]
    return count > 1 and np.array_equal(numbered, np.arange(len(numbered)))


def read_annotation(path: Path) -> Annotation:
    """The labels of a file such as `lh.aparc.annot`.

    Source: https://surfer.nmr.mgh.harvard.edu/fswiki/LabelsClutsAnnotationFiles
    """
    data = content(path)
    try:
        count = int(np.frombuffer(data, ">i4", 1)[0])
        numbers = np.frombuffer(data, ">i4", 2 * count, 4).reshape(-1, 2)
        names, colours = _table(_Words(data, 4 + 8 * count))
    except (ValueError, struct.error, UnicodeDecodeError) as error:
        raise InputError(f"no complete annotation of FreeSurfer ({error})", file=path, remedy=_REMEDY) from None
    if not np.array_equal(np.sort(numbers[:, 0]), np.arange(count)):
        raise InputError("an annotation that does not name each vertex once", file=path, remedy=_REMEDY)
    of_vertex = np.empty(count, np.int64)
    of_vertex[numbers[:, 0]] = numbers[:, 1]
    order = np.argsort(colours, kind="stable")
    place = np.minimum(np.searchsorted(colours[order], of_vertex), len(colours) - 1)
    keys = np.array(list(names), np.int32)[order][place]
    labels = np.where(colours[order][place] == of_vertex, keys, _NONE).astype(np.int32)
    return Annotation({_field_name(path): labels}, names)


class _Words:
    """The numbers and texts of a file, one after the other."""

    def __init__(self, data: bytes, start: int) -> None:
        self.data, self.place = data, start

    def number(self) -> int:
        """The next number; struct.error if the file has ended."""
        (value,) = struct.unpack_from(">i", self.data, self.place)
        self.place += 4
        return int(value)

    def text(self) -> str:
        """The next text; its length precedes it."""
        length = self.number()
        if not 0 <= length <= _LONGEST_NAME or self.place + length > len(self.data):
            raise ValueError(f"a name of {length} characters")
        self.place += length
        return self.data[self.place - length : self.place].split(b"\0")[0].decode("utf-8", "replace")


def _table(words: _Words) -> tuple[dict[int, str], NDArray[np.int64]]:
    """Name of each entry of the table, and the number that encodes its colour."""
    if words.number() != 1:
        raise ValueError("it has no table of labels")
    first = words.number()
    if first > 0:  # older version: this is the number of entries
        words.text()
        count = first
    elif first == -2:
        words.number()
        words.text()
        count = words.number()
    else:
        raise ValueError(f"a table of version {-first}")
    if not 0 < count <= _MOST_LABELS:
        raise ValueError(f"a table of {count} labels")
    names, colours = {}, []
    for entry in range(count):
        key = entry if first > 0 else words.number()
        if not 0 <= key <= _MOST_LABELS or key in names:
            raise ValueError(f"an entry {key} of the table")
        names[key] = safe_name(words.text())
        red, green, blue, _ = (words.number() for _ in range(4))
        colours.append(red + (green << 8) + (blue << 16))
    return names, np.array(colours, np.int64)


def _field_name(path: Path) -> str:
    """The part of a file's name after the hemisphere: `thickness` of `lh.thickness`."""
    words = path.name.removesuffix(".annot").split(".")
    return safe_name(".".join(words[1:] or words))


def _frame(footer: dict[str, Any], path: Path) -> CoordinateFrame:
    """The place of the volume in a file's footer; none if the footer says that it is not valid, which is said."""
    valid = str(footer.get("valid", ""))
    if not valid.startswith("1"):
        if valid:
            logger.warning("%s: its footer says `valid = %s`: the coordinates are used as they are", path, valid)
        return CoordinateFrame()
    vectors = [footer[name] for name in ("xras", "yras", "zras", "cras")]
    if any(np.shape(vector) != (3,) for vector in vectors):
        raise InputError("no complete FreeSurfer surface (its footer lacks numbers)", file=path, remedy=_REMEDY)
    return frames.of_volume(np.stack(vectors[:3], axis=1), vectors[3], path, "its footer")
