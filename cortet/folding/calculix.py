"""A job for CalculiX: the cortex of a mesh grows slowly, and the rest gives way.

Growth is orthotropic thermal expansion. While the temperature rises from 0 to 1, each cortical element expands along
the cortex, not across it, in its own axes. The material is linearly elastic at large rotations, with the moduli of the
folding model. So the job follows `cortet fold` as long as strains are small: a few per cent of growth. Its implicit
solver, which treats volume differently, is a check of the explicit one.

References: CalculiX CrunchiX manual, *DISTRIBUTION, *ORIENTATION, *EXPANSION; Tallinen et al., Nature Physics 12, 2016.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cortet.folding.body import Material
from cortet.folding.growing_cortex import Part, along, growing, parts, supports, young_and_poisson
from cortet.formats import abaqus
from cortet.formats.atomic import atomic_path
from cortet.formats.text import write_rows
from cortet.geometry.quadratic import QuadraticMesh
from cortet.meshes import TetMesh
from cortet.solver_files.sets import set_name
from cortet.solver_files.ten_nodes import node_sets

MESH, JOB, README = "mesh.inp", "job.inp", "README.txt"


def write_job(
    mesh: TetMesh,
    folder: Path,
    *,
    growth: float,
    material: Material | None = None,
    moduli: Mapping[str, tuple[float, float | None]] | None = None,
    curved: QuadraticMesh | None = None,
) -> None:
    """Write a folder that `ccx job` runs in.

    Parameters
    ----------
    mesh : mm, with the sets `cortex` and `core`, also within a shell; the nodes of a set `medial_wall` stay in their
        sagittal plane
    folder : created if missing; its files `mesh.inp`, `job.inp` and `README.txt` are replaced
    growth : relative growth along the cortex at the end, above 0 and small: 0.05 is 5 %
    material : shear and bulk moduli, in units of the cortex's shear modulus; None takes those of the folding model
    moduli : those of further sets of tetrahedra, as `growing_cortex.parts`
    curved : `geometry.quadratic.quadratic` of the mesh, for elements of ten nodes; None: of four

    Raises
    ------
    InputError
        growth is not above 0 and at most 0.1; or the mesh has no cortex, lacks a set of `moduli`, or has tetrahedra
        without a material
    """
    cortex, normals = growing(mesh, growth, most=0.1)
    cortical, *others = parts(mesh, moduli or {}, material or Material())
    folder.mkdir(parents=True, exist_ok=True)
    if curved is None:
        abaqus.write(TetMesh(mesh.points, mesh.cells, sets=mesh.sets), folder / MESH)
    else:
        abaqus.write_elements(mesh, curved.points, curved.cells, node_sets(mesh, curved), folder / MESH)
    first, second = along(normals)
    with atomic_path(folder / JOB) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write(f"*INCLUDE, INPUT={MESH}\n** first and second axis of each cortical element\n")
        file.write("*DISTRIBUTION, NAME=along\n,1,0,0,0,1,0\n")
        write_rows(file, "%d,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", cortex + 1, first, second)
        file.write("*ORIENTATION, NAME=cortical, SYSTEM=RECTANGULAR\nalong\n")
        file.write(_elastic("grey", cortical))
        file.write(f"*EXPANSION, TYPE=ORTHO\n{growth:.9g},{growth:.9g},0.\n")
        file.write("*SOLID SECTION, ELSET=cortex, MATERIAL=grey, ORIENTATION=cortical\n")
        for one in others:
            name = set_name(f"of_{one.name}", mesh.sets.cells)
            file.write(f"*ELSET, ELSET={name}\n")
            write_rows(file, "%d\n", one.cells + 1)
            file.write(f"{_elastic(one.name, one)}*SOLID SECTION, ELSET={name}, MATERIAL={one.name}\n")
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


def _elastic(name: str, part: Part) -> str:
    """A material, given by Young's modulus and Poisson's ratio."""
    young, poisson = young_and_poisson(part.shear, part.bulk)
    return f"*MATERIAL, NAME={name}\n*ELASTIC\n{young:.9g},{poisson:.9g}\n"


def _supports(mesh: TetMesh) -> str:
    """Lines of *BOUNDARY: a single node appears by number, a run of consecutive axes by its first and last."""
    lines = []
    for support in supports(mesh):
        name = support.name if support.name in mesh.sets.nodes else str(1 + int(support.nodes[0]))
        runs = np.split(np.array(support.axes), np.flatnonzero(np.diff(support.axes) > 1) + 1)
        lines += [f"{name},{1 + run[0]},{1 + run[-1]}\n" for run in runs]
    return "".join(lines)
