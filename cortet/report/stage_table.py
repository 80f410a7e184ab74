"""Effect and cost of each stage for one mesh: the table behind the comparison with the published chain."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from cortet.formats.tables import Column, names
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.topology import boundary_nodes
from cortet.measure.fidelity import summary
from cortet.measure.quality import quality
from cortet.meshes import TetMesh
from cortet.pipeline import Step

#: columns of `cortet stages`
STAGE_COLUMNS = (
    Column("stage", "Stage that has run"),
    Column("nodes", "Number of nodes"),
    Column("tets", "Number of tetrahedra"),
    Column("q_mean", "Mean q"),
    Column("q_max", "Largest q"),
    Column("q_above_0.6", "Number of tetrahedra with q > 0.6"),
    Column("seconds", "Wall time of the stage, compilation of kernels included when they are not cached yet"),
    Column("peak_memory_mb", "Largest resident memory of the process while the stage ran, libraries included"),
    Column("distance_mean_mm", "Boundary nodes to the nearest point of the surface that was meshed, mean"),
    Column("distance_max_mm", "The same, maximum"),
)

_PROCESS = Path("/proc/self")


def measured_stages(steps: Iterable[Step]) -> Iterator[dict[str, Any]]:
    """One row per stage, as the stages run; columns as in `STAGE_COLUMNS`, None where they do not apply."""
    waiting = iter(steps)
    while True:
        reset_peak_memory()
        step = next(waiting, None)
        if step is None:
            return
        row = {"stage": step.stage, "seconds": round(step.seconds, 1), "peak_memory_mb": peak_memory_mb()}
        yield dict.fromkeys(names(STAGE_COLUMNS)) | row | _measures(step)


def _measures(step: Step) -> dict[str, Any]:
    mesh = step.result
    if not isinstance(mesh, TetMesh):
        return {"nodes": len(mesh.points)}
    q = quality(mesh.points, mesh.cells)
    tree = tree_of(step.surface)
    distance = summary(closest_points(tree, mesh.points[boundary_nodes(mesh)]).distances)
    return {
        "nodes": len(mesh.points),
        "tets": len(mesh.cells),
        "q_mean": float(q.mean()),
        "q_max": float(q.max()),
        "q_above_0.6": int((q > 0.6).sum()),
        "distance_mean_mm": distance.mean,
        "distance_max_mm": distance.max,
    }


def reset_peak_memory() -> None:
    """Start a new measurement of the peak (Linux: proc(5), clear_refs); no effect elsewhere."""
    if (_PROCESS / "clear_refs").exists():
        (_PROCESS / "clear_refs").write_text("5")


def peak_memory_mb() -> int | None:
    """Peak resident memory since the last reset, MB; None if the system does not report it."""
    if not (_PROCESS / "status").exists():
        return None
    found = re.search(r"VmHWM:\s+(\d+) kB", (_PROCESS / "status").read_text())
    return round(int(found[1]) * 1024 / 1e6) if found else None
