"""The cortex of a mesh grows along itself: a job that cortet wrote, for dolfinx (0.5 and later).

    python3 job.py

It reads `mesh.xdmf`, `mesh_facets.xdmf`, `normals.npy`, `moduli.npy` and `job.json` beside it, and writes
`displacement.txt` (a row of x, y, z and the displacement for every node, mm) and `displacement.xdmf`. The law is that
of cortet's folding model: with Fe = F Fg^-1 the energy per grown volume is mu / 2 (tr(Fe Fe^T) J^-2/3 - 3) +
K / 2 (J - 1)^2, J = det Fe. cortet itself does not import this file.
"""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from dolfinx.io import XDMFFile
from mpi4py import MPI

HERE = Path(__file__).resolve().parent
#: a step of growth is solved once no displacement changes by more than this, mm; and most Newton steps
SOLVED, MOST = 1e-8, 25


def space(mesh: Any, family: str, degree: int) -> Any:
    """Function space of vectors, made as the installed version of dolfinx requires."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(mesh, (family, degree, (3,)))
    return fem.VectorFunctionSpace(mesh, (family, degree))


def at(point: list[float]) -> Any:
    """A marker of the node at this position."""
    return lambda x: np.linalg.norm(x - np.array(point)[:, None], axis=0) < 1e-6


def held(job: dict[str, Any], functions: Any, facets: Any) -> list[Any]:
    """Boundary conditions that fix coordinates of single nodes, or of the nodes of tagged facets."""
    found = []
    for support in job["supports"]:
        for axis in support["axes"]:
            part = functions.sub(axis)
            if "point" in support:
                collapsed, _ = part.collapse()
                dofs = fem.locate_dofs_geometrical((part, collapsed), at(support["point"]))
                nothing = fem.Function(collapsed)
                found.append(fem.dirichletbc(nothing, dofs, part))
            else:
                dofs = fem.locate_dofs_topological(part, 2, facets.find(support["facets"]))
                found.append(fem.dirichletbc(0.0, dofs, part))
    return found


def main() -> None:
    """Solve the job in steps of growth, each by Newton's method."""
    job = json.loads((HERE / "job.json").read_text())
    with XDMFFile(MPI.COMM_WORLD, str(HERE / "mesh.xdmf"), "r") as file:
        mesh = file.read_mesh(name="mesh")
    mesh.topology.create_connectivity(2, 3)
    with XDMFFile(MPI.COMM_WORLD, str(HERE / "mesh_facets.xdmf"), "r") as file:
        facets = file.read_meshtags(mesh, name="facets")

    # quantities that are constant in each element
    mine = np.asarray(mesh.topology.original_cell_index)
    normal = fem.Function(space(mesh, "DG", 0))
    normal.x.array.reshape(-1, 3)[: len(mine)] = np.load(HERE / "normals.npy")[mine]
    material = fem.Function(space(mesh, "DG", 0))  # shear modulus, bulk modulus, nothing
    material.x.array.reshape(-1, 3)[: len(mine), :2] = np.load(HERE / "moduli.npy")[mine]

    functions = space(mesh, "Lagrange", 1)
    u, test, change = fem.Function(functions), ufl.TestFunction(functions), ufl.TrialFunction(functions)
    growth = fem.Constant(mesh, 0.0)
    identity = ufl.Identity(3)
    # unit vectors in the cortex, 0 in the core: nothing grows across the cortex
    stretch = 1 + growth * ufl.inner(normal, normal)
    grown = stretch * identity + (1 - stretch) * ufl.outer(normal, normal)
    elastic = (identity + ufl.grad(u)) * ufl.inv(grown)
    volume = ufl.det(elastic)
    density = material[0] / 2 * (ufl.tr(elastic * elastic.T) * volume ** (-2 / 3) - 3)
    density += material[1] / 2 * (volume - 1) ** 2
    energy = ufl.det(grown) * density * ufl.dx
    residual = ufl.derivative(energy, u, test)
    tangent = ufl.derivative(residual, u, change)
    fixed = held(job, functions, facets)
    options = {"ksp_type": "preonly", "pc_type": "lu"}
    further = {"petsc_options_prefix": "growth_"}
    if "petsc_options_prefix" not in inspect.signature(petsc.LinearProblem.__init__).parameters:
        further = {}
    problem = petsc.LinearProblem(tangent, -residual, bcs=fixed, petsc_options=options, **further)
    for step in range(1, job["steps"] + 1):
        growth.value = job["growth"] * step / job["steps"]
        for newton in range(1, MOST + 1):
            moved = problem.solve()
            u.x.array[:] += moved.x.array
            largest = mesh.comm.allreduce(float(np.abs(moved.x.array).max()), op=MPI.MAX)
            if largest < SOLVED:
                if mesh.comm.rank == 0:
                    print(f"growth {float(growth.value):.4f}: {newton} Newton steps", flush=True)  # noqa: T201
                break
        else:
            raise SystemExit(f"step {step}: not solved in {MOST} steps, the last moved nodes by {largest:g} mm")

    own = functions.dofmap.index_map.size_local
    rows = np.hstack([functions.tabulate_dof_coordinates()[:own], u.x.array.reshape(-1, 3)[:own]])
    every = mesh.comm.gather(rows)
    if mesh.comm.rank == 0:
        np.savetxt(HERE / "displacement.txt", np.concatenate(every), fmt="%.9g", header="x y z ux uy uz, mm")
    u.name = "displacement"
    with XDMFFile(mesh.comm, str(HERE / "displacement.xdmf"), "w") as file:
        file.write_mesh(mesh)
        file.write_function(u)


if __name__ == "__main__":
    main()
