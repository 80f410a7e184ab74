"""The file of the BrainGrowth solver, and the check of its five conventions on the written file."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import InputError
from cortet.formats import braingrowth
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh
from cortet.solver_files.verify import verify
from cortet.stages.solver_ready import surface_nodes_first

TALLINEN = Path(__file__).parents[3] / "shared" / "data" / "tallinen"


@pytest.fixture
def written(tmp_path) -> Path:
    path = tmp_path / "cube.mesh"
    braingrowth.write(surface_nodes_first(cube_mesh(3, side=2.0, jitter=0.2))[0], path)
    return path


def edit(path: Path, change) -> None:
    """Apply `change` to the three tables of a file (lists of lists of words) and write it back."""
    lines = path.read_text().splitlines()
    n = int(lines[0])
    m = int(lines[n + 1])
    rows = [line.split() for line in lines]
    file = SimpleNamespace(nodes=rows[1 : n + 1], cells=rows[n + 2 : n + m + 2], faces=rows[n + m + 3 :])
    change(file)
    tables = [[[str(len(table))], *table] for table in (file.nodes, file.cells, file.faces)]
    path.write_text("\n".join(" ".join(row) for table in tables for row in table) + "\n")


def test_a_single_tetrahedron_as_the_solver_wants_it(tmp_path):
    mesh = TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 1, 2, 3]])
    braingrowth.write(mesh, tmp_path / "m.mesh")
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


def test_what_is_written_verifies_and_reads_back(written):
    assert verify(written, "braingrowth") == []
    mesh, back = surface_nodes_first(cube_mesh(3, side=2.0, jitter=0.2))[0], braingrowth.read(written)
    assert np.array_equal(back.cells, mesh.cells) and np.allclose(back.points, mesh.points, atol=5e-10, rtol=0)
    assert signed_volumes(back.points, back.cells).min() > 0


def test_the_loader_of_the_solver_sees_negative_volumes(written):
    """BrainGrowth reads coordinates as (y, x, z) and tetrahedra as (a, b, d, c)."""
    points, tetrahedra, _ = braingrowth.read_tables(written)
    assert signed_volumes(points[:, [1, 0, 2]], tetrahedra[:, [1, 2, 4, 3]] - 1).max() < 0


def test_a_mesh_that_is_not_solver_ready_is_not_written(tmp_path):
    with pytest.raises(InputError, match="solver_ready"):
        braingrowth.write(cube_mesh(3), tmp_path / "m.mesh")
    assert not list(tmp_path.iterdir())


def swap_two_nodes_of_a_tetrahedron(file):
    file.cells[4][1], file.cells[4][2] = file.cells[4][2], file.cells[4][1]


def turn_a_face_inward(file):
    file.faces[7][1], file.faces[7][2] = file.faces[7][2], file.faces[7][1]


def put_an_interior_node_first(file):
    first, interior = "1", str(len(file.nodes))
    file.nodes[0], file.nodes[-1] = file.nodes[-1], file.nodes[0]
    for row in file.cells + file.faces:
        row[1:] = [{first: interior, interior: first}.get(node, node) for node in row[1:]]


def leave_out_a_face(file):
    file.faces.pop()


def list_a_face_twice(file):
    file.faces.append(file.faces[0])


def name_an_inner_face(file):
    inner = next(row for row in file.cells if len(file.nodes) in map(int, row[1:]))
    file.faces[3][1:] = inner[1:4]


def give_every_tetrahedron_a_positive_volume(file):
    for row in file.cells:
        row[3], row[4] = row[4], row[3]


def leave_out_the_tag(file):
    for row in file.cells:
        row.pop(0)


def count_nodes_from_zero(file):
    for row in file.cells:
        row[1:] = [str(int(node) - 1) for node in row[1:]]


@pytest.mark.parametrize(
    ("breakage", "words"),
    [
        (swap_two_nodes_of_a_tetrahedron, ["1 of 162 tetrahedra have no negative volume, the first on line 71"]),
        (turn_a_face_inward, ["1 triangles face inward, the first on line 237"]),
        (put_an_interior_node_first, ["the 56 surface nodes are not the first nodes: they reach up to node 64"]),
        (leave_out_a_face, ["1 boundary faces are missing from the triangles"]),
        (list_a_face_twice, ["1 triangles are listed more than once"]),
        (give_every_tetrahedron_a_positive_volume, ["162 of 162 tetrahedra have no negative volume"]),
        (leave_out_the_tag, ["line 67: a tetrahedron line has 4 fields instead of 5"]),
        (count_nodes_from_zero, ["node indices outside 1..64"]),
    ],
)
def test_each_broken_convention_is_named_and_no_other(written, breakage, words):
    edit(written, breakage)
    found = verify(written, "braingrowth")
    assert len(found) == len(words) and all(part in line for part, line in zip(words, found, strict=True)), found


def test_an_inner_face_is_no_boundary_face(written):
    edit(written, name_an_inner_face)
    found = " ".join(verify(written, "braingrowth"))
    assert (
        "1 boundary faces are missing" in found and "1 triangles are not boundary faces, the first on line 233" in found
    )


def test_every_truncation_is_refused(written):
    text = written.read_text()
    for share in np.linspace(0, 0.99, 12):
        written.write_text(text[: int(share * len(text))])
        assert verify(written, "braingrowth"), share


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"absent\.mesh.*No such file"):
        braingrowth.read(tmp_path / "absent.mesh")


@pytest.mark.parametrize("name", ["sphere5.mesh", "brain_simp_red.mesh"])
def test_the_solvers_own_meshes_verify(name):
    if not (TALLINEN / name).exists():
        pytest.skip("../shared/data/tallinen is not here")
    assert verify(TALLINEN / name, "braingrowth") == []
    mesh = braingrowth.read(TALLINEN / name)
    assert signed_volumes(mesh.points, mesh.cells).min() > 0
