"""Binary STL: the triangles of a surface, each with its normal and its corners as float32 (3D Systems, 1989).

STL has no vertices, only corners: on reading, corners of the same coordinates become one vertex.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.untrusted import content
from cortet.geometry.topology import face_normals
from cortet.mesh import TriSurface

_HEADER_BYTES = 80
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def write(surface: TriSurface, path: str | Path) -> None:
    """Write a surface, mm; normals follow from the order of the corners."""
    records = np.zeros(len(surface.faces), _TRIANGLE)
    normals = face_normals(surface.points, surface.faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    records["normal"] = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    records["corners"] = surface.points[surface.faces]
    with atomic_path(path) as temporary:
        header = b"cortet, mm".ljust(_HEADER_BYTES) + np.uint32(len(records)).tobytes()
        temporary.write_bytes(header + records.tobytes())


def read(path: str | Path) -> TriSurface:
    """Read a binary STL file; vertices come in the order in which the triangles name them.

    Raises
    ------
    InputError
        the file is missing, its size is not what its number of triangles asks for, or a coordinate is not finite
    """
    data = content(path)
    start = _HEADER_BYTES + 4
    count = int(np.frombuffer(data[_HEADER_BYTES:start].ljust(4, b"\0"), "<u4")[0])
    if len(data) != start + count * _TRIANGLE.itemsize:
        raise InputError(f"is no binary STL file of {count} triangles: it has {len(data)} bytes", file=path)
    corners = np.frombuffer(data, _TRIANGLE, offset=start)["corners"].reshape(-1, 3)
    if not np.isfinite(corners).all():
        raise InputError("has corners whose coordinates are not finite", file=path)
    points, first, vertex = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    number = np.empty(len(order), np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    return TriSurface(points[order], number[vertex.ravel()].reshape(-1, 3))
