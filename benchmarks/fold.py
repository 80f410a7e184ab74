"""Speed and memory of the folding simulation, against the number of tetrahedra and of threads.

    python benchmarks/fold.py [--cells 1e5 3e5 1e6] [--threads 1 2] [--steps 20]

The body is a cube of Kuhn tetrahedra with displaced inner nodes that grows as a cortex does, its surface in contact
search; each row is a process of its own, kernels compiled beforehand. On a busy machine wall time says little: compare
the CPU seconds, and element-steps per CPU second and core. Memory is the peak of the process from the making of the
body on, and what of it is above that before.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from typing import Any

import numba
import numpy as np

from cortet.geometry.ordering import ordered_along_curve
from cortet.geometry.topology import boundary_faces
from cortet.mesh import TetMesh
from cortet.report.stage_table import peak_memory_mb, reset_peak_memory
from cortet.simulation.body import Material, body_of, scale_of, smallest_altitude, stable_time_step
from cortet.simulation.contact import contact_of
from cortet.simulation.kernels import DONE, Motion, advance, workspace
from tests.unit.shapes import cube_mesh

#: growth at every step: enough that no term of the forces is zero
_GROWTH = 1e-3


def measure(cells: float, threads: int, steps: int, answer: Any) -> None:
    """Time some steps in this process and send back a row of the table."""
    numba.set_num_threads(threads)
    run(cube_mesh(3, jitter=0.2), 1)  # load or compile the kernels
    mesh = cube_mesh(round((cells / 6) ** (1 / 3)), jitter=0.2)
    mesh = TetMesh(*ordered_along_curve(mesh.points, mesh.cells))
    reset_peak_memory()
    before = peak_memory_mb() or 0
    wall, cpu = run(mesh, steps)
    peak = peak_memory_mb() or 0
    work = len(mesh.cells) * steps / 1e6
    answer.send(
        {
            "tets": len(mesh.cells),
            "threads": threads,
            "wall_s": round(wall, 2),
            "cpu_s": round(cpu, 2),
            "million_element_steps_per_s": round(work / wall, 2),
            "per_cpu_s": round(work / cpu, 2),
            "peak_MB": peak,
            "MB_per_million_tets": round((peak - before) / len(mesh.cells) * 1e6),
        }
    )


def run(mesh: TetMesh, steps: int) -> tuple[float, float]:
    """Wall and CPU seconds of some steps; the CPU time is that of all threads."""
    scale, material = scale_of(mesh, None), Material()
    x = (mesh.points - scale.origin) / scale.length
    body = body_of(mesh, scale)
    state, work = Motion(x, np.zeros_like(x)), workspace(body)
    contact = contact_of(x, boundary_faces(mesh), bulk=material.bulk)
    dt = stable_time_step(smallest_altitude(x, mesh.cells), material)
    growth = np.full((steps, 1), _GROWTH)
    wall, cpu = time.perf_counter(), time.process_time()
    ended = advance(body, material, state, work, contact, growth, np.zeros(steps), dt)
    if ended != (steps, DONE):
        raise RuntimeError(f"the steps ended with {ended}")
    return time.perf_counter() - wall, time.process_time() - cpu


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", nargs="+", type=float, default=[1e5, 3e5, 1e6])
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--steps", type=int, default=20)
    options = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # threads that wait do not count as work
    context = multiprocessing.get_context("spawn")
    header = ""
    for cells in options.cells:
        for threads in options.threads:
            receive, send = context.Pipe(duplex=False)
            process = context.Process(target=measure, args=(cells, threads, options.steps, send))
            process.start()
            send.close()
            row = receive.recv()
            process.join()
            if not header:
                print(header := "  ".join(row))
            print("  ".join(f"{value:{len(name)}}" for name, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
