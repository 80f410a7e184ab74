"""FreeSurfer files: surfaces (`lh.white`), and values (`lh.thickness`) and annotations (`lh.aparc.annot`) of vertices.

Coordinates are in the tool's own space ("surface RAS", mm). The way to the scanner's space, if the file has it, becomes
the matrix of the coordinate frame (`formats.frames`).
"""

from __future__ import annotations

import logging
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from nibabel.freesurfer.io import read_annot, read_geometry
from numpy.typing import NDArray

from cortet.formats import frames
from cortet.formats.untrusted import by_library, check_file, content, naming, require_finite_points, safe_name
from cortet.meshes import CoordinateFrame, TriSurface

logger = logging.getLogger(__name__)

#: first bytes of a surface of triangles or of quadrangles, and of a file of values
SURFACES, VALUES = (b"\xff\xff\xfe", b"\xff\xff\xfd"), b"\xff\xff\xff"
#: end of the name of an annotation
ANNOTATION = ".annot"
#: axes of the volume in the footer of a surface
_AXES = ("xras", "yras", "zras")
#: key of vertices without a label in an annotation
_NONE = -1


class Values(NamedTuple):
    """Content of a file of values or of an annotation."""

    #: name of the file's field -> (n,) numbers, or labels in int32, -1 for none
    field: dict[str, NDArray[Any]]
    #: label -> name
    names: dict[int, str]


def is_rounded(head: bytes, size: int) -> bool:
    """Whether a file is FreeSurfer's oldest form of a surface, of quadrangles: it begins as a file of values does."""
    vertices, quads = (int.from_bytes(head[at : at + 3], "big") for at in (3, 6))
    return head.startswith(VALUES) and size >= 9 + 6 * vertices + 12 * quads > 9 and vertices > 3


def read_surface(path: Path, *, finite: bool = True) -> TriSurface:
    """Read a surface, of quadrangles two triangles each; if `finite` is false, its coordinates need not be finite."""
    check_file(path)
    with warnings.catch_warnings(), by_library("an uncompressed FreeSurfer surface", path):
        warnings.simplefilter("ignore")  # a file without a footer is complete
        points, faces, footer = read_geometry(str(path), read_metadata=True)  # type: ignore[no-untyped-call]
        frame = _frame(footer, path)
    if finite:
        require_finite_points(points, path)
    with naming(path):
        return TriSurface(points, faces, frame=frame)


def read_values(path: Path) -> Values:
    """The values of a file such as `lh.thickness`, named by the end of its name: (n,) float32."""
    data = content(path)
    start = len(VALUES) + 12
    with by_library("FreeSurfer values", path):
        vertices, _, columns = np.frombuffer(data, ">i4", 3, len(VALUES)).tolist()
        if columns != 1 or len(data) - start != 4 * vertices:
            raise ValueError(f"{len(data) - start} bytes cannot hold {vertices} x {columns} values")
        return Values({_field_name(path): np.frombuffer(data, ">f4", vertices, start).astype(np.float32)}, {})


def read_annotation(path: Path) -> Values:
    """The labels of a file such as `lh.aparc.annot`, by their place in its table, which leaves out no number."""
    check_file(path)
    with by_library("an uncompressed FreeSurfer annotation", path):
        of_vertex, table, names = read_annot(str(path), orig_ids=True)  # type: ignore[no-untyped-call]
        colours = table[:, 4]
        if len(names) != len(colours):
            raise ValueError("its table omits label numbers: convert it with mris_convert --annot")
        ends = [colour.tobytes() for colour in table[:, :4].astype(">i4")]  # NumPy reads less than was asked for
        if not path.read_bytes().endswith(tuple(ends)):
            raise ValueError("its table is cut off")
        order = np.argsort(colours, kind="stable")
        keys = order[np.minimum(np.searchsorted(colours[order], of_vertex), len(colours) - 1)]
    labels = np.where(colours[keys] == of_vertex, keys, _NONE).astype(np.int32)
    texts = (safe_name(name.decode("utf-8", "replace")) for name in names)
    return Values({_field_name(path): labels}, dict(enumerate(texts)))


def _field_name(path: Path) -> str:
    """The part of a file's name after the hemisphere: `thickness` of `lh.thickness`."""
    words = path.name.removesuffix(ANNOTATION).split(".")
    return safe_name(".".join(words[1:] or words))


def _frame(footer: dict[str, Any], path: Path) -> CoordinateFrame:
    """The frame of the volume in a file's footer; the identity, with a warning, if the footer calls it invalid."""
    valid = str(footer.get("valid", ""))
    if not valid.startswith("1"):
        if valid:
            logger.warning("%s: its footer says `valid = %s`; cortet uses the coordinates unchanged", path, valid)
        return CoordinateFrame()
    if short := [name for name in (*_AXES, "cras") if np.size(footer.get(name, ())) != 3]:
        raise ValueError(f"its footer needs 3 values of {short[0]}")
    axes, centre = np.stack([footer[name] for name in _AXES], axis=1), footer["cras"]
    return frames.of_volume(axes, centre, path, "footer")
