"""Wavefront OBJ surfaces: vertices and triangles are read; normals, textures and materials are ignored."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from cortet.errors import InputError
from cortet.formats.untrusted import content, triangulated
from cortet.meshes import TriSurface

_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*f[ \t]+([^\r\n]*)", re.MULTILINE)
_REMEDY = "export the surface again as GIfTI (.surf.gii)"


def read(path: str | Path) -> TriSurface:
    """Read a surface, mm; a face with more than three corners is split into triangles that share the first corner.

    Raises
    ------
    InputError
        the file is missing or no OBJ; a face counts its corners from the end; a coordinate is not finite, or a face
        refers to a vertex that does not exist
    """
    text = content(path)
    try:
        points = np.fromiter((float(word) for match in _VERTEX.finditer(text) for word in match.groups()), float)
        corners = np.fromiter(_corners(text), np.int64)
    except (ValueError, OverflowError) as error:
        raise InputError(f"is not a readable OBJ surface: {error}", file=path, remedy=_REMEDY) from error
    return triangulated(points.reshape(-1, 3), corners.reshape(-1, 3), path)


def _corners(text: bytes) -> Iterator[int]:
    """The corners of all triangles, one after the other, counted from 0."""
    for match in _FACE.finditer(text):
        face = [int(word.split(b"/")[0]) for word in match[1].split(b"#")[0].split()]
        if len(face) < 3 or min(face) < 1:
            raise ValueError(f"face {match[1][:40].decode('ascii', 'replace')!r} has no three corners counted from 1")
        for second, third in pairwise(face[1:]):
            yield from (face[0] - 1, second - 1, third - 1)
