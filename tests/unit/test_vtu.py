"""The interchange file loses nothing and never appears half-written."""

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import InputError
from cortet.formats import vtu
from cortet.meshes import TetMesh


def with_fields(mesh: TetMesh) -> TetMesh:
    random = np.random.default_rng(1)
    n, m = len(mesh.points), len(mesh.cells)
    return TetMesh(
        mesh.points + 1e-13 * random.normal(size=(n, 3)),
        mesh.cells,
        {
            "thickness": random.normal(size=n),
            "label": random.integers(-5, 9, n, dtype=np.int32),
            "two words": np.eye(n, 3),
        },
        {"fibre": random.normal(size=(m, 3)), "region": np.arange(m, dtype=np.uint8)},
    )


def test_every_array_comes_back_bit_for_bit(tmp_path):
    mesh = with_fields(cube_mesh(3))
    vtu.write(mesh, tmp_path / "mesh.vtu")
    back = vtu.read(tmp_path / "mesh.vtu")
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cells, mesh.cells)
    for before, after in [(mesh.point_data, back.point_data), (mesh.cell_data, back.cell_data)]:
        assert before.keys() == after.keys()
        for name, values in before.items():
            assert after[name].dtype == values.dtype and np.array_equal(after[name], values), name


def test_the_same_mesh_gives_the_same_bytes(tmp_path):
    for name in "ab":
        vtu.write(with_fields(cube_mesh(2)), tmp_path / f"{name}.vtu")
    assert (tmp_path / "a.vtu").read_bytes() == (tmp_path / "b.vtu").read_bytes()


def test_paraviews_own_reader_opens_it(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mesh = with_fields(cube_mesh(2))
    vtu.write(mesh, tmp_path / "mesh.vtu")
    grid = pyvista.read(tmp_path / "mesh.vtu")
    assert np.array_equal(grid.points, mesh.points) and np.array_equal(
        grid.cell_data["region"], mesh.cell_data["region"]
    )


def test_a_truncated_file_is_refused_by_name(tmp_path):
    whole = tmp_path / "whole.vtu"
    vtu.write(cube_mesh(2), whole)
    for share in (0.0, 0.3, 0.6, 0.9):
        part = tmp_path / "part.vtu"
        part.write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
        with pytest.raises(InputError, match=r"part\.vtu"):
            vtu.read(part)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"absent\.vtu.*No such file"):
        vtu.read(tmp_path / "absent.vtu")
