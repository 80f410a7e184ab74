"""How fast are the steps of a fold?

    python benchmarks/fold_speed.py [--cells 1e5 3e5 1e6] [--threads 1 2] [--steps 20]

The body is a cube of Kuhn tetrahedra with displaced inner nodes that grows as a cortex does, its surface
in contact search; each row is a process of its own, kernels compiled beforehand. On a busy machine wall time says
little: compare the CPU seconds, and element-steps per CPU second and core. Memory is the peak of the process from the
making of the body on, and what of it is above that before. Bytes are what a step has to bring from memory and back,
every array once in each loop that uses it; operations are those of the formulas. Beside them stand what a plain sum of
arrays and plain multiply-adds reach on one core at that moment, and how CPU seconds grow with the number of tetrahedra.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence

import numba
import numpy as np
from _frame import Row, Table, alone, command, peak_memory_mb, print_power, reset_peak_memory
from cubes import cube_mesh

from cortet.folding.body import Material, body_of, scale_of
from cortet.folding.contact import contact_of
from cortet.folding.growth import Course
from cortet.folding.kernels import DONE, Motion, Work, advance, workspace
from cortet.folding.models import course
from cortet.folding.patches import ROWS
from cortet.folding.stability import longest_step
from cortet.geometry.ordering import ordered_along_curve
from cortet.geometry.topology import boundary_faces
from cortet.meshes import TetMesh

COLUMNS = (
    *("tets", "threads", "wall_s", "cpu_s", "million_element_steps_per_s", "per_cpu_s", "bytes", "GB_per_cpu_s"),
    *("GFLOP_per_cpu_s", "GB_per_s", "peak_MB", "MB_per_million_tets"),
)
#: growth at every step: enough that no term of the forces is zero
_GROWTH = 1e-3
#: additions, multiplications and divisions per element and step, counted in the source: edges from a corner 2 x 9,
#: growth and volumes 2 x 62, gradients after growth 2 x 50, F 2 x 45, its weight 11, cofactors, J and tr B 49, J^(-1/3)
#: 35, stress 43, that of edges added 72, forces 54, sums 30; and 1.2 edges: sums 50, F 10, stress 127
OPERATIONS = 626 + 1.2 * 187
#: bytes per element: all rows twice, corners and label in both; weight and weighted F written and read; six edges; and
#: of 1.2 edges, five elements, and the stress written and read
_ELEMENT_BYTES = 2 * (ROWS * 8 + 12) + 2 * 80 + 6 * 8 + 1.2 * (5 * 8 + 2 * 72)
#: bytes per slot: its node or number four times, volumes and forces written and read
_SLOT_BYTES = 4 * 4 + 2 * 16 + 2 * 24
#: bytes per node: positions read three times and written, velocities, contact forces, volume and ratio, offsets, held
_NODE_BYTES = 4 * 24 + 2 * 24 + 24 + 2 * 16 + 2 * 8 + 1


def steps(
    *,
    cells: Sequence[float] = (1e5, 3e5, 1e6),
    threads: Sequence[int] = (1, 2),
    steps: int = 20,
) -> None:
    """Time some steps on cubes of several sizes."""
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # threads that wait do not count as work
    print(f"{machine()}; {OPERATIONS:.0f} operations per element-step")
    table = Table(*COLUMNS)
    rows = [table.add(alone(of_cube, size, count, steps)) for size in cells for count in threads]
    for count in threads:
        print_power(f"{count} threads", (row for row in rows if row["threads"] == count), y="cpu_s")


def of_cube(cells: float, threads: int, steps: int) -> Row:
    """Time some steps in this process, a row of the table."""
    numba.set_num_threads(threads)
    steps_of(cube_mesh(3, jitter=0.2), 1)  # load or compile the kernels
    mesh = cube_mesh(round((cells / 6) ** (1 / 3)), jitter=0.2)
    mesh = TetMesh(*ordered_along_curve(mesh.points, mesh.cells)[:2])
    reset_peak_memory()
    before = peak_memory_mb() or 0
    wall, cpu, bytes_moved = steps_of(mesh, steps)
    peak = peak_memory_mb() or 0
    work = len(mesh.cells) * steps / 1e6
    return {
        "tets": len(mesh.cells),
        "threads": threads,
        "wall_s": wall,
        "cpu_s": cpu,
        "million_element_steps_per_s": work / wall,
        "per_cpu_s": work / cpu,
        "bytes": round(bytes_moved),
        "GB_per_cpu_s": bytes_moved * work / cpu / 1e3,
        "GFLOP_per_cpu_s": OPERATIONS * work / cpu / 1e3,
        "GB_per_s": bytes_moved * work / wall / 1e3,
        "peak_MB": peak,
        "MB_per_million_tets": round((peak - before) / len(mesh.cells) * 1e6),
    }


def steps_of(mesh: TetMesh, steps: int) -> tuple[float, float, float]:
    """Wall and CPU seconds of some steps, and bytes per element-step; the CPU time is that of all threads."""
    scale, material = scale_of(mesh, None), Material()
    x = (mesh.points - scale.origin) / scale.length
    body = body_of(mesh, scale)
    state, work = Motion(x, np.zeros_like(x)), workspace(body)
    contact = contact_of(x, boundary_faces(mesh), bulk=material.bulk)
    growth = course(np.full((steps, 1), _GROWTH))
    dt, _ = longest_step(material, x, work, contact, growth.growth[0])
    wall, cpu = time.perf_counter(), time.process_time()
    for first in range(0, steps, 100):
        batch = Course(*(values[first : first + 100] for values in growth))
        ended = advance(body, material, state, work, contact, batch, dt)
        if ended != (len(batch.thickening), DONE):
            raise RuntimeError(f"the steps ended with {ended}")
    seconds = time.perf_counter() - wall, time.process_time() - cpu
    return *seconds, bytes_per_element(mesh, work)


def bytes_per_element(mesh: TetMesh, work: Work) -> float:
    """Bytes that a step moves per tetrahedron."""
    return _ELEMENT_BYTES + (len(work.patches.nodes) * _SLOT_BYTES + len(mesh.points) * _NODE_BYTES) / len(mesh.cells)


def machine() -> str:
    """What one core reaches now: bytes of a + 3 b into c, too long for any cache; multiply-adds on 64 numbers."""
    a, b, c = np.ones((3, 10**7))
    _copy(a, b, c), _multiply_add(1, 0.5)
    began = time.process_time()
    for _ in range(5):
        _copy(a, b, c)
    copied = time.process_time()
    _multiply_add(10**7, 0.999)
    ended = time.process_time()
    return (
        f"one core: {5 * 24 * len(a) / (copied - began) / 1e9:.1f} GB/s of a plain sum of arrays, "
        f"{10**7 * 128 / (ended - copied) / 1e9:.0f} GFLOP/s"
    )


@numba.njit
def _copy(a, b, c):  # type: ignore[no-untyped-def]
    for i in range(len(a)):
        c[i] = a[i] + 3.0 * b[i]


@numba.njit(fastmath={"contract"})
def _multiply_add(n, x):  # type: ignore[no-untyped-def]
    values = np.ones(64)
    for _ in range(n):
        for i in range(64):
            values[i] = values[i] * x + x
    return values.sum()


main = command(__doc__, steps)

if __name__ == "__main__":
    main()
