"""How near a mesh is to its surface, everywhere and in both directions, and what that costs.

    python benchmarks/fidelity.py SURFACE... [--cell-sizes 1.0 0.6] [--setting default] [--mesher lattice]

One row per surface and cell size, of the whole line, without an age. Distances are those of the vertices and face
centres of the surface that was meshed to the boundary of the mesh, and of the boundary's nodes and face centres to that
surface; `smoothing.py` measures those to the surface as it was read. The smallest altitude is the time step of an
explicit solver, but for the speed of sound. Each row comes from a process of its own with kernels compiled; CPU seconds
are those of all threads, MB those above the idle process.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from rows import in_own_process, print_row

from cortet.config import load
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.topology import TET_FACES, boundary_surface, enclosed_volume, face_areas
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.phantom import phantom
from cortet.pipeline import run
from cortet.report.stage_table import peak_memory_mb, reset_peak_memory

COLUMNS = (
    *("surface", "h_mm", "tets", "q_max", "q_mean", "above_0.35"),
    *("surface_off_max_mm", "surface_off_mean_mm", "surface_off_max_h", "surface_off_mean_h"),
    *("nodes_off_max_mm", "face_centres_off_max_mm", "area_change", "volume_change"),
    *("altitude_min_mm", "altitude_min_h", "edge_length_h", "refined", "rounds", "cpu_seconds", "peak_MB", "why_not"),
)


def with_centres(surface: TriSurface) -> FloatArray:
    """Vertices, then face centres: (k, 3) mm."""
    return np.concatenate([surface.points, surface.points[surface.faces].mean(axis=1)])


def altitudes(mesh: TetMesh) -> FloatArray:
    """Smallest altitude of each tetrahedron: (m,) mm."""
    areas = [face_areas(mesh.points, mesh.cells[:, corners]) for corners in TET_FACES]
    return 3 * signed_volumes(mesh.points, mesh.cells) / np.max(areas, axis=0)


def measured(mesh: TetMesh, surface: TriSurface, cell_size: float) -> dict[str, Any]:
    """The numbers of a row that follow from the mesh and the surface it fills."""
    boundary, _ = boundary_surface(mesh)
    lost = closest_points(surface_tree(boundary.points, boundary.faces), with_centres(surface)).distances
    off = closest_points(surface_tree(surface.points, surface.faces), with_centres(boundary)).distances
    area, given_area = (face_areas(s.points, s.faces).sum() for s in (boundary, surface))
    volume, given_volume = (enclosed_volume(s.points, s.faces) for s in (boundary, surface))
    q, least = quality(mesh.points, mesh.cells), altitudes(mesh).min()
    return {
        "tets": len(q),
        "q_max": q.max(),
        "q_mean": q.mean(),
        "above_0.35": int((q > 0.35).sum()),
        "surface_off_max_mm": lost.max(),
        "surface_off_mean_mm": lost.mean(),
        "surface_off_max_h": lost.max() / cell_size,
        "surface_off_mean_h": lost.mean() / cell_size,
        "nodes_off_max_mm": off[: len(boundary.points)].max(),
        "face_centres_off_max_mm": off[len(boundary.points) :].max(),
        "area_change": area / given_area - 1,
        "volume_change": volume / given_volume - 1,
        "altitude_min_mm": least,
        "altitude_min_h": least / cell_size,
    }


def measure(file: Path, cell_size: float, setting: str, mesher: str, answer) -> None:  # type: ignore[no-untyped-def]
    """Run the line in this process and send back the row of its mesh."""
    row: dict[str, Any] = {"surface": file.name.removesuffix(".surf.gii"), "h_mm": cell_size}
    generate: dict[str, Any] = {"meshers": [mesher]} if mesher else {}
    # loads or compiles the kernels, and is no part of what is measured
    list(run(phantom(24.0, subdivisions=3), load({"setting": setting, "generate": {**generate, "cell_size": 4.0}})))
    reset_peak_memory()
    idle, began = peak_memory_mb() or 0, time.process_time()
    try:
        config = load({"setting": setting, "generate": {**generate, "cell_size": cell_size}})
        for step in run(read_surface(file), config, source=file):
            if step.stage == "generate":
                fraction = (step.report["edge_length_mm"] or np.nan) / cell_size
                refinement = step.report.get("refinement") or {}
                row |= {"edge_length_h": fraction, "refined": refinement.get("vertices_refined", "")}
                row |= {"rounds": refinement.get("rounds", "")}
    except CortetError as error:
        answer.send(row | {"why_not": str(error)})
        return
    row |= {"cpu_seconds": time.process_time() - began, "peak_MB": (peak_memory_mb() or 0) - idle}
    assert isinstance(step.result, TetMesh)  # the line ends with a mesh
    answer.send(row | measured(step.result, step.surface, cell_size))


def main() -> None:
    """Mesh every surface at every cell size and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surfaces", nargs="+", type=Path)
    parser.add_argument("--cell-sizes", nargs="+", type=float, default=[1.0])
    parser.add_argument("--setting", default="default")
    parser.add_argument("--mesher", default="", help="another one than the setting's")
    options = parser.parse_args()
    print(*COLUMNS, sep="\t")
    for surface in options.surfaces:
        for cell_size in options.cell_sizes:
            print_row(COLUMNS, in_own_process(measure, surface, cell_size, options.setting, options.mesher))


if __name__ == "__main__":
    main()
