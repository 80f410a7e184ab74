"""A growing cortex in dolfinx (0.5 and later): mesh and directions by cortet, the solution by a Python with dolfinx.

    python fenics.py           # where cortet is installed: writes the folder fenics-job, solves it if dolfinx is there
    python3 fenics.py solve    # in that folder, where dolfinx is installed (Debian: apt install python3-dolfinx)

`displacement.txt` then has a row of x, y, z and the displacement for every node, mm, and `displacement.xdmf` shows in
ParaView. The law is that of cortet's folding model: with Fe = F Fg^-1 the energy per grown volume is
mu / 2 (tr(Fe Fe^T) J^-2/3 - 3) + K / 2 (J - 1)^2, J = det Fe.
"""

import inspect
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

#: a Python that has dolfinx: that of the system, where Debian's python3-dolfinx is installed
DOLFINX = "/usr/bin/python3"
#: shear and bulk modulus of the folding model, in units of the shear modulus of the cortex
MODULI = {"cortex": (1.0, 5.0), "core": (1.167, 5.0)}
#: most growth in one step of the solution
STEP = 0.02
#: a step of growth is solved once no displacement changes by more than this, mm; and most Newton steps
SOLVED, MOST = 1e-8, 25


def write_job(mesh, folder, growth):
    """Write the mesh, its directions and moduli, and what holds it; the mesh has the sets `cortex` and `core`."""
    from cortet.folding.body import Scale, body_of
    from cortet.formats import fenics

    fenics.write(mesh, folder / "mesh.xdmf")
    normals, moduli = np.zeros((len(mesh.cells), 3)), np.zeros((len(mesh.cells), 2))
    cortex = mesh.sets.cells["cortex"]
    normals[cortex] = body_of(mesh, Scale(np.zeros(3), 1.0)).normals[cortex]
    for name, values in MODULI.items():
        moduli[mesh.sets.cells[name]] = values
    np.save(folder / "normals.npy", normals)
    np.save(folder / "moduli.npy", moduli)
    # six displacements of three nodes hold the body without pressing it; half a brain would keep x on its medial wall
    reach = np.ptp(mesh.points, axis=0) / 3
    nodes = [
        np.linalg.norm(mesh.points - mesh.points.mean(axis=0) - reach * way, axis=1).argmin()
        for way in ([0, 0, 0], [0, 1, 0], [0, 0, 1])
    ]
    supports = [
        {"axes": axes, "point": mesh.points[node].tolist()}
        for node, axes in zip(nodes, ([0, 1, 2], [0, 2], [0]), strict=True)
    ]
    job = {"growth": growth, "steps": int(np.ceil(growth / STEP)), "supports": supports}
    (folder / "job.json").write_text(json.dumps(job))


def has_dolfinx():
    """Whether that Python is there and has it."""
    if not Path(DOLFINX).exists():
        return False
    return subprocess.run([DOLFINX, "-c", "import dolfinx"], check=False, capture_output=True).returncode == 0


# --- by dolfinx ------------------------------------------------------------------------------------------------------


def solve(folder):
    """Solve the job in steps of growth, each by Newton's method."""
    import ufl
    from dolfinx import fem
    from dolfinx.fem import petsc
    from dolfinx.io import XDMFFile
    from mpi4py import MPI

    def space(family, degree):
        """Function space of vectors, made as the installed version of dolfinx requires."""
        if hasattr(fem, "functionspace"):
            return fem.functionspace(mesh, (family, degree, (3,)))
        return fem.VectorFunctionSpace(mesh, (family, degree))

    job = json.loads((folder / "job.json").read_text())
    with XDMFFile(MPI.COMM_WORLD, str(folder / "mesh.xdmf"), "r") as file:
        mesh = file.read_mesh(name="mesh")

    # quantities that are constant in each element
    mine = np.asarray(mesh.topology.original_cell_index)
    normal = fem.Function(space("DG", 0))
    normal.x.array.reshape(-1, 3)[: len(mine)] = np.load(folder / "normals.npy")[mine]
    material = fem.Function(space("DG", 0))  # shear modulus, bulk modulus, nothing
    material.x.array.reshape(-1, 3)[: len(mine), :2] = np.load(folder / "moduli.npy")[mine]

    functions = space("Lagrange", 1)
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
    fixed = []
    for support in job["supports"]:
        place = np.array(support["point"])[:, None]
        for axis in support["axes"]:
            part = functions.sub(axis)
            collapsed, _ = part.collapse()
            here = (part, collapsed)
            dofs = fem.locate_dofs_geometrical(here, lambda x, place=place: np.linalg.norm(x - place, axis=0) < 1e-6)
            fixed.append(fem.dirichletbc(fem.Function(collapsed), dofs, part))
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
                    print(f"growth {float(growth.value):.4f}: {newton} Newton steps", flush=True)
                break
        else:
            raise SystemExit(f"step {step}: not solved in {MOST} steps, the last moved nodes by {largest:g} mm")

    own = functions.dofmap.index_map.size_local
    rows = np.hstack([functions.tabulate_dof_coordinates()[:own], u.x.array.reshape(-1, 3)[:own]])
    every = mesh.comm.gather(rows)
    if mesh.comm.rank == 0:
        np.savetxt(folder / "displacement.txt", np.concatenate(every), fmt="%.9g", header="x y z ux uy uz, mm")
    u.name = "displacement"
    with XDMFFile(mesh.comm, str(folder / "displacement.xdmf"), "w") as file:
        file.write_mesh(mesh)
        file.write_function(u)


if __name__ == "__main__":
    if sys.argv[1:] == ["solve"]:
        solve(Path.cwd())
        sys.exit()
    import cortet
    from cortet.phantoms import phantom

    made = cortet.mesh(phantom(22, subdivisions=4), cell_size=3.5, ga=22, progress=False)
    here = Path("fenics-job")
    here.mkdir(exist_ok=True)
    write_job(made.named(), here, growth=0.05)
    length = np.linalg.norm(np.load(here / "normals.npy"), axis=1)
    assert np.allclose(length[made.named().sets.cells["cortex"]], 1)
    if has_dolfinx():
        subprocess.run([DOLFINX, Path(__file__).resolve(), "solve"], cwd=here, check=True)
        assert 0 < np.abs(np.loadtxt(here / "displacement.txt")[:, 3:]).max() < 3
    else:
        print(f"{DOLFINX} has no dolfinx: nothing is solved")
