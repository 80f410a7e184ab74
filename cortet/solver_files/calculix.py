"""A job for CalculiX: the cortex of a mesh grows, slowly, and everything else gives way.

Growth is orthotropic thermal expansion: a cortical element expands along the cortex and not across it, in axes of its
own, while the temperature rises from 0 to 1. The material is linearly elastic at large rotations, with the moduli of
the folding model, so the job follows `cortet fold` as long as strains are small: some per cent of growth. It is solved
by an implicit method with another treatment of volume, and thereby checks the explicit one.

References: CalculiX CrunchiX manual, *DISTRIBUTION, *ORIENTATION, *EXPANSION; Tallinen et al., Nature Physics 12, 2016.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cortet.errors import InputError
from cortet.formats import abaqus
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import MEDIAL_WALL
from cortet.formats.text import write_rows
from cortet.geometry.topology import boundary_nodes
from cortet.mesh import FloatArray, IntArray, TetMesh
from cortet.simulation.body import Material, Scale, body_of

MESH, JOB, README = "mesh.inp", "job.inp", "README.txt"


def write_job(mesh: TetMesh, folder: Path, *, growth: float, material: Material | None = None) -> None:
    """Write a folder that `ccx job` runs in.

    Parameters
    ----------
    mesh : mm, with the sets `cortex` and `core`; the nodes of a set `medial_wall` stay in their sagittal plane
    folder : made where it is not; its files `mesh.inp`, `job.inp` and `README.txt` are replaced
    growth : relative growth along the cortex at the end, above 0 and small: 0.05 is 5 %
    material : shear and bulk moduli, in units of the cortex's shear modulus; None: those of the folding model

    Raises
    ------
    InputError : growth is not above 0 and at most 0.1, or the mesh has no cortex
    """
    if not 0 < growth <= 0.1:
        raise InputError(f"growth is {growth:g}, but the material holds for small strains", remedy="0.01 to 0.1")
    cortex = mesh.sets.cells.get("cortex", np.zeros(0, np.int32))
    if not len(cortex):
        raise InputError("the mesh has no set `cortex`", remedy="read one that cortet exported")
    material = material or Material()
    folder.mkdir(parents=True, exist_ok=True)
    abaqus.write(TetMesh(mesh.points, mesh.cells, sets=mesh.sets), folder / MESH)
    first, second = _along(body_of(mesh, Scale(np.zeros(3), 1.0)).normals[cortex])
    with atomic_path(folder / JOB) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write(f"*INCLUDE, INPUT={MESH}\n** first and second axis of each cortical element\n")
        file.write("*DISTRIBUTION, NAME=along\n,1,0,0,0,1,0\n")
        write_rows(file, "%d,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", cortex + 1, first, second)
        file.write("*ORIENTATION, NAME=cortical, SYSTEM=RECTANGULAR\nalong\n")
        file.write(_elastic("grey", material.mu_cortex, material.bulk))
        file.write(f"*EXPANSION, TYPE=ORTHO\n{growth:.9g},{growth:.9g},0.\n")
        file.write("*SOLID SECTION, ELSET=cortex, MATERIAL=grey, ORIENTATION=cortical\n")
        if len(mesh.sets.cells.get("core", ())):
            file.write(_elastic("white", material.mu_core, material.bulk))
            file.write("*SOLID SECTION, ELSET=core, MATERIAL=white\n")
        file.write(f"*INITIAL CONDITIONS, TYPE=TEMPERATURE\n{abaqus.ALL_NODES},0.\n")
        file.write(f"*STEP, NLGEOM\n*STATIC\n0.5,1.\n*BOUNDARY\n{_supports(mesh)}")
        file.write(f"*TEMPERATURE\n{abaqus.ALL_NODES},1.\n")
        file.write(f"*NODE FILE\nU\n*EL FILE\nS\n*NODE PRINT, NSET={abaqus.ALL_NODES}\nU\n*END STEP\n")
    with atomic_path(folder / README) as temporary:
        temporary.write_text(
            f"CalculiX: the cortex grows by {100 * growth:g} % along the surface, made by cortet.\n"
            f"Run it here with:  ccx {Path(JOB).stem}\n"
            "job.frd has displacements (mm) and stresses, for cgx or ParaView; job.dat the displacements as a table.\n"
            "Stresses are in units of the shear modulus of the cortex.\n"
            "Strains must stay small: for folds, run `cortet fold`.\n",
            encoding="ascii",
        )


def _elastic(name: str, shear: float, bulk: float) -> str:
    """A material by its Young's modulus and Poisson's ratio."""
    young, poisson = 9 * bulk * shear / (3 * bulk + shear), (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear)
    return f"*MATERIAL, NAME={name}\n*ELASTIC\n{young:.9g},{poisson:.9g}\n"


def _along(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors across each of (k, 3) unit normals, and across each other."""
    start = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    first = np.cross(normals, start)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(normals, first)


def _supports(mesh: TetMesh) -> str:
    """Lines of *BOUNDARY that keep the body in place without pressing it.

    Six displacements of three nodes: one in the middle, one ahead of it and one above it. With a medial wall, whose
    nodes keep their x, the three are on it, and three displacements are left.
    """
    wall: IntArray = mesh.sets.nodes.get(MEDIAL_WALL, np.zeros(0, np.int32))
    among = wall if len(wall) else np.setdiff1d(np.arange(len(mesh.points)), boundary_nodes(mesh))
    places = mesh.points[among]
    middle, reach = places.mean(axis=0), np.ptp(places, axis=0) / 3
    centre, ahead, above = (
        1 + int(among[np.linalg.norm(places - middle - reach * way, axis=1).argmin()])
        for way in ([0, 0, 0], [0, 1, 0], [0, 0, 1])
    )
    if len(wall):
        return f"{MEDIAL_WALL},1,1\n{centre},2,3\n{ahead},3,3\n"
    return f"{centre},1,3\n{ahead},1,1\n{ahead},3,3\n{above},1,1\n"
