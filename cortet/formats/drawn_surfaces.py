"""Surfaces of drawing programs, PLY, OBJ and OFF, which meshio reads: vertices and triangles."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cortet.formats.untrusted import by_library, content, triangulated
from cortet.meshes import TriSurface

#: what the first bytes of a file look like -> end of the name by which meshio knows it; an OBJ may begin with comments
_BEGINS = {
    ".ply": re.compile(rb"ply\s"),
    ".off": re.compile(rb"(?:\xef\xbb\xbf)?(?:\s|#[^\n]*\n)*\w*OFF\b", re.IGNORECASE),
    ".obj": re.compile(rb"[^\0<]*?^v[ \t]+[-+.\d]", re.MULTILINE),
}
#: headers, without which meshio 5.3 would read on for ever
_HEADER = {
    ".ply": re.compile(rb"\nend_header\s"),
    ".off": re.compile(rb"\b(?:ST)?[CN]*OFF\s+(?:#[^\n]*\s+)*(\d+) (\d+) \d+\s"),
}
#: another name of the list of corners in PLY, which meshio does not know
_CORNERS = re.compile(rb"(property list \w+ \w+ )vertex_index\s")
_DECLARED = re.compile(rb"element (vertex|face) (\d+)")


def kind_of(head: bytes) -> str | None:
    """The kind of surface that begins like this; None for any other file."""
    return next((kind for kind, begins in _BEGINS.items() if begins.match(head)), None)


def read(path: Path) -> TriSurface:
    """Read a surface of triangles, mm; InputError if meshio cannot, or finds fewer triangles than the file declares."""
    import meshio

    data = content(path)
    kind = str(kind_of(data))
    with by_library(f"{kind[1:].upper()}, a surface of triangles", path), TemporaryDirectory() as folder:
        header = _HEADER[kind].search(data) if kind in _HEADER else None
        if kind in _HEADER and not header:
            raise ValueError("its header is incomplete")
        declared = [*map(int, header.groups())] if header and kind == ".off" else []
        if header and kind == ".ply":
            counts = dict(_DECLARED.findall(data[: header.start()]))
            declared = [int(counts[b"vertex"]), int(counts[b"face"])]
        if any(count > len(data) for count in declared):
            raise ValueError("it is truncated")
        if kind == ".obj":  # meshio takes normals and textures for fields, one for each vertex
            data = b"\n".join(line for line in data.splitlines() if line.split()[:1] in ([b"v"], [b"f"]))
        if header and kind == ".off":
            data = b"OFF\n%d %d 0\n" % tuple(declared) + _plain(data[header.end() :], declared[0])
        (unpacked := Path(folder) / f"surface{kind}").write_bytes(_CORNERS.sub(rb"\1vertex_indices\n", data, 1))
        found = {".ply": meshio.ply, ".off": meshio.off, ".obj": meshio.obj}[kind].read(str(unpacked))
        points = np.asarray(found.points, float)[:, :3]
        if any(block.type != "triangle" for block in found.cells):
            raise ValueError("it has faces that are not triangles")
        faces = np.concatenate([np.empty((0, 3), int), *(block.data for block in found.cells)])
        if declared and declared != [len(points), len(faces)]:
            raise ValueError("it has fewer vertices or faces than it declares")
    return triangulated(points, faces, path)


def _plain(body: bytes, vertices: int) -> bytes:
    """The lines of OFF without what follows coordinates and corners: normals and colours, as MeshLab writes them."""
    rows = [row for line in body.splitlines() if (row := line.split(b"#")[0].split())]
    return b"\n".join([b" ".join(row[:3]) for row in rows[:vertices]] + [b" ".join(row[:4]) for row in rows[vertices:]])
