"""A growing cortex in CalculiX: mesh, job, run, displacement.

Growth is orthotropic thermal expansion: while the temperature rises from 0 to 1, each element of the cortex expands
along the cortex, not across it, in axes of its own. The material is linearly elastic at large rotations, so growth must
be a few per cent: for folds there is `cortet fold`, which CalculiX checks here.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np

import cortet
from cortet.folding.body import Scale, body_of
from cortet.formats import abaqus
from cortet.phantoms import phantom

#: Young's modulus and Poisson's ratio of the folding model, in units of the shear modulus of the cortex
MATERIALS = {"cortex": (2.8125, 0.40625), "core": (3.2483, 0.39172)}


def write_job(mesh, folder, growth):
    """Write `mesh.inp` and `job.inp`; the mesh has the sets `cortex` and `core`, each other set may have a material."""
    abaqus.write(mesh, folder / "mesh.inp")
    normals = body_of(mesh, Scale(np.zeros(3), 1.0)).normals[mesh.sets.cells["cortex"]]
    other = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(normals, other)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.column_stack([mesh.sets.cells["cortex"] + 1, first, np.cross(normals, first)])
    lines = ["*INCLUDE, INPUT=mesh.inp", "*DISTRIBUTION, NAME=along", ",1,0,0,0,1,0"]
    lines += [f"{row[0]:.0f}," + ",".join(f"{value:.9g}" for value in row[1:]) for row in axes]
    lines += ["*ORIENTATION, NAME=cortical, SYSTEM=RECTANGULAR", "along"]
    for name, (young, poisson) in MATERIALS.items():
        lines += [f"*MATERIAL, NAME={name}_material", "*ELASTIC", f"{young},{poisson}"]
        if name == "cortex":
            lines += ["*EXPANSION, TYPE=ORTHO", f"{growth},{growth},0."]
        orientation = ", ORIENTATION=cortical" if name == "cortex" else ""
        lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL={name}_material{orientation}"]
    # six displacements of three nodes hold the body without pressing it; half a brain would keep x on its medial wall
    reach = np.ptp(mesh.points, axis=0) / 3
    centre, ahead, above = (
        1 + np.linalg.norm(mesh.points - mesh.points.mean(axis=0) - reach * way, axis=1).argmin()
        for way in ([0, 0, 0], [0, 1, 0], [0, 0, 1])
    )
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "all_nodes,0.", "*STEP, NLGEOM", "*STATIC", "0.5,1."]
    lines += ["*BOUNDARY", f"{centre},1,3", f"{ahead},1", f"{ahead},3", f"{above},1", "*TEMPERATURE", "all_nodes,1."]
    lines += ["*NODE FILE", "U", "*EL FILE", "S", "*NODE PRINT, NSET=all_nodes", "U", "*END STEP"]
    (folder / "job.inp").write_text("\n".join(lines) + "\n")


def displacement(mesh, folder):
    """Run the job; how far each node has moved at the end: (n, 3) mm."""
    subprocess.run(["ccx", "job"], cwd=folder, check=True, capture_output=True)
    rows = [line.split() for line in (folder / "job.dat").read_text().splitlines()]
    return np.array([row[1:] for row in rows if len(row) == 4 and row[0].isdecimal()][-len(mesh.points) :], float)


if __name__ == "__main__":
    made = cortet.mesh(phantom(22, subdivisions=4), cell_size=3.5, ga=22, progress=False)
    job = Path("calculix-job")
    job.mkdir(exist_ok=True)
    write_job(made.named(), job, growth=0.02)
    assert "*EXPANSION" in (job / "job.inp").read_text()
    if shutil.which("ccx"):
        moved = displacement(made.mesh, job)
        print(f"CalculiX moves nodes by up to {np.linalg.norm(moved, axis=1).max():.2f} mm; stresses are in job.frd")
        assert 0 < np.abs(moved).max() < 1
    else:
        print("CalculiX (ccx) is not installed: nothing is solved")
