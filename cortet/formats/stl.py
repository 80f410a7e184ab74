"""STL, binary and text: the triangles of a surface, each with its normal and its corners, float32 (3D Systems, 1989).

STL has no vertices, only corners. On reading, corners with equal coordinates become one vertex.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.formats.atomic import atomic_path
from cortet.formats.untrusted import by_library, content, require_finite_points
from cortet.meshes import TriSurface

_HEADER_BYTES = 80
_TEXT = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_FACET, _END = re.compile(rb"\bendfacet\b", re.IGNORECASE), re.compile(rb"\bendsolid\b", re.IGNORECASE)
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write(surface: TriSurface, path: str | Path) -> None:
    """Write a surface, mm; normals follow from the order of the corners."""
    from cortet.geometry.topology import face_normals  # loads Numba and SciPy, which reading does without

    records = np.zeros(len(surface.faces), _TRIANGLE)
    normals = face_normals(surface.points, surface.faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    records["normal"] = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    records["corners"] = surface.points[surface.faces]
    with atomic_path(path) as temporary:
        header = b"cortet, mm".ljust(_HEADER_BYTES) + np.uint32(len(records)).tobytes()
        temporary.write_bytes(header + records.tobytes())


def begins(head: bytes, size: int) -> bool:
    """Whether a file of `size` bytes that begins with `head` is an STL file."""
    count = int(np.frombuffer(head[_HEADER_BYTES : _HEADER_BYTES + 4].ljust(4, b"\0"), "<u4")[0])
    binary = count > 0 and size == _HEADER_BYTES + 4 + count * _TRIANGLE.itemsize
    return binary or (head.lstrip()[:5].lower() == b"solid" and b"facet" in head.lower())


def read(path: str | Path) -> TriSurface:
    """Read an STL file; vertices are in the order in which the triangles name them."""
    data = content(path)
    start = _HEADER_BYTES + 4
    with by_library("a complete STL", path):
        if data[:_HEADER_BYTES].lstrip()[:5].lower() == b"solid" and _TEXT.search(data):
            words = (float(word) for match in _TEXT.finditer(data) for word in match.groups())
            corners = np.fromiter(words, float).reshape(-1, 3)
            if len(corners) != 3 * len(_FACET.findall(data)) or not _END.search(data):
                raise ValueError("a facet does not have three corners, or its end is missing")
        else:
            count = int(np.frombuffer(data[_HEADER_BYTES:start], "<u4")[0])
            if len(data) != start + count * _TRIANGLE.itemsize:
                raise ValueError(f"{len(data)} bytes cannot hold {count} triangles")
            corners = np.frombuffer(data, _TRIANGLE, offset=start)["corners"].reshape(-1, 3)
    require_finite_points(corners, path)
    return merged(corners)


def merged(corners: NDArray[Any]) -> TriSurface:
    """The surface of triangles with consecutive corners (3 m, 3); equal corners become one vertex."""
    points, first, vertex = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.empty(len(order), np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    return TriSurface(points[order], number[vertex.ravel()].reshape(-1, 3))
