"""Surfaces of drawing programs, PLY, OBJ and OFF, which meshio reads: vertices and triangles."""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cortet.errors import InputError
from cortet.formats.untrusted import content, naming, triangulated
from cortet.meshes import TriSurface

#: what the first bytes of a file look like -> end of the name by which meshio knows it; an OBJ may begin with comments
_BEGINS = {
    ".ply": re.compile(rb"ply\s"),
    ".off": re.compile(rb"(?:\xef\xbb\xbf)?(?:\s|#[^\n]*\n)*\w*OFF\b", re.IGNORECASE),
    ".obj": re.compile(rb"[^\0<]*?^v[ \t]+[-+.\d]", re.MULTILINE),
}
#: headers, without which meshio 5.3 would read on for ever
_HEADER = {".ply": re.compile(rb"\nend_header\s"), ".off": re.compile(rb"OFF\s+(?:#[^\n]*\s+)*(\d+) (\d+) \d+\s")}
#: another name of the list of corners in PLY, which meshio does not know
_CORNERS = re.compile(rb"(property list \w+ \w+ )vertex_index\s")
_DECLARED = re.compile(rb"element (vertex|face) (\d+)")
_REMEDY = "export the surface again as GIfTI (.surf.gii), or as PLY of triangles"


def kind_of(head: bytes) -> str | None:
    """The kind of surface that begins like this; None for any other file."""
    return next((kind for kind, begins in _BEGINS.items() if begins.match(head)), None)


def read(path: Path) -> TriSurface:
    """Read a surface of triangles, mm; InputError if meshio cannot, or finds fewer triangles than the file declares."""
    import meshio

    data = content(path)
    kind = str(kind_of(data))
    header = _HEADER[kind].search(data) if kind in _HEADER else None
    declared = dict(_DECLARED.findall(data[: header.start()])) if header and kind == ".ply" else {}
    if (kind in _HEADER and not header) or any(int(count) > len(data) for count in declared.values()):
        raise InputError(f"is not a complete {kind[1:].upper()} surface, as text or binary", file=path, remedy=_REMEDY)
    if header and kind == ".off":
        rows = [line for line in data[header.end() :].splitlines() if line.strip() and not line.startswith(b"#")]
        if len(rows) != int(header[1]) + int(header[2]):
            raise InputError(
                "is not a valid OFF surface: it has more or fewer lines than it declares", file=path, remedy=_REMEDY
            )
    if kind == ".obj":  # meshio takes normals and textures for fields, one for each vertex
        data = b"\n".join(line for line in data.splitlines() if line.split()[:1] in ([b"v"], [b"f"]))
    with TemporaryDirectory(prefix="cortet-surface-") as folder:
        (unpacked := Path(folder) / f"surface{kind}").write_bytes(_CORNERS.sub(rb"\1vertex_indices\n", data, 1))
        try:
            found = {".ply": meshio.ply, ".off": meshio.off, ".obj": meshio.obj}[kind].read(str(unpacked))
            points = np.asarray(found.points, float)[:, :3]
            corners = [block.data for block in found.cells if block.type == "triangle"]
        except Exception as error:  # whatever meshio raises
            what = f"is no {kind[1:].upper()} surface that meshio reads ({type(error).__name__}: {error})"
            raise InputError(what, file=path, remedy=_REMEDY) from error
    if len(corners) < len(found.cells):
        raise InputError("has faces that are not triangles", file=path, remedy=_REMEDY)
    faces = np.concatenate([np.empty((0, 3), int), *corners])
    if declared and (int(declared[b"vertex"]), int(declared[b"face"])) != (len(points), len(faces)):
        raise InputError("is truncated: it has fewer vertices or faces than it declares", file=path, remedy=_REMEDY)
    with naming(path):
        return triangulated(points, faces, path)
