"""XDMF files that meshio wrote are read with their fields; what leads elsewhere or holds no tetrahedra is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
from cubes import cube_mesh

import cortet
from cortet.cli import main
from cortet.errors import InputError
from cortet.formats import fenics, read_mesh, vtu
from cortet.geometry.topology import boundary_surface

CUBE = cube_mesh(2)
FIELDS = {"depth": np.arange(27.0), "normal": np.arange(81.0).reshape(27, 3)}
REGION = (np.arange(48) % 2 + 1).astype(np.int32)


def written(path: Path, *more: tuple[str, Any], **how: Any) -> Path:
    """The file of the tetrahedra of a cube and further cells, each with a number."""
    blocks = [*more, ("tetra", CUBE.cells)] if how.pop("tetrahedra", True) else [*more]
    numbers = [np.zeros(len(cells), np.int32) for _, cells in more]
    mesh = meshio.Mesh(CUBE.points, blocks, FIELDS, {"region": [*numbers, REGION][: len(blocks)]})
    meshio.xdmf.write(path, mesh, **how)
    return path


@pytest.mark.parametrize("how", [{}, {"compression": None}, {"data_format": "XML"}])
def test_a_mesh_of_meshio_is_read_with_its_fields(tmp_path: Path, how: dict[str, Any]) -> None:
    mesh = read_mesh(written(tmp_path / "x.xdmf", **how))
    assert np.array_equal(mesh.points, CUBE.points) and np.array_equal(mesh.cells, CUBE.cells)
    assert mesh.point_data.keys() == FIELDS.keys()
    assert all(np.array_equal(mesh.point_data[name], values) for name, values in FIELDS.items())
    assert np.array_equal(mesh.cell_data["region"], REGION)


def test_triangles_of_the_boundary_are_left_out(tmp_path: Path) -> None:
    triangles, lines = np.array([[0, 1, 4]]), np.array([[0, 1]])
    mesh = fenics.read(written(tmp_path / "x.xdmf", ("triangle", triangles), ("line", lines)))
    assert np.array_equal(mesh.cells, CUBE.cells) and np.array_equal(mesh.cell_data["region"], REGION)


def test_commands_and_calls_take_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "x.xdmf")
    assert main(["quality", str(path)]) == 0
    assert "tetrahedra        48" in capsys.readouterr().out
    surface = boundary_surface(CUBE)[0]
    assert len(cortet.read(path, surface).mesh.cells) == 48
    assert main(["convert", str(path), str(tmp_path / "x.vtu"), "--source-unit", "mm"]) == 0
    converted = vtu.read(tmp_path / "x.vtu")  # in another order of its nodes
    assert np.array_equal(np.sort(converted.point_data["depth"]), FIELDS["depth"])


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        fenics.read(path)
    assert caught.value.remedy
    return str(caught.value)


def test_a_mesh_without_tetrahedra_is_refused(tmp_path: Path) -> None:
    triangles = written(tmp_path / "x.xdmf", ("triangle", np.array([[0, 1, 4]])), tetrahedra=False)
    assert "holds no tetrahedra, but triangle" in refused(triangles)
    hexahedra = written(tmp_path / "y.xdmf", ("hexahedron", np.arange(8)[None]))
    assert "holds cells of type hexahedron, not only tetrahedra" in refused(hexahedra)


def test_a_file_without_its_data_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "x.xdmf")
    (tmp_path / "x.h5").unlink()
    said = refused(path)
    assert "lacks its data file x.h5" in said and "put x.h5 beside it" in said


def test_a_series_of_times_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # meshio puts the data there
    with meshio.xdmf.TimeSeriesWriter("x.xdmf") as series:
        series.write_points_cells(CUBE.points, [("tetra", CUBE.cells)])
        series.write_data(0.0, point_data={"depth": FIELDS["depth"]})
    assert "is no XDMF file that meshio reads" in refused(tmp_path / "x.xdmf")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("x.h5:", "../x.h5:", "not one beside it"),
        ("x.h5:", "/etc/x.h5:", "not one beside it"),
        ('Format="HDF"', 'Format="Binary"', "from Binary"),
        ('Format="HDF"', 'Format="HDF" Reference="XML"', "from another array"),
        ("data0", "data7", "has no dataset"),
        ('GeometryType="XYZ"', 'GeometryType="', "not well-formed"),
        ("Topology", "Typology", "meshio reads"),
    ],
)
def test_what_leads_elsewhere_or_is_damaged_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = written(tmp_path / "x.xdmf")
    path.write_text(re.sub(re.escape(old), new, path.read_text()))
    assert message in refused(path)


def test_data_of_another_hdf5_file_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "x.xdmf")
    written(tmp_path / "other.xdmf")
    with h5py.File(tmp_path / "x.h5", "r+") as data:
        del data["data0"]
        data["data0"] = h5py.ExternalLink("other.h5", "data0")
    assert "has no dataset" in refused(path)


def test_more_than_the_file_holds_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "x.xdmf")
    with h5py.File(tmp_path / "x.h5", "r+") as data:
        del data["data0"]
        data.create_dataset("data0", shape=(10**9, 3), dtype=float, chunks=(10**4, 3), compression="gzip")
    assert "which the file does not hold" in refused(path)


def test_linked_files_are_those_beside_the_link(tmp_path: Path) -> None:
    """DataLad keeps the content of each file in a store; a file of the same name there is another one."""
    store, dataset = tmp_path / "store", tmp_path / "dataset"
    store.mkdir(), dataset.mkdir()
    made = written(tmp_path / "x.xdmf")
    for name, kept in {"x.xdmf": "A", "x.h5": "B"}.items():
        made.with_name(name).rename(store / kept)
        (dataset / name).symlink_to(Path("../store") / kept)
    (store / "x.h5").write_bytes(b"another file")
    assert np.array_equal(read_mesh(dataset / "x.xdmf").points, CUBE.points)
