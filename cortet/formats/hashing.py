"""SHA-256 of files and meshes, to identify them."""

from __future__ import annotations

import hashlib
import html
import re
from pathlib import Path
from typing import TYPE_CHECKING

from cortet.errors import InputError

if TYPE_CHECKING:
    from cortet.meshes import TetMesh

#: attribute of an array of a GIfTI file that lies in another file
_EXTERNAL = re.compile(rb"""ExternalFileName\s*=\s*["']([^"']+)["']""")


def sha256(path: str | Path) -> str:
    """Hash of a file, as `sha256sum` prints it; InputError for a pipe or a device, which may never end."""
    if Path(path).exists() and not Path(path).is_file():
        raise InputError("is not a regular file", file=path, remedy="give the name of a file")
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror}", file=path, remedy="check the path and its permissions"
        ) from error


def external_names(data: bytes) -> list[str]:
    """Names of the files that hold arrays of a GIfTI file, by its content."""
    return sorted({html.unescape(name.decode("utf-8", "replace")) for name in _EXTERNAL.findall(data)})


def companions(path: str | Path) -> list[Path]:
    """The binary files beside a GIfTI file that hold its arrays, as SPM and CAT12 write them; none for other files."""
    path = Path(path)
    if path.suffix != ".gii" or not path.is_file():
        return []
    try:
        names = external_names(path.read_bytes())
    except OSError:
        return []
    return [path.parent / name for name in names if Path(name).name == name and (path.parent / name).is_file()]


def input_sha256(path: str | Path) -> str:
    """Hash of a file of the user: that of `sha256`, or of this and those of its companions, if it has any."""
    hashes = [sha256(file) for file in (path, *companions(path))]
    return hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()


def mesh_sha256(mesh: TetMesh) -> str:
    """Hash of the nodes, (n, 3) float64, and the tetrahedra, (m, 4) int32, of a mesh, without fields and sets."""
    digest = hashlib.sha256(mesh.points.astype("<f8", copy=False).tobytes())
    digest.update(mesh.cells.astype("<i4", copy=False).tobytes())
    return digest.hexdigest()
