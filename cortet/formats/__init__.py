"""File formats of tetrahedral meshes by name: one module each, none of which knows another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cortet.formats import abaqus, braingrowth, carp, vtu
from cortet.mesh import TetMesh


@dataclass(frozen=True)
class Format:
    """How a format is written and read."""

    #: with the dot, of the file it is known by
    suffix: str
    read: Callable[[str | Path], TetMesh]
    write: Callable[[TetMesh, str | Path], None]


FORMATS = {
    "vtu": Format(".vtu", vtu.read, vtu.write),
    "carp": Format(".pts", carp.read, carp.write),
    "braingrowth": Format(".mesh", braingrowth.read, braingrowth.write),
    "abaqus": Format(".inp", abaqus.read, abaqus.write),
}
