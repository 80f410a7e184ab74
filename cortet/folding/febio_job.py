"""A job for FEBio: the cortex of a mesh grows along itself, by kinematic growth of a neo-Hookean solid.

The material `kinematic growth` splits the deformation gradient into an elastic part and growth, F = Fe Fg. Its `area
growth` stretches by the square root of the multiplier in both directions across the first material axis, and not along
it. So this axis points across the cortex in each element (`mat_axis`), and the multiplier rises from 1 to
(1 + growth)^2.

Source: FEBio 4, FEGrowthTensor.cpp and FEKinematicGrowth.cpp (https://github.com/febiosoftware/FEBio), User Manual,
"Kinematic Growth". FEBio itself is in no package index, and no test runs it.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from cortet.folding.body import Material
from cortet.folding.growing_cortex import Support, along, growing, supports, young_and_poisson
from cortet.folding.plausible import refuse_shell
from cortet.formats import febio
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import CORE, CORTEX, with_surface
from cortet.formats.text import write_rows
from cortet.meshes import FloatArray, MeshSets, TetMesh

JOB, README = "job.feb", "README.txt"
#: set of the elements that grow
GROWING = "growing"
STEPS = 10


def write_job(mesh: TetMesh, folder: Path, *, growth: float, material: Material | None = None) -> None:
    """Write a folder that `febio4 -i job.feb` runs in.

    Parameters and errors are those of the job for CalculiX, but growth may be up to 1: 100 %.
    """
    refuse_shell(mesh.sets.cells)
    cortex, normals = growing(mesh, growth, most=1.0)
    material = material or Material()
    held = supports(mesh)
    shown = with_surface(mesh)
    # the parts are cortex and core, which come first, whatever regions the mesh has
    cells = {name: mesh.sets.cells[name] for name in (CORE, CORTEX) if name in mesh.sets.cells}
    cells |= {**mesh.sets.cells, GROWING: cortex}
    nodes = {**shown.sets.nodes, **{support.name: support.nodes for support in held}}
    folder.mkdir(parents=True, exist_ok=True)
    febio.write_elements(
        TetMesh(mesh.points, mesh.cells, sets=MeshSets({}, {}, cells)),
        mesh.points,
        mesh.cells,
        nodes,
        shown.sets.faces,
        {},
        folder / JOB,
        sections={
            "Control": f"<analysis>STATIC</analysis><time_steps>{STEPS}</time_steps>"
            f"<step_size>{1 / STEPS:g}</step_size>\n"
            '<solver type="solid"><symmetric_stiffness>symmetric</symmetric_stiffness></solver>\n',
            "Material": _materials(mesh, material),
            "MeshData": _axes(normals),
            "Boundary": "".join(map(_support, held)),
            "LoadData": '<load_controller id="1" type="loadcurve"><interpolate>LINEAR</interpolate>\n'
            f"<extend>CONSTANT</extend><points><pt>0,1</pt><pt>1,{(1 + growth) ** 2:.9g}</pt></points>"
            "</load_controller>\n",
            "Output": '<logfile><node_data data="ux;uy;uz" file="displacement.txt" delim=","/></logfile>\n'
            '<plotfile type="febio"><var type="displacement"/><var type="stress"/></plotfile>\n',
        },
    )
    with atomic_path(folder / README) as temporary:
        temporary.write_text(
            f"FEBio 4: the cortex grows by {100 * growth:g} % along the surface, made by cortet.\n"
            f"Run it here with:  febio4 -i {JOB}\n"
            "job.xplt has displacements (mm) and stresses, for FEBio Studio; displacement.txt the displacements.\n"
            "Stresses are in units of the shear modulus of the cortex; put your own materials into <Material>.\n"
            "A cortex that presses on itself needs contact, which is not in this job: for folds, `cortet fold`.\n",
            encoding="ascii",
        )


def _materials(mesh: TetMesh, material: Material) -> str:
    """Materials of the cortex, which grows, and of the core, if there is one, which does not."""
    grows = (
        f'<elastic type="neo-Hookean">{_elastic(material.mu_cortex, material.bulk)}</elastic>\n'
        '<growth type="area growth"><multiplier lc="1">1</multiplier></growth>\n'
    )
    one = f'<material id="{{}}" name="{CORTEX}" type="kinematic growth"><density>1</density>\n{grows}</material>\n'
    if not len(mesh.sets.cells.get(CORE, ())):
        return one.format(1)
    core = f'<material id="1" name="{CORE}" type="neo-Hookean">{_elastic(material.mu_core, material.bulk)}</material>\n'
    return core + one.format(2)


def _elastic(shear: float, bulk: float) -> str:
    young, poisson = young_and_poisson(shear, bulk)
    return f"<density>1</density><E>{young:.9g}</E><v>{poisson:.9g}</v>"


def _axes(normals: FloatArray) -> str:
    """Material axes of the growing elements; the first points across the cortex."""
    rows = io.StringIO()
    row = '<elem lid="%d"><a>%.9g,%.9g,%.9g</a><d>%.9g,%.9g,%.9g</d></elem>\n'
    write_rows(rows, row, np.arange(1, len(normals) + 1), normals, along(normals)[0])
    return f'<ElementData type="mat_axis" elem_set="{GROWING}">\n{rows.getvalue()}</ElementData>\n'


def _support(support: Support) -> str:
    held = "".join(f"<{axis}_dof>{int(number in support.axes)}</{axis}_dof>" for number, axis in enumerate("xyz"))
    return f'<bc name="{support.name}" type="zero displacement" node_set="{support.name}">{held}</bc>\n'
