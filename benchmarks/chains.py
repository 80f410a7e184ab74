"""Whole chains from surface to certificate: seconds per stage, memory, quality and fidelity.

    python benchmarks/chains.py SURFACE... [--cell-sizes 1.0 0.8] [--chains published cgal default cgal:tetgen]
                                [--threads 1 2] [--core-ratio 2] [--profile]

A chain is a setting, or `setting:mesher` for another mesher in S1. Each runs in a process of its own with kernels
compiled, on surfaces that are not smoothed. CPU seconds are those of all threads; other work on the machine changes
them least. Prints one line per stage as it ends, then one per mesh, with a hash of its nodes and tetrahedra, and where
a chain ran on several meshes, how its time grows with their size. A profile lists the slowest functions of a chain.
"""

from __future__ import annotations

import argparse
import cProfile
import hashlib
import pstats
import time
from pathlib import Path
from typing import Any

import numba
from rows import in_own_process, print_power, print_row

from cortet.config import load
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface
from cortet.measure.quality import circumradii, edge_lengths, quality
from cortet.meshes import TetMesh
from cortet.phantom import phantom
from cortet.pipeline import Step, mesh_surface
from cortet.report.stage_table import peak_memory_mb, reset_peak_memory

STAGE_COLUMNS = (
    "surface",
    "h_mm",
    "chain",
    "threads",
    "stage",
    "cpu_seconds",
    "wall_seconds",
    "tets",
    "q_mean",
    "q_max",
    "above_0.3",
    "above_0.6",
)
MESH_COLUMNS = (
    *("surface", "h_mm", "chain", "threads", "tets", "q_mean", "q_max", "valence_bound"),
    *(
        "circumradius_mean_h",
        "circumradius_max_h",
        "edge_mean_h",
        "cpu_seconds",
        "wall_seconds",
        "tets_per_cpu_second",
        "MB_per_million_tets",
    ),
    *("dihedral_min_deg", "dihedral_max_deg", "nodes_to_surface_max_mm"),
    *("surface_to_boundary_mean_mm", "surface_to_boundary_max_mm"),
    *("volume_change", "euler", "certified", "why_not", "sha256"),
)


def run_chain(  # type: ignore[no-untyped-def]
    surface_file: Path, cell_size: float, chain: str, threads: int, core_ratio: float, profiled: bool, answer
) -> None:
    """Run one chain in this process, print its stages and send back the row of its mesh."""
    numba.set_num_threads(threads)
    setting, _, mesher = chain.partition(":")
    generate: dict[str, Any] = {"cell_size": cell_size, "core_ratio": core_ratio}
    generate |= {"meshers": [mesher]} if mesher else {}
    config = load({"setting": setting, "generate": generate})
    # loads or compiles the kernels, and is no part of what is measured
    coarse = load({"setting": setting, "generate": {**generate, "cell_size": 4.0}})
    mesh_surface(phantom(24.0, subdivisions=3), coarse)
    surface = read_surface(surface_file)
    name = surface_file.name.removesuffix(".surf.gii")
    row: dict[str, Any] = {"surface": name, "h_mm": cell_size, "chain": chain, "threads": threads}
    reset_peak_memory()
    idle_mb = peak_memory_mb() or 0
    began = last = time.process_time()
    wall = 0.0

    def progress(step: Step) -> None:
        nonlocal began, last, wall
        seconds = time.process_time() - last
        numbers: dict[str, Any] = {}
        if isinstance(step.result, TetMesh):
            q = quality(step.result.points, step.result.cells)
            numbers = {"tets": len(q), "q_mean": q.mean(), "q_max": q.max()}
            numbers |= {f"above_{limit}": int((q > limit).sum()) for limit in (0.3, 0.6)}
        spent = {"cpu_seconds": seconds, "wall_seconds": step.seconds}
        print_row(STAGE_COLUMNS, row | numbers | spent | {"stage": step.stage})
        wall += step.seconds
        # what the printing took does not count
        began += time.process_time() - last - seconds
        last = time.process_time()

    profiler = cProfile.Profile(time.process_time)
    if profiled:
        profiler.enable()
    try:
        mesh, found, _ = mesh_surface(surface, config, progress=progress)
    except CortetError as error:
        answer.send(row | {"certified": False, "why_not": str(error)})
        return
    if profiled:
        profiler.disable()
        pstats.Stats(profiler).sort_stats("tottime").print_stats(16)
    used = {
        "cpu_seconds": last - began,
        "wall_seconds": wall,
        "peak_MB": peak_memory_mb() or 0,
    }
    cells, radii = len(mesh.cells), circumradii(mesh.points, mesh.cells) / cell_size
    answer.send(
        row
        | used
        | {
            "tets": cells,
            "q_mean": found.quality.q.mean,
            "q_max": found.quality.q.max,
            "valence_bound": found.valence_bound.q,
            "circumradius_mean_h": radii.mean(),
            "circumradius_max_h": radii.max(),
            "edge_mean_h": edge_lengths(mesh.points, mesh.cells).mean() / cell_size,
            "tets_per_cpu_second": cells / used["cpu_seconds"],
            "MB_per_million_tets": (used["peak_MB"] - idle_mb) / cells * 1e6,
            "dihedral_min_deg": found.quality.dihedral_min_deg,
            "dihedral_max_deg": found.quality.dihedral_max_deg,
            "nodes_to_surface_max_mm": found.fidelity.nodes_to_surface_mm.max,
            "surface_to_boundary_mean_mm": found.fidelity.surface_to_boundary_mm.mean,
            "surface_to_boundary_max_mm": found.fidelity.surface_to_boundary_mm.max,
            "volume_change": found.fidelity.relative_volume_change,
            "euler": found.topology.euler_number,
            "certified": found.certified,
            "why_not": "; ".join(found.reasons),
            "sha256": hashlib.sha256(mesh.points.tobytes() + mesh.cells.tobytes()).hexdigest()[:16],
        }
    )


def main() -> None:
    """Run every chain on every surface at every cell size and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surfaces", nargs="+", type=Path)
    parser.add_argument("--cell-sizes", nargs="+", type=float, default=[1.0])
    parser.add_argument("--chains", nargs="+", default=["published", "cgal", "default"])
    parser.add_argument("--threads", nargs="+", type=int, default=[1])
    parser.add_argument("--core-ratio", type=float, default=1.0, help="lattice: coarser core")
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    print(*STAGE_COLUMNS, sep="\t")
    rows = [
        in_own_process(run_chain, surface, cell_size, chain, threads, options.core_ratio, options.profile)
        for surface in options.surfaces
        for cell_size in options.cell_sizes
        for chain in options.chains
        for threads in options.threads
    ]
    print()
    print(*MESH_COLUMNS, sep="\t")
    for row in rows:
        print_row(MESH_COLUMNS, row)
    for chain in options.chains:
        print_power(chain, (row for row in rows if row["chain"] == chain), y="cpu_seconds")


if __name__ == "__main__":
    main()
