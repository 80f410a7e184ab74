"""The Abaqus file: as the manual says, read back with everything in it, and right in the eyes of CalculiX."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.formats import abaqus
from cortet.geometry.topology import boundary_faces
from cortet.meshes import MeshSets, TetMesh
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
