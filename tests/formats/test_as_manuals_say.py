"""Files as the manuals of their programs say, numbers that come back bit for bit, and CalculiX on what was written."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_surface

from cortet.errors import InputError
from cortet.formats import abaqus, braingrowth, carp, febio, vtu
from cortet.geometry.nesting import nested
from cortet.geometry.topology import boundary_faces
from cortet.measure.quality import signed_volumes
from cortet.meshes import MeshSets, TetMesh
from cortet.solver_files.sets import named_sets
from cortet.stages.generate import generate
from cortet.stages.solver_ready import surface_nodes_first

TALLINEN = Path(__file__).parents[3] / "shared" / "data" / "tallinen"
TETRAHEDRON = TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 1, 2, 3]])
INNER, OUTER = 10.0, 14.0
CALCULIX = pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")


def test_a_tetrahedron_for_abaqus(tmp_path: Path) -> None:
    abaqus.write(TETRAHEDRON, tmp_path / "m.inp")
    assert (tmp_path / "m.inp").read_text().splitlines() == [
        "*HEADING",
        "Tetrahedral mesh, coordinates in mm",
        "*NODE, NSET=all_nodes",
        "1, 0, 0, 0",
        "2, 1, 0, 0",
        "3, 0, 1, 0",
        "4, 0, 0, 0.333333333333",
        "*ELEMENT, TYPE=C3D4, ELSET=all_elements",
        "1, 1, 2, 3, 4",
        "*NSET, NSET=cortical_surface",
        "1, 2, 3, 4",
        "*SURFACE, TYPE=ELEMENT, NAME=cortical_surface",
        "1, S3",
        "1, S4",
        "1, S2",
        "1, S1",
    ]
    assert not abaqus.fields_path(tmp_path / "m.inp").exists()


def test_fields_for_abaqus_are_initial_conditions_in_a_file_of_their_own(tmp_path: Path) -> None:
    fields = {"thickness": np.array([1, 2, 2.5, 3]), "label": np.array([1, 1, 7, 7], np.int32), "v": np.eye(4)[:, :3]}
    abaqus.write(replace(TETRAHEDRON, point_data=fields), tmp_path / "m.inp")
    lines = (tmp_path / "m_fields.inp").read_text().splitlines()
    assert lines[:6] == [
        "** variable 1: thickness, component 1 of 1, real",
        "*INITIAL CONDITIONS, TYPE=FIELD, VARIABLE=1",
        "1, 1",
        "2, 2",
        "3, 2.5",
        "4, 3",
    ]
    assert "** variable 5: v, component 3 of 3, real" in lines


def test_no_number_for_calculix_is_longer_than_it_reads(tmp_path: Path) -> None:
    mesh = cube_mesh(2, side=np.pi * 1e-5, jitter=0.2)
    abaqus.write(replace(mesh, points=mesh.points - 1e-6), tmp_path / "m.inp")
    assert max(map(len, re.findall(r"[-.e\d]+", (tmp_path / "m.inp").read_text()))) <= 20


def test_a_tetrahedron_for_febio(tmp_path: Path) -> None:
    febio.write(replace(TETRAHEDRON, point_data={"age": np.array([1.5, 2, 3, 4])}), tmp_path / "m.feb")
    assert (tmp_path / "m.feb").read_text().splitlines() == [
        '<?xml version="1.0" encoding="ISO-8859-1"?>',
        '<febio_spec version="4.0">',
        '<Module type="solid"/>',
        "<Material>",
        '<material id="1" name="tissue" type="neo-Hookean"><density>1</density><E>2.8125</E><v>0.40625</v></material>',
        "</Material>",
        "<Mesh>",
        '<Nodes name="nodes">',
        '<node id="1">0,0,0</node>',
        '<node id="2">1,0,0</node>',
        '<node id="3">0,1,0</node>',
        '<node id="4">0,0,0.333333333333</node>',
        "</Nodes>",
        '<Elements type="tet4" name="tissue">',
        '<elem id="1">1,2,3,4</elem>',
        "</Elements>",
        '<Surface name="cortical_surface">',
        '<tri3 id="1">2,3,4</tri3>',
        '<tri3 id="2">1,4,3</tri3>',
        '<tri3 id="3">1,2,4</tri3>',
        '<tri3 id="4">1,3,2</tri3>',
        "</Surface>",
        '<NodeSet name="all_nodes">1,2,3,4</NodeSet>',
        '<NodeSet name="cortical_surface">1,2,3,4</NodeSet>',
        "</Mesh>",
        "<MeshDomains>",
        '<SolidDomain name="tissue" mat="tissue"/>',
        "</MeshDomains>",
        "<MeshData>",
        '<NodeData name="age" node_set="all_nodes" data_type="scalar">',
        '<node lid="1">1.5</node>',
        '<node lid="2">2</node>',
        '<node lid="3">3</node>',
        '<node lid="4">4</node>',
        "</NodeData>",
        "</MeshData>",
        "</febio_spec>",
    ]


def test_a_tetrahedron_for_opencarp_in_micrometres(tmp_path: Path) -> None:
    mesh = TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.5]], [[0, 1, 2, 3]], cell_data={"region": np.array([7])})
    carp.write(mesh, tmp_path / "m", unit="um")
    assert (tmp_path / "m.pts").read_text() == "4\n0 0 0\n1000 0 0\n0 1000 0\n0 0 500\n"
    assert (tmp_path / "m.elem").read_text() == "1\nTt 0 1 2 3 7\n"
    assert (tmp_path / "m.lon").read_text() == "1\n1 0 0\n"


def test_a_tetrahedron_for_braingrowth_and_none_that_it_could_not_run_on(tmp_path: Path) -> None:
    braingrowth.write(TETRAHEDRON, tmp_path / "m.mesh")
    assert (tmp_path / "m.mesh").read_text().splitlines() == [
        "4",
        "0.000000000 0.000000000 0.000000000",
        "1.000000000 0.000000000 0.000000000",
        "0.000000000 1.000000000 0.000000000",
        "0.000000000 0.000000000 0.333333333",
        "1",
        "1 1 2 4 3",
        "4",
        "101 2 3 4",
        "101 1 4 3",
        "101 1 2 4",
        "101 1 3 2",
    ]
    with pytest.raises(InputError, match="solver_ready"):
        braingrowth.write(cube_mesh(3), tmp_path / "other.mesh")
    assert [path.name for path in tmp_path.iterdir()] == ["m.mesh"]


@pytest.mark.parametrize("name", ["sphere5.mesh", "brain_simp_red.mesh"])
def test_braingrowths_own_meshes_are_read(name: str) -> None:
    if not (TALLINEN / name).exists():
        pytest.skip("../shared/data/tallinen is not here")
    mesh = braingrowth.read(TALLINEN / name)
    assert signed_volumes(mesh.points, mesh.cells).min() > 0


def test_what_is_no_mesh_of_braingrowth_or_opencarp_is_refused(tmp_path: Path) -> None:
    for text in ("", "4\n0 0 0\n", "x\n", "1\n0 0 0\n1\n1 1 2 3 4\n"):
        (tmp_path / "m.mesh").write_text(text)
        with pytest.raises(InputError, match=r"m\.mesh"):
            braingrowth.read(tmp_path / "m.mesh")
    for suffix, text, word in (
        (".elem", "1\nHx 0 1 2 3 4 5 6 7 1\n", "Hx"),
        (".elem", "1\nTt 0 1 2 99 1\n", "99"),
        (".pts", "twenty\n", "twenty"),
        (".pts", "1\n0 0\n", "2 numbers"),
        (".lon", "1\n1 0 0\n", "48 cells"),
    ):
        carp.write(cube_mesh(2), tmp_path / "m")
        (tmp_path / f"m{suffix}").write_text(text)
        with pytest.raises(InputError, match=word):
            carp.read(tmp_path / "m")


# --- numbers


def test_coordinates_of_opencarp_come_back_bit_for_bit_in_mm_and_scaled_in_um(tmp_path: Path) -> None:
    cube = cube_mesh(3, side=np.pi, jitter=0.2)
    region = np.arange(len(cube.cells), dtype=np.int32)
    mesh = TetMesh(cube.points, cube.cells, cell_data={"region": region})
    carp.write(mesh, tmp_path / "hemi-L_res-0.6mm.pts", unit="mm")
    back = carp.read(tmp_path / "hemi-L_res-0.6mm", unit="mm")
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cells, mesh.cells)
    assert np.array_equal(back.cell_data["region"], region)
    assert np.array_equal(np.linalg.norm(back.cell_data["fibre"], axis=1), np.ones(len(region)))
    carp.write(mesh, tmp_path / "m", unit="um")
    assert np.allclose(carp.read(tmp_path / "m", unit="um").points, mesh.points, rtol=1e-15)
    assert carp.read(tmp_path / "m", unit="mm").points.max() == pytest.approx(1000 * np.pi)


def test_every_array_of_a_vtu_file_comes_back_bit_for_bit(tmp_path: Path) -> None:
    cube, random = cube_mesh(3), np.random.default_rng(1)
    n, m = len(cube.points), len(cube.cells)
    of_nodes = {"thickness": random.normal(size=n), "label": random.integers(-5, 9, n, dtype=np.int32)}
    of_nodes["two words"] = np.eye(n, 3)
    of_cells = {"fibre": random.normal(size=(m, 3)), "region": np.arange(m, dtype=np.uint8)}
    mesh = TetMesh(cube.points + 1e-13 * random.normal(size=(n, 3)), cube.cells, of_nodes, of_cells)
    vtu.write(mesh, tmp_path / "mesh.vtu")
    back = vtu.read(tmp_path / "mesh.vtu")
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cells, mesh.cells)
    for before, after in [(mesh.point_data, back.point_data), (mesh.cell_data, back.cell_data)]:
        assert before.keys() == after.keys()
        for name, values in before.items():
            assert after[name].dtype == values.dtype and np.array_equal(after[name], values), name


# --- CalculiX


def solved(folder: Path, *lines: str) -> None:
    (folder / "job.inp").write_text("\n".join(lines) + "\n")
    done = subprocess.run(["ccx", "job"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout


def tables(path: Path, columns: int) -> Iterator[np.ndarray]:
    """The tables of a .dat file of CalculiX with so many numbers in a row."""
    rows: list[list[str]] = []
    for line in [*path.read_text().splitlines(), "end"]:
        words = line.split()
        if len(words) == columns and words[0].isdecimal():
            rows.append(words)
        elif rows and words:
            yield np.array(rows, float)
            rows = []


def cube_with_sides(n: int = 3, side: float = 2.0) -> TetMesh:
    """A cube [0, side]^3 whose sides at 0 and at the end of each axis are sets, e.g. `x0` and `x1`."""
    mesh, _ = surface_nodes_first(cube_mesh(n, side=side, jitter=0.2))
    faces = boundary_faces(mesh)
    nodes_of, faces_of = {}, {}
    for axis in range(3):
        for end in (0, 1):
            on_side = np.isclose(mesh.points[:, axis], end * side)
            nodes_of[f"{'xyz'[axis]}{end}"] = np.flatnonzero(on_side).astype(np.int32)
            faces_of[f"{'xyz'[axis]}{end}"] = faces[on_side[faces].all(axis=1)]
    return replace(mesh, sets=MeshSets(nodes_of, faces_of, {"all": np.arange(len(mesh.cells), dtype=np.int32)}))


@CALCULIX
def test_calculix_finds_the_displacements_of_a_cube_of_known_stiffness(tmp_path: Path) -> None:
    """Uniaxial tension: u = pL/E along the load, -nu p L/E across it, exact for linear tetrahedra."""
    side, stiffness, ratio, pressure = 2.0, 250.0, 0.3, -5.0
    mesh = cube_with_sides(3, side)
    abaqus.write(mesh, tmp_path / "cube.inp")
    solved(
        tmp_path,
        "*INCLUDE, INPUT=cube.inp",
        f"*MATERIAL, NAME=rubber\n*ELASTIC\n{stiffness}, {ratio}",
        f"*SOLID SECTION, ELSET={abaqus.ALL_ELEMENTS}, MATERIAL=rubber",
        "*STEP\n*STATIC",
        "*BOUNDARY\nx0, 1, 1\ny0, 2, 2\nz0, 3, 3",
        f"*DSLOAD\nx1, P, {pressure}",
        f"*NODE PRINT, NSET={abaqus.ALL_NODES}\nU",
        "*END STEP",
    )
    (table,) = tables(tmp_path / "job.dat", columns=4)
    assert np.array_equal(table[:, 0], np.arange(1, len(mesh.points) + 1))
    strain = -pressure / stiffness
    assert np.allclose(table[:, 1:], mesh.points * [strain, -ratio * strain, -ratio * strain], atol=1e-6 * side)


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


@CALCULIX
def test_calculix_finds_what_lame_found_for_a_soft_shell_around_a_stiff_ball(tmp_path: Path) -> None:
    pair = nested(ball_surface(4, OUTER), {"white": ball_surface(4, INNER)})
    balls = named_sets(surface_nodes_first(generate(pair, cell_size=1.6)[0])[0], inner=["white"])
    core, shell, pressure = (1000.0, 0.3), (250.0, 0.35), 10.0
    abaqus.write(balls, tmp_path / "balls.inp")
    # six displacements that hold the body without a force, as the pressure has none
    centre, along_x, along_y = (
        1 + int(np.linalg.norm(balls.points - place, axis=1).argmin()) for place in ([0, 0, 0], [8, 0, 0], [0, 8, 0])
    )
    solved(
        tmp_path,
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
    )
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
