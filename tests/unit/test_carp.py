"""CARP files: 0-based, tagged, in the unit asked for."""

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import InputError
from cortet.formats import carp
from cortet.meshes import TetMesh


def test_the_files_look_as_the_manual_says(tmp_path):
    mesh = TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.5]], [[0, 1, 2, 3]], cell_data={"region": np.array([7])})
    carp.write(mesh, tmp_path / "m", unit="um")
    assert (tmp_path / "m.pts").read_text() == "4\n0 0 0\n1000 0 0\n0 1000 0\n0 0 500\n"
    assert (tmp_path / "m.elem").read_text() == "1\nTt 0 1 2 3 7\n"
    assert (tmp_path / "m.lon").read_text() == "1\n1 0 0\n"


def test_millimetres_come_back_bit_for_bit(tmp_path):
    cube = cube_mesh(3, side=np.pi, jitter=0.2)
    region = np.arange(len(cube.cells), dtype=np.int32)
    mesh = TetMesh(cube.points, cube.cells, cell_data={"region": region})
    carp.write(mesh, tmp_path / "hemi-L_res-0.6mm.pts", unit="mm")
    back = carp.read(tmp_path / "hemi-L_res-0.6mm", unit="mm")
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cells, mesh.cells)
    assert np.array_equal(back.cell_data["region"], region)
    assert np.array_equal(np.linalg.norm(back.cell_data["fibre"], axis=1), np.ones(len(region)))


def test_micrometres_are_scaled_back(tmp_path):
    mesh = cube_mesh(2, side=20.0)
    carp.write(mesh, tmp_path / "m", unit="um")
    assert np.allclose(carp.read(tmp_path / "m", unit="um").points, mesh.points, rtol=1e-15)
    assert carp.read(tmp_path / "m", unit="mm").points.max() == 20_000


@pytest.mark.parametrize("suffix", [".pts", ".elem", ".lon"])
def test_a_truncated_file_is_refused_by_name(tmp_path, suffix):
    carp.write(cube_mesh(2), tmp_path / "m")
    lines = (tmp_path / f"m{suffix}").read_text().splitlines(keepends=True)
    (tmp_path / f"m{suffix}").write_text("".join(lines[:-1]))
    with pytest.raises(InputError, match=str(len(lines) - 2)):
        carp.read(tmp_path / "m")


@pytest.mark.parametrize(
    ("suffix", "text", "words"),
    [
        (".elem", "1\nHx 0 1 2 3 4 5 6 7 1\n", "Hx"),
        (".elem", "1\nTt 0 1 2 99 1\n", "99"),
        (".pts", "twenty\n", "twenty"),
        (".pts", "1\n0 0\n", "2 numbers"),
    ],
)
def test_other_content_is_refused_by_name(tmp_path, suffix, text, words):
    carp.write(cube_mesh(2), tmp_path / "m")
    (tmp_path / f"m{suffix}").write_text(text)
    with pytest.raises(InputError, match=words):
        carp.read(tmp_path / "m")


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"absent\.pts.*No such file"):
        carp.read(tmp_path / "absent")
