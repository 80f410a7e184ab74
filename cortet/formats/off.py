"""OFF surfaces in text (Geomview): vertices and triangles are read; colours and normals are ignored."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from cortet.errors import InputError
from cortet.formats.untrusted import content, triangulated
from cortet.meshes import TriSurface

#: comments, and the first word of a file; letters before OFF announce texture, colour or normals after the coordinates,
#: 4 and n another number of coordinates
BEGINS = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s|#[^\n]*\n)*((?:ST)?C?N?(4?n?)OFF|off|coff)\b(\s*BINARY)?")
_REMEDY = "export the surface again as GIfTI (.surf.gii)"


def read(path: str | Path) -> TriSurface:
    """Read a surface, mm; a face with more than three corners is split into triangles that share the first corner.

    Raises
    ------
    InputError
        the file is missing or no OFF in text; it ends early, or goes on after the numbers that it declares; a
        coordinate is not finite, or a face refers to a vertex that does not exist
    """
    text = content(path)
    begin = BEGINS.match(text)
    if begin and (begin[2] or begin[3]):
        kind = "in binary" if begin[3] else f"of the kind {begin[1].decode()}, whose vertices may have four coordinates"
        raise InputError(f"is an OFF surface {kind}", file=path, remedy="save it as OFF in text, with x, y and z alone")
    try:
        lines = [
            line for one in text[begin.end() if begin else 0 :].splitlines() if (line := one.split(b"#")[0].split())
        ]
        if not lines or len(lines[0]) < 2:
            raise ValueError("its numbers of vertices and of faces are not in one line")
        vertices, faces = int(lines[0][0]), int(lines[0][1])
        declared = f"its {vertices:,} vertices and {faces:,} faces"
        if min(vertices, faces) < 0 or len(lines) <= vertices + faces:
            raise ValueError(f"it ends before {declared} do")
        if len(lines) > vertices + faces + 1:
            raise ValueError(f"it goes on after {declared}: {len(lines) - 1 - vertices:,} lines of faces are in it")
        points = np.array([line[:3] for line in lines[1 : vertices + 1]], float).reshape(-1, 3)
        corners = np.fromiter(_corners(lines[vertices + 1 : vertices + 1 + faces]), np.int64)
    except (ValueError, IndexError, OverflowError) as error:
        raise InputError(f"is not a readable OFF surface: {error}", file=path, remedy=_REMEDY) from error
    return triangulated(points, corners.reshape(-1, 3), path)


def _corners(faces: Sequence[Sequence[bytes]]) -> Iterator[int]:
    """The corners of all triangles, one after the other, counted from 0."""
    for words in faces:
        face = [int(word) for word in words[1 : int(words[0]) + 1]]
        if len(face) < 3 or len(face) != int(words[0]):
            raise ValueError(f"face {b' '.join(words)[:40].decode('ascii', 'replace')!r} does not name its corners")
        for second, third in pairwise(face[1:]):
            yield from (face[0], second, third)
