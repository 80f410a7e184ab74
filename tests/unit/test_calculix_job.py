"""`cortet job`: CalculiX grows the cortex as theory says, and as our own solver does."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cubes import cube_mesh
from fold_solver import INNER, OUTER, ball, by_calculix, by_cortet, exact, outward, surfaces
from shapes import ball_surface

import cortet
from cortet.cli import main
from cortet.errors import InputError
from cortet.folding.body import Material
from cortet.folding.calculix import write_job
from cortet.folding.growing_cortex import parts
from cortet.formats import vtu
from cortet.formats.gifti import write_surface
from cortet.geometry.quadratic import quadratic
from cortet.meshes import MeshSets, TriSurface
from cortet.solver_files.sets import named_sets
from cortet.stages.generate import generate


def test_a_shell_that_cannot_be_compressed_grows_outward_by_its_volume() -> None:
    """Growth g along the shell adds 2 g of its volume, all of it outside of a core that does not give way."""
    outside, interface = exact(0.01, Material(bulk=1e7))
    assert outside == pytest.approx(2 * 0.01 * (OUTER**3 - INNER**3) / (3 * OUTER**2), rel=1e-5)
    assert interface == pytest.approx(0, abs=1e-6)


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")
def test_a_ball_whose_shell_grows_moves_as_it_should() -> None:
    mesh, growth = ball(2.5), 0.02
    outside, interface = exact(growth, Material())
    implicit, ours = (outward(mesh, solve(mesh, growth)) for solve in (by_calculix, by_cortet))
    assert implicit == (pytest.approx(outside, rel=0.01), pytest.approx(interface, rel=0.15))
    # our pressure is a mean over the elements around a node: what grows is smeared over the interface, by one element
    assert ours[0] == pytest.approx(outside, rel=0.02)
    assert ours[1] == pytest.approx(interface, rel=0.7)


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")
def test_elements_of_ten_nodes_converge_to_theory() -> None:
    """What is left of the error is that of the directions of growth, of which each element has one: it falls as h^2."""
    growth = 0.02
    outside, interface = exact(growth, Material())
    errors = []
    for cell_size in (4.5, 3.0):
        mesh = ball(cell_size)
        curved = quadratic(mesh, surfaces(), max_boundary_distance=0.1)
        errors.append(outward(mesh, by_calculix(mesh, growth, curved)) - np.array([outside, interface]))
    assert errors[1] == pytest.approx(0, abs=0.003)
    assert (np.abs(errors[1]) < 0.65 * np.abs(errors[0])).all()


def test_the_command_writes_a_job_of_ten_nodes(tmp_path: Path) -> None:
    ball_surface = TriSurface(*(getattr(surfaces(), name) for name in ("points", "faces")))
    write_surface(ball_surface, tmp_path / "ball.surf.gii")
    mesh = named_sets(generate(ball_surface, cell_size=4.0)[0], cortex_depth=3.0)
    vtu.write(mesh, tmp_path / "ball.vtu")
    command = ["job", str(tmp_path / "ball.vtu"), "--ten-nodes", str(tmp_path / "ball.surf.gii")]
    assert main([*command, "-o", str(tmp_path / "job")]) == 0
    assert "*ELEMENT, TYPE=C3D10" in (tmp_path / "job/mesh.inp").read_text()
    assert main([*command, "--solver", "febio", "-o", str(tmp_path / "other")]) == 2


def of_layers(radii: list[float], moduli: list[tuple[float, float]], grows: int, growth: float) -> np.ndarray:
    """Displacements outward at the outside of each layer of a ball, mm: as `fold_solver.exact`, for any layers.

    Each layer, from the middle outward, has u = B r + C / r^2, that which grows c r ln r beside it; neighbours share
    displacement and radial stress, and the outside is free.
    """
    count = len(radii)
    matrix, given = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    stiff = [bulk + 4 / 3 * shear for shear, bulk in moduli]
    first = [bulk - 2 / 3 * shear for shear, bulk in moduli]
    c = [-4 * moduli[i][0] * growth / (3 * stiff[i]) if i == grows else 0.0 for i in range(count)]

    def moved(i: int, r: float) -> np.ndarray:
        return np.array([r, 1 / r**2, c[i] * r * np.log(r)])

    def pressed(i: int, r: float) -> np.ndarray:
        free = 2 * first[i] * growth if i == grows else 0.0
        slope = np.array([1, -2 / r**3, c[i] * (np.log(r) + 1)])
        return stiff[i] * slope + 2 * first[i] * moved(i, r) / r - [0, 0, free]

    matrix[0, 1] = 1.0  # nothing is infinite in the middle
    for i in range(count - 1):
        for row, of in ((2 * i + 1, moved), (2 * i + 2, pressed)):
            below, above = of(i, radii[i]), of(i + 1, radii[i])
            matrix[row, 2 * i : 2 * i + 2], matrix[row, 2 * i + 2 : 2 * i + 4] = below[:2], -above[:2]
            given[row] = above[2] - below[2]
    matrix[-1, -2:], given[-1] = pressed(count - 1, radii[-1])[:2], -pressed(count - 1, radii[-1])[2]
    found = np.linalg.solve(matrix, given).reshape(count, 2)
    return np.array([moved(i, radii[i]) @ [*found[i], 1] for i in range(count)])


def test_two_layers_are_those_of_the_benchmark() -> None:
    material = Material()
    both = of_layers([INNER, OUTER], [(material.mu_cortex, material.bulk)] * 2, 1, 0.02)
    assert both[::-1] == pytest.approx(exact(0.02, material), rel=1e-9)


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")
def test_four_tissues_have_a_material_each(tmp_path: Path) -> None:
    """A soft ventricle in white matter, a cortex that grows, and fluid around it in a shell: beside the exact ball."""
    radii, growth = [5.0, 9.0, 12.0], 0.02
    inner, middle, outer = (ball_surface(4, radius) for radius in radii)
    made = cortet.mesh(outer, 1.5, inner={"white": middle, "ventricle": inner}, shell=3.0, progress=False)
    mesh = vtu.read(made.save(tmp_path / "head.vtu"))
    command = ["job", str(tmp_path / "head.vtu"), "--growth", str(growth), "-o", str(tmp_path / "job")]
    assert main(command) == 1, "csf has no material"
    assert main([*command, "--material", "csf=0.05,0.5", "--material", "ventricle=0.2,1.0"]) == 0
    subprocess.run(["ccx", "job"], cwd=tmp_path / "job", capture_output=True, check=True)
    rows = [line.split() for line in (tmp_path / "job/job.dat").read_text().splitlines()]
    moved = np.array([row[1:] for row in rows if len(row) == 4 and row[0].isdecimal()][-len(mesh.points) :], float)
    length = np.linalg.norm(mesh.points, axis=1)
    out = np.einsum("nc,nc->n", moved, mesh.points) / np.maximum(length, 1e-9)
    shell = length[mesh.sets.nodes["outer_surface"]].mean()
    moduli = [(0.2, 1.0), (Material().mu_core, 5.0), (1.0, 5.0), (0.05, 0.5)]
    expected = of_layers([*radii, float(shell)], moduli, 2, growth)
    names = ("ventricle_interface", "white_interface", "cortex_interface", "outer_surface")
    found = np.array([out[mesh.sets.nodes[name]].mean() for name in names])
    assert found == pytest.approx(expected, abs=0.05 * np.abs(expected).max())
    job = (tmp_path / "job/job.inp").read_text()
    assert job.count("*MATERIAL") == 4 == job.count("*SOLID SECTION")


def test_materials_of_no_set_and_for_febio_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vtu.write(named_sets(cube_mesh(3, side=6.0), cortex_depth=1.0), tmp_path / "cube.vtu")
    command = ["job", str(tmp_path / "cube.vtu"), "-o", str(tmp_path / "job")]
    assert main([*command, "--material", "tumour=2"]) == 1
    assert "no set of tetrahedra tumour (name one of" in capsys.readouterr().err
    assert main([*command, "--solver", "febio", "--material", "core=2"]) == 2
    assert main([*command, "--solver", "fenics", "--material", "core=2,7"]) == 0
    moduli = np.load(tmp_path / "job/moduli.npy")
    assert sorted(set(map(tuple, moduli.tolist()))) == [(1.0, 5.0), (2.0, 7.0)]
    with pytest.raises(SystemExit):
        main([*command, "--material", "core=-1"])


def test_a_material_that_no_tetrahedron_would_have_is_refused() -> None:
    """One set lies in another that comes later, or in the cortex."""
    cube = named_sets(cube_mesh(3, side=6.0), cortex_depth=1.0)
    some = cube.sets.cells["core"][:5]
    cells = {**cube.sets.cells, "deep": some, "whole": cube.sets.cells["core"]}
    mesh = replace(cube, sets=replace(cube.sets, cells=cells))
    found = {one.name: len(one.cells) for one in parts(mesh, {"whole": (2, None), "deep": (3, None)}, Material())}
    assert found["deep"] == 5 and "core" not in found
    with pytest.raises(InputError, match="no tetrahedron gets the material of deep: all are in whole, too"):
        parts(mesh, {"deep": (3, None), "whole": (2, None)}, Material())


def test_the_folder_has_axes_for_each_cortical_element_and_says_what_it_is(tmp_path: Path) -> None:
    mesh = named_sets(cube_mesh(3, side=6.0), cortex_depth=1.0)
    vtu.write(mesh, tmp_path / "cube.vtu")
    assert main(["job", str(tmp_path / "cube.vtu"), "-o", str(tmp_path / "job"), "--growth", "0.03"]) == 0
    lines = (tmp_path / "job/job.inp").read_text().splitlines()
    begin, end = lines.index(",1,0,0,0,1,0") + 1, lines.index("*ORIENTATION, NAME=cortical, SYSTEM=RECTANGULAR")
    axes = np.array([line.split(",") for line in lines[begin:end]], float)
    assert axes[:, 0].tolist() == (mesh.sets.cells["cortex"] + 1).tolist()
    first, second = axes[:, 1:4], axes[:, 4:]
    assert np.einsum("kc,kc->k", first, second) == pytest.approx(0, abs=1e-8)
    assert np.linalg.norm(first, axis=1) == pytest.approx(1) == np.linalg.norm(second, axis=1)
    assert "0.03,0.03,0." in lines
    assert "grows by 3 %" in (tmp_path / "job/README.txt").read_text()


def test_the_nodes_of_the_medial_wall_keep_their_plane(tmp_path: Path) -> None:
    mesh = named_sets(cube_mesh(3, side=6.0), cortex_depth=1.0)
    wall = np.flatnonzero(mesh.points[:, 0] == 0).astype(np.int32)
    sets = MeshSets({**mesh.sets.nodes, "medial_wall": wall}, mesh.sets.faces, mesh.sets.cells)
    write_job(replace(mesh, sets=sets), tmp_path, growth=0.05)
    assert "*BOUNDARY\nmedial_wall,1,1\n" in (tmp_path / "job.inp").read_text()


@pytest.mark.parametrize("growth", [0.0, -0.1, 0.5])
def test_growth_that_the_material_does_not_hold_for_is_refused(growth: float, tmp_path: Path) -> None:
    mesh = named_sets(cube_mesh(3, side=6.0), cortex_depth=1.0)
    with pytest.raises(InputError, match=r"small strains.*0.01 to 0.1"):
        write_job(mesh, tmp_path / "job", growth=growth)
    assert not (tmp_path / "job").exists()


def test_a_mesh_without_cortex_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no set `cortex`"):
        write_job(cube_mesh(2), tmp_path, growth=0.05)
