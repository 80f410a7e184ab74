"""A mesh of two regions as solvers and readers of other projects see it: two materials, tagged cells and facets."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np
import pytest
from shapes import ball_surface

from cortet.formats import abaqus, fenics, msh
from cortet.geometry.nesting import nested
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh
from cortet.solver_files.sets import named_sets
from cortet.stages.generate import generate
from cortet.stages.solver_ready import surface_nodes_first

INNER, OUTER = 10.0, 14.0


@pytest.fixture(scope="module")
def balls() -> TetMesh:
    """One ball inside another, with its regions and surfaces as sets."""
    pair = nested(ball_surface(4, OUTER), {"white": ball_surface(4, INNER)})
    mesh, _ = surface_nodes_first(generate(pair, cell_size=1.6)[0])
    return named_sets(mesh, inner=["white"])


def lame(core: tuple[float, float], shell: tuple[float, float], pressure: float) -> tuple[float, float, float]:
    """Displacements outward at the outside and at the interface, mm, and the stress in the ball.

    They are A r in a solid ball and B r + C / r^2 in a shell around it. Both are isotropic (E, nu), stick together, and
    feel a pressure from outside: equal displacements and radial stresses at the interface, -p at the outside (Lame;
    Timoshenko and Goodier, Theory of Elasticity, section 136).
    """
    k_core = core[0] / (3 * (1 - 2 * core[1]))
    k, g = shell[0] / (3 * (1 - 2 * shell[1])), shell[0] / (2 * (1 + shell[1]))
    equations = [
        [INNER, -INNER, -1 / INNER**2],
        [3 * k_core, -3 * k, 4 * g / INNER**3],
        [0, 3 * k, -4 * g / OUTER**3],
    ]
    a, b, c = np.linalg.solve(equations, [0, 0, -pressure]).tolist()
    return b * OUTER + c / OUTER**2, a * INNER, 3 * k_core * a


def tables(path: Path, columns: int) -> Iterator[np.ndarray]:
    """The tables of a .dat file of CalculiX with so many numbers in a row."""
    rows: list[list[str]] = []
    for line in [*path.read_text().splitlines(), ""]:
        words = line.split()
        if len(words) == columns and words[0].isdecimal():
            rows.append(words)
        elif rows and words:
            yield np.array(rows, float)
            rows = []
    if rows:
        yield np.array(rows, float)


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")
def test_calculix_finds_what_lame_found_for_a_soft_shell_around_a_stiff_ball(balls: TetMesh, tmp_path: Path) -> None:
    core, shell, pressure = (1000.0, 0.3), (250.0, 0.35), 10.0
    abaqus.write(balls, tmp_path / "balls.inp")
    # six displacements that hold the body without a force, as the pressure has none
    centre, along_x, along_y = (
        1 + int(np.linalg.norm(balls.points - place, axis=1).argmin()) for place in ([0, 0, 0], [8, 0, 0], [0, 8, 0])
    )
    job = [
        "*INCLUDE, INPUT=balls.inp",
        *(f"*MATERIAL, NAME={name}\n*ELASTIC\n{e}, {nu}" for name, (e, nu) in (("grey", shell), ("white", core))),
        "*SOLID SECTION, ELSET=cortex, MATERIAL=grey",
        "*SOLID SECTION, ELSET=core, MATERIAL=white",
        "*STEP\n*STATIC",
        f"*BOUNDARY\n{centre}, 1, 3\n{along_x}, 2, 3\n{along_y}, 3, 3",
        f"*DSLOAD\ncortical_surface, P, {pressure}",
        f"*NODE PRINT, NSET={abaqus.ALL_NODES}\nU",
        "*EL PRINT, ELSET=core\nS",
        "*END STEP",
    ]
    (tmp_path / "job.inp").write_text("\n".join(job) + "\n")
    done = subprocess.run(["ccx", "job"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout
    (moved,), (stress,) = (list(tables(tmp_path / "job.dat", columns)) for columns in (4, 8))
    assert len(moved) == len(balls.points) and len(stress) == len(balls.sets.cells["core"])
    radius = np.linalg.norm(balls.points, axis=1)
    outward = np.einsum("ij,ij->i", moved[:, 1:], balls.points) / np.maximum(radius, 1e-9)
    at_outside, at_interface, in_core = lame(core, shell, pressure)
    outside, interface = (balls.sets.nodes[name] for name in ("cortical_surface", "white_interface"))
    assert outward[outside].mean() == pytest.approx(at_outside, rel=0.02)
    assert outward[interface].mean() == pytest.approx(at_interface, rel=0.03)
    volumes = signed_volumes(balls.points, balls.cells[balls.sets.cells["core"]])
    assert np.average(stress[:, 2:5].mean(axis=1), weights=volumes) == pytest.approx(in_core, rel=0.03)


def test_meshio_sees_the_regions_and_surfaces_of_a_gmsh_file_by_name(balls: TetMesh, tmp_path: Path) -> None:
    msh.write(balls, tmp_path / "balls.msh")
    read = meshio.read(tmp_path / "balls.msh")
    tags = {name: int(number) for name, (number, _) in read.field_data.items()}
    cells, faces = (np.concatenate(read.cell_data_dict["gmsh:physical"][kind][None]) for kind in ("tetra", "triangle"))
    for name in ("cortex", "white"):
        assert (cells == tags[name]).sum() == len(balls.sets.cells[name])
    for name in ("cortical_surface", "white_interface"):
        assert (faces == tags[name]).sum() == len(balls.sets.faces[name])


def test_meshio_sees_the_tags_that_dolfinx_reads(balls: TetMesh, tmp_path: Path) -> None:
    fenics.write(balls, tmp_path / "balls.xdmf")
    cells = meshio.read(tmp_path / "balls.xdmf")
    region = cells.cell_data["region"][0]
    assert (region == 1).sum() == len(balls.sets.cells["cortex"])
    assert (region == 2).sum() == len(balls.sets.cells["white"])
    facets = meshio.read(tmp_path / "balls_facets.xdmf")
    tag = facets.cell_data["surface"][0]
    assert (tag == 101).sum() == len(balls.sets.faces["cortical_surface"])
    between = facets.cells_dict["triangle"][tag == 112]
    assert set(map(tuple, np.sort(between, axis=1))) == set(
        map(tuple, np.sort(balls.sets.faces["white_interface"], axis=1))
    )
