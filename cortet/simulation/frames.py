"""A folding mesh as ParaView reads it: one `.vtu` per moment, and a `.pvd` that makes a film of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cortet.formats import vtu
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import MEDIAL_WALL
from cortet.mesh import FloatArray, TetMesh


def write_frame(
    mesh: TetMesh, points: FloatArray, j: FloatArray, growth: FloatArray, wall: NDArray[np.uint8], path: Path
) -> None:
    """Write a mesh at its present `points` (n, 3) mm.

    With displacement per node and whether it is of the medial wall (n,), and J and growth per element (m,).
    """
    fields: dict[str, NDArray[Any]] = {"displacement": points - mesh.points, MEDIAL_WALL: wall}
    moved = TetMesh(points, mesh.cells, fields, {"J": j, "growth": growth})
    vtu.write(moved, path)


def write_series(frames: Sequence[tuple[str, float]], path: Path) -> None:
    """Write the `.pvd` over frames: file names relative to it, and the gestational age that stands for their time."""
    lines = "".join(f'    <DataSet timestep="{age:.6g}" part="0" file={quoteattr(name)}/>\n' for name, age in frames)
    with atomic_path(path) as temporary:
        temporary.write_text(
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
            f"{lines}  </Collection>\n</VTKFile>\n",
            encoding="utf-8",
        )
