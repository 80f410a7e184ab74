"""A folding mesh as ParaView reads it: one `.vtu` per moment, and a `.pvd` that makes a film of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from cortet.formats import vtu
from cortet.formats.atomic import atomic_path
from cortet.mesh import FloatArray, TetMesh


def write_frame(mesh: TetMesh, points: FloatArray, j: FloatArray, growth: FloatArray, path: Path) -> None:
    """Write a mesh at its present `points` (n, 3) mm, with displacement per node, J and growth (m,) per element."""
    moved = TetMesh(points, mesh.cells, {"displacement": points - mesh.points}, {"J": j, "growth": growth})
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
