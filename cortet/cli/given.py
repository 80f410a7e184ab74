"""Inputs of commands: configuration, surfaces, meshes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cortet.errors import InputError

if TYPE_CHECKING:
    from cortet.meshes import TetMesh


def stem_of(path: Path) -> str:
    """The name of a file without its last ending, from which the names of its companions are made."""
    return path.name.removesuffix(path.suffix)


def read_mesh(path: Path, *, whole: bool = False) -> TetMesh:
    """A mesh of any format; warns if its file was changed after cortet wrote it."""
    from cortet.formats import read_mesh as read
    from cortet.solver_files.fields import without_q
    from cortet.solver_files.sidecar import CHANGED, changed_since, read_sidecar

    if whole and (holes := (read_sidecar(path).get("made_from") or {}).get("holes")):
        raise InputError(
            f"lacks the tetrahedra inside {', '.join(holes)}, and this command needs the whole mesh",
            file=path,
            remedy="mesh again without holes",
        )
    if changed_since(path):
        print(f"{path}: {CHANGED}", file=sys.stderr)
    return without_q(read(path))


def draw(mesh: TetMesh, path: Path, place: Callable[[Path], Path] = lambda path: path, **how: Any) -> None:
    """Draw a mesh, cut open, and write the picture, with the keyword arguments of `picture`."""
    from cortet.report.render import picture

    picture(mesh, place(path), **how)
    print(f"{path}: drawn")
