"""Speed and memory of S4 (each boundary mode) and of local reconnection, against the number of tetrahedra.

    python benchmarks/optimiser.py [SURFACE] [--cells 1e5 3e5 1e6 2e6]

Meshes are CGAL refinements of one surface (a 28-week phantom unless SURFACE is given), each made once and measured in
a process of its own, kernels compiled beforehand. Seconds are those of the CPU, which other work on the machine changes
least; memory is the peak of that process less what it had before. Last, a profile of the largest mesh.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from rows import in_own_process, print_power, print_row

from cortet.formats import gifti, vtu
from cortet.geometry.topology import enclosed_volume
from cortet.meshes import TetMesh, TriSurface
from cortet.phantom import phantom
from cortet.report.stage_table import peak_memory_mb, reset_peak_memory
from cortet.stages.clean import clean
from cortet.stages.generate import generate
from cortet.stages.reconnect import reconnect

#: tetrahedra per cube of the cell size after refinement (measured)
CELLS_PER_CUBE = 4.6

COLUMNS = ("run", "tets", "cpu_s", "tets_per_cpu_s", "MB_per_million_tets", "q_mean", "q_max")

RUNS: dict[str, Callable[[TetMesh, TriSurface], tuple[TetMesh, object]]] = {
    "clean, slide": clean,
    "clean, fixed": lambda mesh, surface: clean(mesh, surface, boundary="fixed"),
    "clean, free": lambda mesh, surface: clean(mesh, surface, boundary="free"),
    "clean, published": lambda mesh, surface: clean(mesh, surface, boundary="free", improve_mean=False),
    "reconnect": reconnect,
}


def measure(run: str, small: Path, mesh_file: Path, surface_file: Path, answer) -> None:  # type: ignore[no-untyped-def]
    """Time one run in this process and send back seconds, MB, and the worst and mean quality reached."""
    surface = gifti.read_surface(surface_file)
    RUNS[run](vtu.read(small), surface)  # load or compile the kernels
    mesh = vtu.read(mesh_file)
    reset_peak_memory()
    before, start = peak_memory_mb() or 0, time.process_time()
    _, report = RUNS[run](mesh, surface)
    seconds, megabytes = time.process_time() - start, (peak_memory_mb() or 0) - before
    answer.send(
        {
            "run": run,
            "tets": len(mesh.cells),
            "cpu_s": seconds,
            "tets_per_cpu_s": len(mesh.cells) / seconds,
            "MB_per_million_tets": megabytes / len(mesh.cells) * 1e6,
            "q_mean": report.q_mean,
            "q_max": report.q_max,
        }
    )


def refinement(surface: TriSurface, cells: float) -> TetMesh:
    """A mesh of about so many tetrahedra, slivers and all."""
    cell_size = (CELLS_PER_CUBE * enclosed_volume(surface.points, surface.faces) / cells) ** (1 / 3)
    return generate(
        surface, cell_size=cell_size, mesher="cgal", backend="cgal", odt=False, lloyd=False, perturb=False, exude=False
    )[0]


def profile(mesh: TetMesh, surface: TriSurface) -> None:
    """Print where sliding and reconnection spend their time; a kernel is one line."""
    for run in ("clean, slide", "reconnect"):
        profiler = cProfile.Profile(time.process_time)
        mesh, _ = profiler.runcall(RUNS[run], mesh, surface)
        print(f"\nprofile of {run}, {len(mesh.cells)} tetrahedra")
        pstats.Stats(profiler).sort_stats("tottime").print_stats(10)


def main() -> None:
    """Measure all runs and print the table, then the exponent of the growth of time for each run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("surface", nargs="?", type=Path)
    parser.add_argument("--cells", nargs="+", type=float, default=[1e5, 3e5, 1e6, 2e6])
    options = parser.parse_args()
    surface = gifti.read_surface(options.surface) if options.surface else phantom(28.0)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        surface_file = Path(folder) / "surface.surf.gii"
        gifti.write_surface(surface, surface_file)
        files = []
        for cells in [2e4, *options.cells]:
            mesh = refinement(surface, cells)
            files.append(Path(folder) / f"{len(mesh.cells)}.vtu")
            vtu.write(mesh, files[-1])
        print(*COLUMNS, sep="\t")
        for file in files[1:]:
            for run in RUNS:
                rows.append(in_own_process(measure, run, files[0], file, surface_file))
                print_row(COLUMNS, rows[-1])
        for run in RUNS.values():
            run(vtu.read(files[0]), surface)  # compile before profiling
        profile(vtu.read(files[-1]), surface)
    for name in RUNS:
        print_power(name, (row for row in rows if row["run"] == name))


if __name__ == "__main__":
    main()
