"""PLY surfaces, text and binary (Turk 1994): vertices and triangles are read; other properties are ignored."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.untrusted import content, numbers, triangulated
from cortet.meshes import TriSurface

MAGIC = b"ply"
_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
#: name of any list other than the corners of faces
_LIST = "another list"
_REMEDY = "export the surface again as GIfTI (.surf.gii)"


class _Element(NamedTuple):
    name: str
    number: int
    #: name and type of each property; the list of a face has its `length`, then its three `vertices`
    properties: list[tuple[str, str]]


def read(path: str | Path) -> TriSurface:
    """Read a surface of triangles, mm.

    Raises
    ------
    InputError
        the file is missing, truncated or no PLY; it has no vertices with x, y and z or faces other than triangles; a
        coordinate is not finite, or a triangle refers to a vertex that does not exist
    """
    data = content(path)
    header, mark, body = data.partition(b"end_header")
    try:
        if not mark:
            raise ValueError("it has no header that ends")
        order, elements, complete = _described(header.decode("ascii"))
        body = body.partition(b"\n")[2]
        values, rest = _of_text(body, elements) if not order else _of_bytes(body, elements, order)
        if complete and rest:
            numbers_of = " and ".join(f"{element.number:,} {element.name} elements" for element in elements)
            raise ValueError(f"it goes on after its {numbers_of}: {rest:,} {'bytes' if order else 'numbers'} are left")
        points = np.stack([values["vertex"][axis] for axis in "xyz"], axis=1).astype(float)
        return triangulated(points, values["face"]["vertices"], path)
    except (KeyError, IndexError, ValueError, OverflowError) as error:
        raise InputError(f"is not a readable PLY surface of triangles: {error}", file=path, remedy=_REMEDY) from error


def _described(header: str) -> tuple[str, list[_Element], bool]:
    """The byte order (empty for text), the elements up to the vertices and faces, and whether these are all."""
    order, elements = None, list[_Element]()
    for words in map(str.split, header.splitlines()):
        if words[:1] == ["format"]:
            order = _ORDERS[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[:2] == ["property", "list"] and elements:
            again = "vertices" in dict(elements[-1].properties)
            name = _LIST if again or elements[-1].name != "face" else "vertices"
            elements[-1].properties.extend([("length", _TYPES[words[2]]), (name, _TYPES[words[3]])])
        elif words[:1] == ["property"] and elements:
            elements[-1].properties.append((words[2], _TYPES[words[1]]))
    names = [element.name for element in elements]
    if order is None or "vertex" not in names or "face" not in names:
        raise ValueError("it has no format, no vertices or no faces")
    found = elements[: max(names.index("vertex"), names.index("face")) + 1]
    if any(_LIST in dict(element.properties) for element in found):
        raise ValueError("it has lists other than that of the corners of faces")
    if any(element.number < 0 for element in found) or "vertices" not in dict(found[names.index("face")].properties):
        raise ValueError("its faces are not lists of corners, or a number is below 0")
    return order, found, len(found) == len(elements)


def _of_bytes(body: bytes, elements: list[_Element], order: str) -> tuple[dict[str, dict[str, NDArray[Any]]], int]:
    """The values of each element of a binary file, and the number of bytes left, but for blanks at the end.

    ValueError if values are missing, or faces are not triangles.
    """
    start, found = 0, {}
    for element in elements:
        kind = np.dtype(
            [
                (f"{n}", f"{order}{t}", (3,) if name == "vertices" else ())
                for n, (name, t) in enumerate(element.properties)
            ]
        )
        if element.number * kind.itemsize > len(body) - start:
            raise ValueError(
                f"it ends before its {element.number:,} elements {element.name} do, or not all are triangles"
            )
        rows = np.frombuffer(body, kind, element.number, start)
        found[element.name] = _triangles({name: rows[f"{n}"] for n, (name, _) in enumerate(element.properties)})
        start += rows.nbytes
    return found, len(body[start:].strip())


def _of_text(body: bytes, elements: list[_Element]) -> tuple[dict[str, dict[str, NDArray[Any]]], int]:
    """The values of each element of a text file, and the number of values left; ValueError as for a binary file."""
    values, start, found = numbers(body.decode("ascii"), np.dtype(float)), 0, {}
    for element in elements:
        width = sum(3 if name == "vertices" else 1 for name, _ in element.properties)
        if element.number * width > len(values) - start:
            raise ValueError(
                f"it ends before its {element.number:,} elements {element.name} do, or not all are triangles"
            )
        rows = values[start : start + element.number * width].reshape(element.number, width)
        columns, at = dict[str, NDArray[Any]](), 0
        for name, _ in element.properties:
            columns[name] = rows[:, at : at + 3] if name == "vertices" else rows[:, at]
            at += 3 if name == "vertices" else 1
        found[element.name] = _triangles(columns)
        start += rows.size
    return found, len(values) - start


def _triangles(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    if "length" in columns and "vertices" in columns and (columns["length"] != 3).any():
        raise ValueError("it has faces that are not triangles")
    return columns
