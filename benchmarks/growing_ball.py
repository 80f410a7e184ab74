"""A ball whose outer shell grows along itself: CalculiX, dolfinx and our own solver beside the exact displacements.

    python benchmarks/growing_ball.py [--cell-sizes 2.5 1.75 1.25] [--growth 0.02]

The shell, from a radius of 10 to 14 mm, is the cortex of a mesh of two regions. Displacements are outward and in mm, of
the outside and of the interface. Exact ones are of linear elasticity. CalculiX (ccx) solves the job that `cortet job`
writes, and so does dolfinx, with `--dolfinx 'COMMAND OF A PYTHON THAT HAS IT'`; ours is the folding model, damped until
nothing moves.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from cortet.geometry.nesting import nested
from cortet.geometry.quadratic import QuadraticMesh
from cortet.geometry.topology import boundary_faces
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.simulation.altitude import smallest_altitude
from cortet.simulation.body import Material, Scale, body_of, stable_time_step
from cortet.simulation.contact import contact_of
from cortet.simulation.kernels import DONE, Motion, advance, workspace
from cortet.simulation.models import course
from cortet.solver_files import fenics_job
from cortet.solver_files.calculix import write_job
from cortet.solver_files.sets import named_sets
from cortet.stages.generate import generate
from cortet.stages.solver_ready import surface_nodes_first

INNER, OUTER = 10.0, 14.0
#: a Python that has dolfinx: that of the system, where Debian's python3-dolfinx is installed
DOLFINX = ("/usr/bin/python3",)
#: dimensionless damping, in the place of the model's 0.5: enough that nothing swings for long
_DAMPING = 5.0
#: steps between two looks at the largest speed, and the speed at which the body rests
_STEPS, _REST = 500, 1e-9


def surfaces() -> TriSurface:
    """The outside of the ball, with the interface inside it."""
    outer, inner = (trimesh.creation.icosphere(subdivisions=4, radius=radius) for radius in (OUTER, INNER))
    return nested(TriSurface(outer.vertices, outer.faces), {"white": TriSurface(inner.vertices, inner.faces)})


def ball(cell_size: float) -> TetMesh:
    """The mesh, with its sets."""
    mesh, _ = surface_nodes_first(generate(surfaces(), cell_size=cell_size)[0])
    return named_sets(mesh, inner=["white"])


def exact(growth: float, material: Material) -> tuple[float, float]:
    """Displacements of the outside and of the interface, mm.

    In the core u = A r. In the shell, whose stress-free strain is `growth` in both tangential directions, equilibrium
    is u'' + 2 u' / r - 2 u / r^2 = -4 mu growth / (lambda + 2 mu) / r, so u = B r + C / r^2 + c r ln r.
    """
    shear, bulk = material.mu_cortex, material.bulk
    first = bulk - 2 / 3 * shear
    stiff = first + 2 * shear
    c = -4 * shear * growth / (3 * stiff)

    def displacement(r: float) -> FloatArray:
        return np.array([r, 1 / r**2, c * r * np.log(r)])

    def stress(r: float) -> FloatArray:
        slope = np.array([1, -2 / r**3, c * (np.log(r) + 1)])
        return stiff * slope + 2 * first * displacement(r) / r - [0, 0, 2 * first * growth]

    at_inner, at_outer, pressed, free = displacement(INNER), displacement(OUTER), stress(INNER), stress(OUTER)
    equations = [[INNER, *-at_inner[:2]], [3 * bulk, *-pressed[:2]], [0, *free[:2]]]
    a, *shell = np.linalg.solve(equations, [at_inner[2], pressed[2], -free[2]])
    return float(at_outer @ [*shell, 1]), float(a * INNER)


def by_calculix(mesh: TetMesh, growth: float, curved: QuadraticMesh | None = None) -> FloatArray:
    """Displacements of all corners: (n, 3) mm; with elements of ten nodes if they are given."""
    with tempfile.TemporaryDirectory() as folder:
        write_job(mesh, Path(folder), growth=growth, curved=curved)
        subprocess.run(["ccx", "job"], cwd=folder, capture_output=True, check=True)
        rows = [line.split() for line in Path(folder, "job.dat").read_text().splitlines()]
    found = [row[1:] for row in rows if len(row) == 4 and row[0].isdecimal()]
    return np.array(found[-len((curved or mesh).points) :][: len(mesh.points)], float)


def by_dolfinx(mesh: TetMesh, growth: float, python: Sequence[str] = DOLFINX) -> FloatArray:
    """The same by dolfinx, in the law of the folding model."""
    with tempfile.TemporaryDirectory() as folder:
        fenics_job.write_job(mesh, Path(folder), growth=growth)
        subprocess.run([*python, "job.py"], cwd=folder, capture_output=True, check=True)
        rows = np.loadtxt(Path(folder, "displacement.txt"))
    found: FloatArray = rows[cKDTree(rows[:, :3]).query(mesh.points)[1], 3:]
    return found


def by_cortet(mesh: TetMesh, growth: float) -> FloatArray:
    """The same by the folding model, at rest."""
    points, material = mesh.points / OUTER, Material(damping=_DAMPING)
    body = body_of(mesh, Scale(np.zeros(3), OUTER))
    work, state = workspace(body), Motion(points.copy(), np.zeros(points.shape))
    contact = contact_of(points, boundary_faces(mesh), bulk=material.bulk)._replace(radius=np.inf)
    dt = 3 * stable_time_step(smallest_altitude(points, mesh.cells), material)
    while True:
        steps = course(np.full((_STEPS, 1), growth))
        if advance(body, material, state, work, contact, steps, dt) != (_STEPS, DONE):
            raise RuntimeError("an element inverted")
        if np.abs(state.v).max() < _REST:
            return OUTER * (state.x - points)


def outward(mesh: TetMesh, displacement: FloatArray) -> tuple[float, float]:
    """Mean displacement away from the centre, of the outside and of the interface, mm."""
    length = np.linalg.norm(mesh.points, axis=1)
    along = np.einsum("nc,nc->n", displacement, mesh.points) / np.maximum(length, 1e-9)
    outside, interface = (along[mesh.sets.nodes[name]].mean() for name in ("cortical_surface", "white_interface"))
    return float(outside), float(interface)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cell-sizes", nargs="+", type=float, default=[2.5, 1.75, 1.25])
    parser.add_argument("--growth", type=float, default=0.02)
    parser.add_argument(
        "--dolfinx", type=shlex.split, metavar="PYTHON", help="also solve it with this Python's dolfinx"
    )
    options = parser.parse_args()
    solvers: dict[str, Callable[[TetMesh, float], FloatArray]] = {"CalculiX": by_calculix, "cortet": by_cortet}
    if options.dolfinx:
        solvers["dolfinx"] = partial(by_dolfinx, python=options.dolfinx)
    print("solver     h mm    tets  outside  interface  CPU s")
    print("exact                  " + "{:9.4f}  {:9.4f}".format(*exact(options.growth, Material())))
    for cell_size in options.cell_sizes:
        mesh = ball(cell_size)
        for name, solve in solvers.items():
            began = sum(_times())
            found = outward(mesh, solve(mesh, options.growth))
            seconds = sum(_times()) - began
            print(
                f"{name:9s}  {cell_size:4.2f}  {len(mesh.cells):6d}  {found[0]:7.4f}  {found[1]:9.4f}  {seconds:5.0f}",
                flush=True,
            )


def _times() -> tuple[float, float]:
    """CPU seconds of this process and of its children that ended."""
    import resource

    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time(), children.ru_utime + children.ru_stime


if __name__ == "__main__":
    main()
