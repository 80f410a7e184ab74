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
from cortet.meshes import MeshSets, TetMesh
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


def rewritten(path: Path, old: str, new: str) -> TetMesh:
    """What is read of a file of a cube of 3 x 3 x 3 cells when a part of it is written otherwise."""
    abaqus.write(cube_with_sides(), path)
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    return abaqus.read(path)


def test_a_comment_within_a_block_drops_nothing(tmp_path):
    whole = cube_with_sides()
    path = tmp_path / "m.inp"
    for line in ("100, ", "30, "):
        abaqus.write(whole, path)
        path.write_text(path.read_text().replace(f"\n{line}", f"\n** a comment, 1, 2\n{line}"))
        back = abaqus.read(path)
        assert np.array_equal(back.cells, whole.cells) and len(back.points) == len(whole.points)
    path.write_text(path.read_text().replace("\n100, ", "\n100, x"))
    number = path.read_text().splitlines().index(next(n for n in path.read_text().splitlines() if "100, x" in n)) + 1
    with pytest.raises(InputError, match=f"line {number} holds"):
        abaqus.read(path)


def test_ranges_are_first_last_and_increment(tmp_path):
    lines = (
        "*NSET, NSET=some, GENERATE\n1, 9, 4\n20, 22\n*ELSET, GENERATE, ELSET=cortex\n1, 100, 1\n*ELSET, ELSET=all\n"
    )
    sets = rewritten(tmp_path / "m.inp", "*ELSET, ELSET=all\n", lines).sets
    assert sets.nodes["some"].tolist() == [0, 4, 8, 19, 20, 21]
    assert np.array_equal(sets.cells["cortex"], np.arange(100))


@pytest.mark.parametrize("line", ["9, 1, 1", "1, 9, -1", "1, 9, 0", "1, 2000000000, 1", "1, 2, 3, 4", "1"])
def test_a_range_that_is_none_is_refused(tmp_path, line):
    with pytest.raises(InputError, match=r"line \d+: \*NSET cannot be read"):
        rewritten(tmp_path / "m.inp", "*ELSET, ELSET=all\n", f"*NSET, NSET=a, GENERATE\n{line}\n*ELSET, ELSET=all\n")


def test_a_further_block_of_a_set_adds_to_it(tmp_path):
    more = "*ELSET, ELSET=cortex\n1, 2\n*ELSET, ELSET=cortex\n2, 7\n*NSET, NSET=x0\n27\n*SURFACE, NAME=x0\n1, S1\n"
    before = cube_with_sides().sets
    sets = rewritten(tmp_path / "m.inp", "*ELSET, ELSET=all\n", f"{more}*ELSET, ELSET=all\n").sets
    assert sets.cells["cortex"].tolist() == [0, 1, 6]
    assert sets.nodes["x0"].tolist() == sorted({*before.nodes["x0"].tolist(), 26})
    assert len(sets.faces["x0"]) == len(before.faces["x0"]) + 1


def test_the_sets_that_node_and_element_blocks_name_are_read(tmp_path):
    head, line = "*ELEMENT, TYPE=C3D4, ELSET=", "\n101, "
    abaqus.write(cube_with_sides(), tmp_path / "m.inp")
    text = (tmp_path / "m.inp").read_text().replace(f"{head}all_elements", f"{head}core")
    before, mark, after = text.partition(f"{head}core")
    (tmp_path / "m.inp").write_text(
        before + mark + after.replace(line, f"\n*ELEMENT, TYPE=C3D4,\nELSET=cortex{line}", 1)
    )
    cells = abaqus.read(tmp_path / "m.inp").sets.cells
    assert np.array_equal(cells["core"], np.arange(100)) and np.array_equal(cells["cortex"], np.arange(100, 162))


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("*INCLUDE, INPUT=sets.inp", r"\*INCLUDE, which takes lines from another file, is not read"),
        ("*NFILL\nx0, x1, 3", r"\*NFILL, which makes nodes or elements of others"),
        ("*NODE, INPUT=more.inp", r"takes its lines from more.inp"),
        ("*NODE, SYSTEM=C\n900, 1, 2, 3", "coordinates are not rectangular"),
        ("*NSET, NSET=a, ELSET=all", "a set of the nodes of all is not read"),
        ("*SURFACE, TYPE=NODE, NAME=a\n1, 1", "of type NODE is not read"),
        ("*INSTANCE, NAME=a, PART=b\n1, 0, 0", "moves its part"),
    ],
)
def test_what_would_change_the_mesh_and_is_not_read_is_refused(tmp_path, lines, words):
    with pytest.raises(InputError, match=words):
        rewritten(tmp_path / "m.inp", "*ELSET, ELSET=all\n", f"{lines}\n*ELSET, ELSET=all\n")


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


#: a deck as Abaqus/CAE, HyperMesh and FreeCAD write it
DECK = """*Heading
** Generated by: a pre-processor
*Part, name="my part"
*Node
1, 0., 0., 0.D0
2, 1.D0, 0., 0.
3, 0., 1.0d+00, 0.
4, 0., 0., 1.
5, 1., 1., 1.
*Element, type=C3D4H, elset="white matter, left"
1, 1, 2, 3, 4
2, 2, 3, 4, 5
*Elset, elset=two
2,
*Elset, elset=Both
two, "white matter, left"
*Nset, nset=down, generate
3, 1, -1
*End Part
*Assembly, name=Assembly
*Instance, name=I-1, part="my part"
*End Instance
*Elset, elset=far, instance=I-1
 I-1.TWO,
*Surface, type=ELEMENT, name=outside
far, S3
1, S1
*End Assembly
"""


def test_a_deck_of_a_pre_processor_is_read(tmp_path: Path) -> None:
    (tmp_path / "m.inp").write_text(DECK)
    mesh = abaqus.read(tmp_path / "m.inp")
    assert mesh.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]
    assert mesh.cells.tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]]
    cells = {name: members.tolist() for name, members in mesh.sets.cells.items()}
    assert cells.pop("white_matter_left", cells.pop("white matter, left", None)) == [0, 1]
    assert cells == {"two": [1], "Both": [0, 1], "far": [1]}
    assert sorted(mesh.sets.nodes["down"].tolist()) == [0, 1, 2]
    assert [sorted(face) for face in mesh.sets.faces["outside"].tolist()] == [[2, 3, 4], [0, 1, 2]]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("*End Instance", "*End Instance\n*Instance, name=I-2, part=p\n*End Instance", "NAME=I-2 is the second"),
        ("*End Part", "*End Part\n*Part, name=p\n*End Part", r"\*PART, NAME=p is the second, and one mesh is read"),
        ("*End Instance", "*End Instance\n*Node\n1, 0, 0, 0", r"\*NODE in the assembly, beside the part, is not read"),
        ("type=C3D4H", "type=S3", "elements of type S3, not C3D4"),
        ("far, S3", "far, SPOS", "names no element or set, and a side S1 to S4"),
        ("far, S3", "farther, S3", "there is no set farther before it"),
    ],
)
def test_what_is_not_read_of_such_a_deck_is_refused_in_true_words(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    (tmp_path / "m.inp").write_text(DECK.replace(old, new))
    with pytest.raises(InputError, match=words) as refused:
        abaqus.read(tmp_path / "m.inp")
    assert "damaged" not in str(refused.value)
