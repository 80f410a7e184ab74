"""BrainGrowth: negative volumes; the triangles are the surface; every tetrahedron line has 5 fields."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cortet.formats.braingrowth import read_tables
from cortet.formats.surface_sets import CORTICAL_SURFACE
from cortet.mesh import IntArray, MeshSets, TetMesh
from cortet.verify.conventions import AsRead


def as_read(path: Path) -> AsRead:
    """The file in its own coordinates, with the last two nodes of every tetrahedron swapped.

    Raises InputError where the tables cannot be read.
    """
    tables = read_tables(path)
    faces, cells = _from_0(tables.triangles[:, 1:]), _from_0(tables.tetrahedra[:, [1, 2, 4, 3]])
    first_cell, first_face = len(tables.points) + 3, len(tables.points) + len(cells) + 4
    return AsRead(
        TetMesh(tables.points, cells, sets=MeshSets(faces={CORTICAL_SURFACE: faces} if len(faces) else {})),
        sign="negative",
        cell=lambda index: f"on line {first_cell + index}",
        face=lambda index: f"on line {first_face + index}",
    )


def _from_0(numbers: NDArray[np.int64]) -> IntArray:
    """Nodes counted from 0; any that are too large for an index stay too large, and so out of range."""
    return np.clip(numbers, 0, np.iinfo(np.int32).max).astype(np.int32) - 1
