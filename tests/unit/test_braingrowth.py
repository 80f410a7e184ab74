"""The file of the BrainGrowth solver, and its own meshes."""

from pathlib import Path

import pytest
from cubes import cube_mesh

from cortet.errors import InputError
from cortet.formats import braingrowth
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh

TALLINEN = Path(__file__).parents[3] / "shared" / "data" / "tallinen"


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


def test_a_mesh_that_is_not_solver_ready_is_not_written(tmp_path):
    with pytest.raises(InputError, match="solver_ready"):
        braingrowth.write(cube_mesh(3), tmp_path / "m.mesh")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["sphere5.mesh", "brain_simp_red.mesh"])
def test_the_solvers_own_meshes_are_read(name):
    if not (TALLINEN / name).exists():
        pytest.skip("../shared/data/tallinen is not here")
    mesh = braingrowth.read(TALLINEN / name)
    assert signed_volumes(mesh.points, mesh.cells).min() > 0


def test_what_is_no_mesh_of_braingrowth_is_refused(tmp_path):
    for text in ("", "4\n0 0 0\n", "x\n", "1\n0 0 0\n1\n1 1 2 3 4\n"):
        (tmp_path / "m.mesh").write_text(text)
        with pytest.raises(InputError, match=r"m\.mesh"):
            braingrowth.read(tmp_path / "m.mesh")
