"""A job for FEniCS (dolfinx): the cortex of a mesh grows along itself, by the law of the folding model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cortet.folding.body import Material
from cortet.folding.growing_cortex import growing, parts, supports
from cortet.formats import fenics
from cortet.formats.atomic import atomic_path, write_json
from cortet.formats.surface_sets import MEDIAL_WALL, with_surface
from cortet.formats.tags import face_tags
from cortet.meshes import TetMesh

MESH, JOB, README = "mesh.xdmf", "job.py", "README.txt"
#: the program of the job; it is copied into the folder
PROGRAM = Path(__file__).with_name("dolfinx_growth.py")
#: most growth in one step of the solution
STEP = 0.02


def write_job(
    mesh: TetMesh,
    folder: Path,
    *,
    growth: float,
    material: Material | None = None,
    moduli: Mapping[str, tuple[float, float | None]] | None = None,
) -> None:
    """Write a folder that `python3 job.py` runs in, where dolfinx is installed.

    Parameters and errors are those of the job for CalculiX, but growth may be up to 1: 100 %.
    """
    cortex, across = growing(mesh, growth, most=1.0)
    every = parts(mesh, moduli or {}, material or Material())
    folder.mkdir(parents=True, exist_ok=True)
    fenics.write(TetMesh(mesh.points, mesh.cells, sets=mesh.sets), folder / MESH)
    normals = np.zeros((len(mesh.cells), 3))
    normals[cortex] = across
    of_cells = np.zeros((len(mesh.cells), 2))
    for part in every:
        of_cells[part.cells] = part.shear, part.bulk
    for name, values in (("normals", normals), ("moduli", of_cells)):
        with atomic_path(folder / f"{name}.npy") as temporary, temporary.open("wb") as file:
            np.save(file, values)
    numbers = face_tags(with_surface(mesh))
    write_json(
        {
            "growth": growth,
            "steps": int(np.ceil(growth / STEP)),
            "supports": [
                {"axes": list(support.axes), "facets": numbers[MEDIAL_WALL]}
                if support.name == MEDIAL_WALL
                else {"axes": list(support.axes), "point": mesh.points[support.nodes[0]].tolist()}
                for support in supports(mesh)
            ],
        },
        folder / "job.json",
    )
    with atomic_path(folder / JOB) as temporary:
        temporary.write_text(PROGRAM.read_text(encoding="utf-8"), encoding="utf-8")
    with atomic_path(folder / README) as temporary:
        temporary.write_text(
            f"dolfinx: the cortex grows by {100 * growth:g} % along the surface, made by cortet.\n"
            f"Run it here with:  python3 {JOB}   (Debian: apt install python3-dolfinx; run with 0.5.2)\n"
            "displacement.xdmf shows in ParaView; displacement.txt has x, y, z and displacement (mm) of each node.\n"
            "Growth and supports are in job.json, each element's direction across the cortex in normals.npy and its\n"
            "shear and bulk moduli, in units of the shear modulus of the cortex, in moduli.npy.\n"
            "A cortex that presses on itself needs contact, which is not in this job: for folds, `cortet fold`.\n",
            encoding="ascii",
        )
