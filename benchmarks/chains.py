"""Whole chains from surface to certificate: seconds per stage, memory, quality and fidelity.

    python benchmarks/chains.py SURFACE... [--cell-sizes 1.0 0.8] [--chains published default fast default:tetgen]

A chain is a setting, or `setting:mesher` for another mesher in S1. Each runs in a process of its own with kernels
compiled, on surfaces that are not smoothed. Seconds are those of the CPU, which other work on the machine changes
least. Prints one line per stage as it ends, then one per mesh, and where a chain ran on several meshes, how its time
grows with their size.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from pathlib import Path
from typing import Any

import numpy as np

from cortet.config import load
from cortet.errors import CortetError
from cortet.formats.gifti import read_surface
from cortet.mesh import TetMesh
from cortet.phantom import phantom
from cortet.pipeline import Step, mesh_surface
from cortet.quality import quality
from cortet.stage_table import peak_memory_mb, reset_peak_memory

STAGE_COLUMNS = ("surface", "h_mm", "chain", "stage", "cpu_seconds", "tets", "q_mean", "q_max", "above_0.6")
MESH_COLUMNS = (
    *("surface", "h_mm", "chain", "tets", "q_mean", "q_max", "valence_bound", "cpu_seconds", "tets_per_second"),
    *("MB_per_million_tets", "nodes_off_mm", "surface_off_mm", "volume_change", "euler", "certified", "why_not"),
)


def run_chain(surface_file: Path, cell_size: float, chain: str, answer) -> None:  # type: ignore[no-untyped-def]
    """Run one chain in this process, print its stages and send back the row of its mesh."""
    setting, _, mesher = chain.partition(":")
    generate: dict[str, Any] = {"cell_size": cell_size, **({"meshers": [mesher]} if mesher else {})}
    config = load({"setting": setting, "generate": generate})
    # loads or compiles the kernels, and is no part of what is measured
    coarse = load({"setting": setting, "generate": {**generate, "cell_size": 4.0}})
    mesh_surface(phantom(24.0, subdivisions=3), coarse)
    surface = read_surface(surface_file)
    row: dict[str, Any] = {"surface": surface_file.name.removesuffix(".surf.gii"), "h_mm": cell_size, "chain": chain}
    reset_peak_memory()
    idle_mb = peak_memory_mb() or 0
    began = last = time.process_time()

    def progress(step: Step) -> None:
        nonlocal began, last
        seconds = time.process_time() - last
        numbers: dict[str, Any] = {}
        if isinstance(step.result, TetMesh):
            q = quality(step.result.points, step.result.cells)
            numbers = {"tets": len(q), "q_mean": q.mean(), "q_max": q.max(), "above_0.6": int((q > 0.6).sum())}
        print_row(STAGE_COLUMNS, row | numbers | {"stage": step.stage, "cpu_seconds": seconds})
        # what the printing took does not count
        began += time.process_time() - last - seconds
        last = time.process_time()

    try:
        mesh, found = mesh_surface(surface, config, progress=progress)
    except CortetError as error:
        answer.send(row | {"certified": False, "why_not": str(error)})
        return
    cells = len(mesh.cells)
    answer.send(
        row
        | {
            "tets": cells,
            "q_mean": found.quality.q.mean,
            "q_max": found.quality.q.max,
            "valence_bound": found.valence_bound.q,
            "cpu_seconds": last - began,
            "tets_per_second": cells / (last - began),
            "MB_per_million_tets": ((peak_memory_mb() or 0) - idle_mb) / cells * 1e6,
            "nodes_off_mm": found.fidelity.nodes_to_surface_mm.max,
            "surface_off_mm": found.fidelity.surface_to_boundary_mm.mean,
            "volume_change": found.fidelity.relative_volume_change,
            "euler": found.topology.euler_number,
            "certified": found.certified,
            "why_not": "; ".join(found.reasons),
        }
    )


def in_own_process(*args: object) -> dict[str, Any]:
    """Run `run_chain` in a fresh process."""
    context = multiprocessing.get_context("spawn")
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=run_chain, args=(*args, send))
    process.start()
    send.close()
    row: dict[str, Any] = receive.recv()
    process.join()
    return row


def print_row(columns: tuple[str, ...], row: dict[str, Any]) -> None:
    """One line of tab-separated values."""
    values = (row.get(column, "") for column in columns)
    print(*(f"{value:.4g}" if isinstance(value, float) else value for value in values), sep="\t", flush=True)


def main() -> None:
    """Run every chain on every surface at every cell size and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surfaces", nargs="+", type=Path)
    parser.add_argument("--cell-sizes", nargs="+", type=float, default=[1.0])
    parser.add_argument("--chains", nargs="+", default=["published", "default", "fast"])
    options = parser.parse_args()
    print(*STAGE_COLUMNS, sep="\t")
    rows = [
        in_own_process(surface, cell_size, chain)
        for surface in options.surfaces
        for cell_size in options.cell_sizes
        for chain in options.chains
    ]
    print()
    print(*MESH_COLUMNS, sep="\t")
    for row in rows:
        print_row(MESH_COLUMNS, row)
    for chain in options.chains:
        done = [row for row in rows if row["chain"] == chain and "tets" in row]
        if len({row["tets"] for row in done}) > 1:
            cells, seconds = ([row[key] for row in done] for key in ("tets", "cpu_seconds"))
            print(f"{chain}: CPU seconds grow as tets^{np.polyfit(np.log(cells), np.log(seconds), 1)[0]:.2f}")


if __name__ == "__main__":
    main()
