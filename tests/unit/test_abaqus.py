"""The Abaqus file: as the manual says, read back with everything in it, and right in the eyes of CalculiX."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import InputError
from cortet.formats import abaqus
from cortet.geometry.topology import boundary_faces
from cortet.mesh import MeshSets, TetMesh
from cortet.solver_files.verify import verify
from cortet.stages.solver_ready import surface_nodes_first

TETRAHEDRON = TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 1, 2, 3]])


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


def test_a_single_tetrahedron_as_the_manual_says(tmp_path):
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


def test_no_number_is_longer_than_calculix_reads(tmp_path):
    mesh = cube_mesh(2, side=np.pi * 1e-5, jitter=0.2)
    abaqus.write(replace(mesh, points=mesh.points - 1e-6), tmp_path / "m.inp")
    assert max(map(len, re.findall(r"[-.e\d]+", (tmp_path / "m.inp").read_text()))) <= 20


def test_fields_go_into_a_file_of_initial_conditions(tmp_path):
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
    back = abaqus.read(tmp_path / "m.inp").point_data
    assert back.keys() == fields.keys()
    for name, values in fields.items():
        assert back[name].dtype == values.dtype and np.array_equal(back[name], values)


def test_node_and_element_numbers_may_be_any(tmp_path):
    abaqus.write(TETRAHEDRON, tmp_path / "m.inp")
    text = (tmp_path / "m.inp").read_text()
    renumbered = re.sub(r"^4, ", "40, ", text, flags=re.M).replace("1, 1, 2, 3, 4", "9, 1, 2, 3, 40")
    renumbered = renumbered.replace("1, 2, 3, 4\n", "1, 2, 3, 40\n").replace("1, S", "9, S")
    (tmp_path / "m.inp").write_text("** a comment\n" + renumbered)
    back = abaqus.read(tmp_path / "m.inp")
    assert back.cells.tolist() == [[0, 1, 2, 3]] and len(back.sets.faces["cortical_surface"]) == 4
    assert verify(tmp_path / "m.inp", "abaqus") == []


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("TYPE=C3D4", "TYPE=C3D10", "line 8: elements of type C3D10, not C3D4"),
        ("1, 1, 2, 3, 4\n", "1, 1, 2, 3\n", "line 9 has 4 fields instead of 5"),
        ("2, 1, 0, 0", "2, 1, zero, 0", "line 5 holds 'zero'"),
        ("1, 1, 2, 3, 4\n", "1, 1, 2, 3, 44\n", "node 44 is named but not defined"),
        ("1, S4", "1, S5", "not S1 to S4"),
        ("1, S4", "2, S4", "element 2 is named but not defined"),
        ("*ELEMENT", "*RIGID", "no nodes or no elements"),
    ],
)
def test_other_content_is_refused_with_its_place(tmp_path, old, new, words):
    path = tmp_path / "m.inp"
    abaqus.write(TETRAHEDRON, path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        abaqus.read(path)
    assert words in verify(path, "abaqus")[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("NSET=cortical_surface", "NSET=1st", "'1st' has a name that Abaqus does not take"),
        ("*SURFACE", "*NSET, NSET=Cortical_Surface\n1, 2, 3, 4\n*SURFACE", "two sets are named cortical_surface"),
    ],
)
def test_names_that_abaqus_does_not_take_are_told(tmp_path, old, new, words):
    path = tmp_path / "m.inp"
    abaqus.write(TETRAHEDRON, path)
    path.write_text(path.read_text().replace(old, new))
    assert words in " ".join(verify(path, "abaqus"))


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX (calculix-ccx) is not installed")
def test_calculix_finds_the_displacements_of_a_cube_of_known_stiffness(tmp_path):
    """Uniaxial tension: u = pL/E along the load, -nu p L/E across it, exact for linear tetrahedra."""
    side, stiffness, ratio, pressure = 2.0, 250.0, 0.3, -5.0
    mesh = cube_with_sides(3, side)
    abaqus.write(mesh, tmp_path / "cube.inp")
    job = [
        "*INCLUDE, INPUT=cube.inp",
        f"*MATERIAL, NAME=rubber\n*ELASTIC\n{stiffness}, {ratio}",
        f"*SOLID SECTION, ELSET={abaqus.ALL_ELEMENTS}, MATERIAL=rubber",
        "*STEP\n*STATIC",
        "*BOUNDARY\nx0, 1, 1\ny0, 2, 2\nz0, 3, 3",
        f"*DSLOAD\nx1, P, {pressure}",
        f"*NODE PRINT, NSET={abaqus.ALL_NODES}\nU",
        "*END STEP",
    ]
    (tmp_path / "job.inp").write_text("\n".join(job) + "\n")
    done = subprocess.run(["ccx", "job"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "*ERROR" not in done.stdout, done.stdout
    rows = [line.split() for line in (tmp_path / "job.dat").read_text().splitlines()]
    table = np.array([row for row in rows if len(row) == 4 and row[0].isdecimal()], float)
    assert np.array_equal(table[:, 0], np.arange(1, len(mesh.points) + 1))
    strain = -pressure / stiffness
    assert np.allclose(table[:, 1:], mesh.points * [strain, -ratio * strain, -ratio * strain], atol=1e-6 * side)


def test_calculix_is_told_of_an_inverted_element_by_verify_first(tmp_path):
    mesh = cube_with_sides()
    cells = mesh.cells.copy()
    cells[7, :2] = cells[7, 1::-1]
    abaqus.write(replace(mesh, cells=cells), tmp_path / "cube.inp")
    assert any(
        "1 of 162 tetrahedra have no positive volume, the first is number 8" in problem
        for problem in verify(tmp_path / "cube.inp", "abaqus")
    )


def test_paths_without_a_file_are_refused_by_name(tmp_path: Path):
    with pytest.raises(InputError, match=r"absent\.inp.*No such file"):
        abaqus.read(tmp_path / "absent.inp")
