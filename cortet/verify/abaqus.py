"""Abaqus and CalculiX: C3D4 elements, names they accept, faces named by element and side.

A face cannot face inward there: its side follows from the order of the element's nodes. Names: Abaqus Analysis User's
Guide, "Input syntax rules": at most 80 characters, the first a letter, upper and lower case the same.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from cortet.formats import abaqus
from cortet.mesh import TetMesh
from cortet.verify.conventions import AsRead

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,79}$")


def as_read(path: Path) -> AsRead:
    """The file as Abaqus and CalculiX see it; raises InputError where it cannot be read."""
    mesh = abaqus.read(path)
    return AsRead(mesh, [*_names(mesh)], directs_faces=False)


def _names(mesh: TetMesh) -> Iterator[str]:
    for names in (mesh.sets.nodes, mesh.sets.faces, mesh.sets.cells):
        for name in names:
            if not _NAME.match(name):
                yield f"set {name!r} has a name that Abaqus does not take"
        folded = [name.lower() for name in names]
        for name in sorted({name for name in folded if folded.count(name) > 1}):
            yield f"two sets are named {name}: Abaqus does not tell upper from lower case"
