"""Results of solvers on the surface: what is read, matched and refused, and the file that comes out."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import meshio
import nibabel as nib
import numpy as np
import pytest
import pyvista
from numpy.typing import NDArray
from scipy.sparse import load_npz
from shapes import ball_surface

from cortet.cli import main
from cortet.formats import braingrowth, vtu
from cortet.formats.gifti import read_surface, write_fields, write_surface
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.common_sphere import Parcels
from cortet.solver_files.results import invariants

RADIUS = 14.0


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a surface and its mesh."""
    folder = tmp_path_factory.mktemp("made")
    write_surface(ball_surface(3, RADIUS), path := folder / "x.surf.gii")
    image = nib.load(path)
    image.meta["AnatomicalStructurePrimary"] = "CortexLeft"
    path.write_bytes(image.to_xml())
    command = ["mesh", str(path), "--ga", "28", "--cell-size", "3.5"]
    assert main([*command, "-o", str(folder / "x.vtu")]) == 0
    return folder


@pytest.fixture
def folder(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for file in source.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def mesh(folder: Path) -> TetMesh:
    return vtu.read(folder / "x.vtu")


def fields(mesh: TetMesh) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    """Fields of nodes, and of tetrahedra."""
    stress = np.zeros((len(mesh.cells), 9))
    stress[:, [0, 4, 8]] = [3.0, 1.0, -1.0]
    return {"u": mesh.points, "T": mesh.points[:, 2]}, {"S": stress, "e": np.ones(len(mesh.cells))}


def grid(points: NDArray[np.float64], cells: NDArray[np.integer]) -> pyvista.UnstructuredGrid:
    return pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, points)


def write(mesh: TetMesh, path: Path | str, *, order: NDArray[np.intp] | None = None, scale: float = 1.0) -> None:
    """A result with the nodes in an order and the tetrahedra in the reverse one."""
    of_nodes, of_cells = fields(mesh)
    order = np.arange(len(mesh.points)) if order is None else order
    made = grid(mesh.points[order] * scale, np.argsort(order)[mesh.cells][::-1])
    for name, values in of_nodes.items():
        made.point_data[name] = values[order]
    for name, values in of_cells.items():
        made.cell_data[name] = values[::-1]
    made.save(path)


def arrays(path: Path | str) -> dict[str, NDArray[np.float64]]:
    return {one.meta["Name"]: one.data for one in nib.load(path).darrays}


def project(*words: str) -> int:
    try:
        return main(["project", *words])
    except SystemExit as stop:
        return int(stop.code or 0)


def test_all_fields_come_back_by_their_names(folder: Path, mesh: TetMesh, capsys: pytest.CaptureFixture[str]) -> None:
    write(mesh, "r.vtu")
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    assert "642 of 642 vertices by their number" in capsys.readouterr().out
    assert all((folder / name).read_bytes() == content for name, content in before.items() if name[0] != ".")
    found, surface = arrays("r.func.gii"), nib.load("x.surf.gii").agg_data("pointset")
    assert all(values.shape == (642,) and values.dtype == np.float32 for values in found.values())
    assert np.abs(np.stack([found[f"u_{axis}"] for axis in (1, 2, 3)], axis=1) - surface).max() < 1.0
    assert np.array_equal(found["T"], found["u_3"]) and found["e"] == pytest.approx(1)
    invariant = {"principal_1": 3, "principal_2": 1, "principal_3": -1, "pressure": -1, "von_mises": np.sqrt(12)}
    assert all(found[f"S_{name}"] == pytest.approx(value) for name, value in invariant.items())
    assert dict(nib.load("r.func.gii").meta) == {"AnatomicalStructurePrimary": "CortexLeft"}
    assert not set(found) & {"cortical_surface", "core", "cortex"}


def test_another_order_and_unit_give_the_same(mesh: TetMesh, capsys: pytest.CaptureFixture[str]) -> None:
    write(mesh, "r.vtu")
    write(mesh, "other.vtu", order=np.random.default_rng(0).permutation(len(mesh.points)), scale=1e-3)
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    capsys.readouterr()
    assert project("other.vtu", "--mesh", "x.vtu", "-o", "other.func.gii") == 0
    said = capsys.readouterr().out
    assert "its coordinates are in m;" in said and "in another order" in said
    one, other = arrays("r.func.gii"), arrays("other.func.gii")
    assert one.keys() == other.keys()
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_depth_is_one_or_a_range(mesh: TetMesh, capsys: pytest.CaptureFixture[str]) -> None:
    write(mesh, "r.vtu")
    surface = nib.load("x.surf.gii").agg_data("pointset")
    for depth, middle in (("2", 2), ("1:5", 3)):
        assert project("r.vtu", "--mesh", "x.vtu", "--depth", depth, "-o", "r.func.gii") == 0
        assert np.abs(arrays("r.func.gii")["u_1"] - (1 - middle / RADIUS) * surface[:, 0]).max() < 0.25
    for depth in ("5:1", "1:2:3", "-1", "deep"):
        assert project("r.vtu", "--mesh", "x.vtu", "--depth", depth, "-o", "r.func.gii") == 2
    capsys.readouterr()
    assert project("r.vtu", "--mesh", "x.vtu", "--depth", "99", "-o", "r.func.gii") == 0
    assert "642 vertices have no value, NaN: their points are outside the mesh" in capsys.readouterr().out
    assert np.isnan(arrays("r.func.gii")["T"]).all()


def series(mesh: TetMesh, path: str, times: Sequence[float] = (0.5, 1.0)) -> None:
    with meshio.xdmf.TimeSeriesWriter(path) as writer:
        writer.write_points_cells(mesh.points, [("tetra", mesh.cells)])
        for number, time in enumerate(times, start=1):
            values = number / 2 * mesh.points[:, 2]
            writer.write_data(time, point_data={"T": values}, cell_data={"e": [np.full(len(mesh.cells), number / 2)]})


def collection(mesh: TetMesh, path: str, times: Sequence[float] = (0.5, 1.0)) -> None:
    entries = []
    for number, time in enumerate(times, start=1):
        made = grid(mesh.points, mesh.cells)
        made.point_data["T"], made.cell_data["e"] = number / 2 * mesh.points[:, 2], np.full(len(mesh.cells), number / 2)
        made.save(f"step{number}.vtu")
        entries.append(f'<DataSet timestep="{time!r}" file="step{number}.vtu"/>')
    text = "".join(entries)
    Path(path).write_text(f'<VTKFile type="Collection" version="0.1"><Collection>{text}</Collection></VTKFile>')


@pytest.mark.parametrize(("name", "make"), [("r.xdmf", series), ("r.pvd", collection)])
def test_a_series_has_an_array_for_each_time(
    mesh: TetMesh, folder: Path, name: str, make: Callable[[TetMesh, str], None]
) -> None:
    make(mesh, name)
    assert project(name, "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    found = arrays("r.func.gii")
    assert sorted(found) == ["T_0.5", "T_1", "e_0.5", "e_1"]
    assert found["T_1"] == pytest.approx(2 * found["T_0.5"], abs=1e-5) and found["e_0.5"] == pytest.approx(0.5)
    surface = nib.load("x.surf.gii").agg_data("pointset")
    assert np.abs(found["T_1"] - surface[:, 2]).max() < 1.0


@pytest.mark.parametrize(
    ("name", "make", "times"),
    [
        ("r.xdmf", series, (0.0, 1.0, 1.0, 2.0)),
        ("r.xdmf", series, (1.0, 1 + 1e-11)),
        ("r.pvd", collection, (1.0, 1 + 1e-11)),
    ],
)
def test_steps_of_one_time_are_all_there(
    mesh: TetMesh,
    capsys: pytest.CaptureFixture[str],
    name: str,
    make: Callable[[TetMesh, str, Sequence[float]], None],
    times: Sequence[float],
) -> None:
    make(mesh, name, times)
    assert project(name, "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    assert "names end in the number of the step" in capsys.readouterr().out
    found = arrays("r.func.gii")
    assert [found[f"e_{number}"][0] for number in range(len(times))] == pytest.approx(np.arange(1, len(times) + 1) / 2)


def test_two_files_of_one_time_are_refused(mesh: TetMesh) -> None:
    collection(mesh, "r.pvd", (1.0, 1.0))
    assert project("r.pvd", "--mesh", "x.vtu", "-o", "r.func.gii") == 1


def test_exodus_is_refused_with_what_to_do(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("r.e").write_bytes(b"CDF\1")
    assert project("r.e", "--mesh", "x.vtu", "-o", "r.func.gii") == 1
    assert re.search("r.e: .*Exodus.*ParaView", capsys.readouterr().err)


@pytest.mark.parametrize("name", ["r.vtk", "r.xdmf", "r.msh", "r.med"])
def test_what_meshio_writes_is_read(mesh: TetMesh, folder: Path, name: str) -> None:
    made = meshio.Mesh(mesh.points, [("tetra", mesh.cells)], {"T": mesh.points[:, 2].copy()})
    made.write(name, **({"file_format": "gmsh"} if name == "r.msh" else {}))
    assert project(name, "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    found = arrays("r.func.gii")
    (only,) = (values for key, values in found.items() if key.startswith("T"))
    assert np.abs(only - nib.load("x.surf.gii").agg_data("pointset")[:, 2]).max() < 1.0


def test_midside_nodes_and_other_cells_are_left_out(mesh: TetMesh, folder: Path) -> None:
    assert main(["quadratic", "x.vtu", "-o", "ten.vtu"]) == 0
    ten = pyvista.read("ten.vtu")
    ten.point_data["T"] = ten.points[:, 2]
    ten.cell_data["e"] = np.ones(ten.n_cells)
    ten.save("r.vtu")
    assert ten.n_points > len(mesh.points)
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    assert arrays("r.func.gii")["e"] == pytest.approx(1)
    assert np.abs(arrays("r.func.gii")["T"] - nib.load("x.surf.gii").agg_data("pointset")[:, 2]).max() < 1.0


def moved(mesh: TetMesh) -> None:
    grid(mesh.points + [0.5, 0, 0] * (mesh.points[:, :1] > 0), mesh.cells).save("r.vtu")


def grown(mesh: TetMesh) -> None:
    grid(1.1 * mesh.points, mesh.cells).save("r.vtu")


def fewer(mesh: TetMesh) -> None:
    cells = mesh.cells[10:]
    used = np.unique(cells[:-200])
    place = np.searchsorted(used, cells[:-200])
    grid(mesh.points[used], place).save("r.vtu")


def without_fields(mesh: TetMesh) -> None:
    grid(mesh.points, mesh.cells).save("r.vtu")


def damaged(mesh: TetMesh) -> None:
    write(mesh, "r.vtu")
    Path("r.vtu").write_bytes(Path("r.vtu").read_bytes()[:300])


def changed(mesh: TetMesh) -> None:
    write(mesh, "r.vtu")
    Path("x.vtu").write_bytes(Path("x.vtu").read_bytes() + b"\n")


def alone(mesh: TetMesh) -> None:
    write(mesh, "r.vtu")
    Path("x.vtu.json").unlink()


def other_surface(mesh: TetMesh) -> None:
    write(mesh, "r.vtu")
    write_surface(ball_surface(3, RADIUS + 1), "x.surf.gii")


def no_surface(mesh: TetMesh) -> None:
    write(mesh, "r.vtu")
    Path("x.surf.gii").unlink()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (moved, "r.vtu: is no result on this mesh: it .*positions before it moved"),
        (grown, "r.vtu: is no result on this mesh: it is 1.1 times as large as x.vtu"),
        (fewer, "r.vtu: is no result on this mesh: it has .* nodes, and x.vtu .*name the mesh that the solver ran on"),
        (without_fields, "r.vtu: holds no field of numbers"),
        (damaged, "r.vtu: (cannot be read as a result|holds no nodes)"),
        (changed, "x.vtu: was changed after cortet wrote it.*put the mesh of its sidecar back"),
        (alone, "x.vtu: no sidecar says which surface it was made from .*--surface"),
        (other_surface, "x.surf.gii: is missing, or not as the sidecar of x.vtu records it .*--surface"),
        (no_surface, "x.surf.gii: is missing, or not as the sidecar of x.vtu records it .*--surface"),
    ],
)
def test_what_does_not_belong_together_is_refused_in_words(
    mesh: TetMesh, folder: Path, capfd: pytest.CaptureFixture[str], make: Callable[[TetMesh], None], words: str
) -> None:
    make(mesh)
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 1
    said = capfd.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("cortet: ")
    assert re.search(words, said), said
    assert not list(folder.glob("*r.func.gii*"))


def test_a_named_surface_takes_the_place_of_that_of_the_sidecar(
    mesh: TetMesh, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(mesh, "r.vtu")
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "own.func.gii") == 0
    write_surface(ball_surface(3, 3 * RADIUS), "inflated.surf.gii")
    assert project("r.vtu", "--mesh", "x.vtu", "--surface", "inflated.surf.gii", "-o", "r.func.gii") == 0
    assert np.array_equal(arrays("own.func.gii")["T"], arrays("r.func.gii")["T"])
    assert "642 of 642 vertices by their number, though half of these are over 28.0 mm away" in capsys.readouterr().out
    write_surface(ball_surface(2, RADIUS), "coarse.surf.gii")
    assert project("r.vtu", "--mesh", "x.vtu", "--surface", "coarse.surf.gii", "-o", "coarse.func.gii") == 0
    assert len(arrays("coarse.func.gii")["T"]) == 162
    write_surface(ball_surface(2, 2 * RADIUS), "far.surf.gii")
    capsys.readouterr()
    assert project("r.vtu", "--mesh", "x.vtu", "--surface", "far.surf.gii", "-o", "far.func.gii") == 1
    assert "far.surf.gii: is not the surface of x.vtu" in capsys.readouterr().err
    Path("x.vtu.json").unlink()
    assert project("r.vtu", "--mesh", "x.vtu", "--surface", "x.surf.gii", "-o", "named.func.gii") == 0
    assert arrays("named.func.gii")["T"] == pytest.approx(arrays("own.func.gii")["T"], abs=0.1)
    assert "x.surf.gii: 642 by the closest point, at most" in capsys.readouterr().out


def test_an_inner_surface_and_another_unit_are_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outer, inner = ball_surface(3, RADIUS), ball_surface(3, 8.0)
    for name, surface in (("outer", outer), ("inner", inner)):
        write_surface(type(surface)(surface.points / 1000, surface.faces), f"{name}.surf.gii")
    Path("unit.yaml").write_text("gate: {unit: m}\n")
    words = ["mesh", "outer.surf.gii", "--inner", "inner.surf.gii", "--cell-size", "2.5", "--config", "unit.yaml"]
    assert main([*words, "-o", "two.vtu"]) == 0
    write(vtu.read("two.vtu"), "r.vtu")
    assert project("r.vtu", "--mesh", "two.vtu", "-o", "r.func.gii") == 0
    assert np.abs(arrays("r.func.gii")["u_1"] - outer.points[:, 0]).max() < 1.0
    assert project("r.vtu", "--mesh", "two.vtu", "--surface", "inner.surf.gii", "-o", "i.func.gii") == 0
    assert np.abs(arrays("i.func.gii")["u_1"] - inner.points[:, 0]).max() < 1.0


def test_an_input_is_never_written(mesh: TetMesh, folder: Path) -> None:
    write(mesh, "r.gii.vtu")
    Path("r.vtu").write_bytes(Path("r.gii.vtu").read_bytes())
    before = Path("x.surf.gii").read_bytes()
    assert project("r.vtu", "--mesh", "x.vtu", "--force", "-o", "x.surf.gii") == 1
    assert Path("x.surf.gii").read_bytes() == before
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.vtu") == 2


def test_a_killed_command_leaves_nothing_under_the_name(mesh: TetMesh, folder: Path) -> None:
    write(mesh, "r.vtu")
    code = (
        "import os, signal, sys\n"
        "from nibabel.gifti.gifti import GiftiImage\n"
        "GiftiImage.to_xml = lambda self: os.kill(os.getpid(), signal.SIGKILL)\n"
        "from cortet.cli import main\n"
        "main(sys.argv[1:])"
    )
    words = ["project", "r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii"]
    done = subprocess.run([sys.executable, "-c", code, *words], check=False, env=os.environ, capture_output=True)
    assert done.returncode == -signal.SIGKILL
    assert not Path("r.func.gii").exists()
    assert project(*words[1:]) == 0 and len(arrays("r.func.gii")["T"]) == 642


def test_invariants_are_those_of_the_textbook() -> None:
    random = np.random.default_rng(0).normal(size=(5, 3, 3))
    tensors = random + np.swapaxes(random, 1, 2)
    found = invariants(np.concatenate([tensors, np.full((1, 3, 3), np.nan)]))
    deviator = tensors - np.trace(tensors, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    assert found["von_mises"][:5] == pytest.approx(np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))))
    assert found["pressure"][:5] == pytest.approx(-np.trace(tensors, axis1=1, axis2=2) / 3)
    assert found["principal_1"][:5] == pytest.approx(np.linalg.eigvalsh(tensors)[:, 2])
    assert all(np.isnan(values[5]) for values in found.values())


def test_tensors_are_known_by_their_numbers(mesh: TetMesh, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = grid(mesh.points, mesh.cells)
    made.point_data["s"] = np.tile([1.0, 2, 3, 4, 5, 6], (len(mesh.points), 1))
    made.point_data["s_pressure"] = np.full(len(mesh.points), 7.0)
    made.point_data["F"] = np.tile(np.arange(9.0), (len(mesh.points), 1))
    made.save("r.vtu")
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    said, found = capsys.readouterr().out, arrays("r.func.gii")
    assert "s is read as xx, yy, zz, xy, yz, xz" in said and "F is not symmetric" in said
    assert found["s_principal_1"][0] == pytest.approx(np.linalg.eigvalsh([[1, 4, 6], [4, 2, 5], [6, 5, 3]])[2])
    assert "F_9" in found and "F_pressure" not in found
    assert "s_pressure: fields of the result" in said
    assert found["s_pressure"] == pytest.approx(7) and found["s_pressure_2"] == pytest.approx(-2)


def test_a_node_that_does_not_exist_and_a_reader_that_breaks_down_are_refused(
    mesh: TetMesh, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of damaged `.vtk` files, 4 in 10 end VTK with a signal."""
    made = grid(mesh.points, mesh.cells)
    made.point_data["T"] = mesh.points[:, 2]
    made.save("r.vtk", binary=False)
    text = Path("r.vtk").read_text()
    head, mark, rest = text.partition("CONNECTIVITY vtktypeint64\n")
    Path("r.vtk").write_text(head + mark + rest.replace(rest.split()[0], "4000000", 1))
    words = ["r.vtk", "--mesh", "x.vtu", "-o", "r.func.gii"]
    assert mark and project(*words) == 1
    assert re.search("^cortet: r.vtk: ", capsys.readouterr().err)
    broken = subprocess.CompletedProcess([], -signal.SIGSEGV, "", "")
    monkeypatch.setattr("cortet.formats.child.run", lambda *_, **__: broken)
    assert project(*words) == 1
    assert "r.vtk: cannot be read as a result: its reader broke down (SIGSEGV)" in capsys.readouterr().err
    assert not Path("r.func.gii").exists()


# --- relative depth, parcels, the common sphere, matrices


def shapes_of(folder: Path) -> TriSurface:
    return read_surface(folder / "x.surf.gii")


def test_a_relative_depth_is_a_part_of_the_thickness(folder: Path, mesh: TetMesh) -> None:
    write(mesh, "r.vtu")
    command = ["project", "r.vtu", "--mesh", "x.vtu", "-o"]
    assert main([*command, "half.func.gii", "--depth", "50%", "--thickness", "4"]) == 0
    assert main([*command, "mm.func.gii", "--depth", "2"]) == 0
    assert arrays("half.func.gii")["T"] == pytest.approx(arrays("mm.func.gii")["T"])
    assert main([*command, "over.func.gii", "--depth", "0:100%", "--thickness", "4"]) == 0
    heights = shapes_of(folder).points[:, 2]
    shrunk = (arrays("over.func.gii")["T"] / np.where(heights == 0, np.nan, heights))[np.abs(heights) > 4]
    assert np.median(shrunk) == pytest.approx(1 - 2 / RADIUS, abs=0.02)


def test_a_relative_depth_needs_a_thickness(folder: Path, mesh: TetMesh, capsys: pytest.CaptureFixture[str]) -> None:
    write(mesh, "r.vtu")
    assert main(["project", "r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii", "--depth", "50%"]) == 1
    assert "no field thickness" in capsys.readouterr().err
    assert not Path("r.func.gii").exists()


def test_the_thickness_of_the_mesh_differs_from_vertex_to_vertex(folder: Path, mesh: TetMesh) -> None:
    field = np.where(shapes_of(folder).points[:, 0] > 0, 2.0, 6.0)
    write_fields({"thickness": field}, "t.shape.gii")
    made = ["mesh", "x.surf.gii", "--ga", "28", "--cell-size", "3.5", "--field", "thickness=t.shape.gii", "-o", "t.vtu"]
    assert main(made) == 0
    write(vtu.read("t.vtu"), "r.vtu")
    assert main(["project", "r.vtu", "--mesh", "t.vtu", "-o", "r.func.gii", "--depth", "50%"]) == 0
    points, found = shapes_of(folder).points, arrays("r.func.gii")
    below = np.linalg.norm(np.column_stack([found[f"u_{k}"] for k in (1, 2, 3)]), axis=1)
    assert np.median(below[points[:, 0] > 4]) == pytest.approx(RADIUS - 1, abs=0.1)
    assert np.median(below[points[:, 0] < -4]) == pytest.approx(RADIUS - 3, abs=0.1)


def test_parcels_have_their_means_in_a_table(folder: Path, mesh: TetMesh) -> None:
    write(mesh, "r.vtu")
    surface = shapes_of(folder)
    write_fields({"half": (surface.points[:, 2] > 0).astype(np.int32)}, "p.label.gii")
    assert main(["project", "r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii", "--parcels", "p.label.gii"]) == 0
    rows = [line.split("\t") for line in Path("r.parcels.tsv").read_text().splitlines()]
    assert rows[0] == ["parcel", "field", "value"]
    means = {(parcel, name): float(mean) for parcel, name, mean in rows[1:]}
    # the mean height of half a sphere is half its radius
    assert (means["1", "T"], means["0", "T"]) == pytest.approx((RADIUS / 2, -RADIUS / 2), rel=0.12)
    write_fields({"half": np.zeros(7, np.int32)}, "wrong.label.gii")
    assert main(["project", "r.vtu", "--mesh", "x.vtu", "-o", "w.func.gii", "--parcels", "wrong.label.gii"]) == 1


def test_the_result_goes_to_a_common_sphere(folder: Path, mesh: TetMesh, capsys: pytest.CaptureFixture[str]) -> None:
    write(mesh, "r.vtu")
    write_surface(ball_surface(3, 100.0), "own.surf.gii")
    write_surface(ball_surface(2, 100.0), "t.surf.gii")
    command = ["project", "r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii", "--sphere"]
    assert main([*command, "own.surf.gii", "--template-sphere", "t.surf.gii"]) == 0
    heights = arrays("r.func.gii")["T"]
    assert heights == pytest.approx(ball_surface(2, RADIUS).points[:, 2], abs=0.5)
    assert main([*command, "t.surf.gii", "--template-sphere", "own.surf.gii", "--force"]) == 1
    assert "sphere of this surface" in capsys.readouterr().err
    assert main([*command, "own.surf.gii", "--force"]) == 1


def test_labels_stay_labels_on_every_way(folder: Path, mesh: TetMesh) -> None:
    made = grid(mesh.points, mesh.cells)
    made.point_data["of_nodes"] = np.where(mesh.points[:, 2] > 0, 9, 2)
    made.cell_data["of_cells"] = np.where(mesh.points[mesh.cells].mean(axis=1)[:, 2] > 0, 9, 2)
    made.save("r.vtu")
    write_surface(ball_surface(3, 100.0), "own.surf.gii")
    write_surface(ball_surface(2, 97.0), "t.surf.gii")
    write_fields({"parcel": (shapes_of(folder).points[:, 0] > 0).astype(np.int32)}, "p.label.gii")
    ways = ["--parcels", "p.label.gii", "--sphere", "own.surf.gii", "--template-sphere", "t.surf.gii"]
    for depth in ([], ["--depth", "1:3"], ["--depth", f"{RADIUS - 1}:{RADIUS + 9}"]):
        assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii", *ways, *depth, "--force") == 0
        for values in arrays("r.func.gii").values():
            assert len(values) == 162 and set(values[np.isfinite(values)].tolist()) == {2, 9}
        rows = [line.split("\t") for line in Path("r.parcels.tsv").read_text().splitlines()]
        assert {value for _, _, value in rows[1:]} <= {"2", "9"}


def test_parcels_of_one_name_are_one_parcel() -> None:
    parcels = Parcels(np.array([1, 2, 3, 3]), {1: "insula", 2: "insula"}, np.array([1.0, 3.0, 1.0, 1.0]))
    assert parcels.means(np.array([4.0, 8.0, 5.0, np.nan])) == {"3": 5.0, "insula": 7.0}
    assert parcels.labels(np.array([4, 8, 5, 5])) == {"3": 5, "insula": 8}


@pytest.mark.parametrize("option", ["--parcels", "--sphere", "--template-sphere", "--surface"])
def test_files_of_the_other_hemisphere_are_refused(
    folder: Path, mesh: TetMesh, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    write(mesh, "r.vtu")
    for name in ("own", "right"):
        write_surface(ball_surface(3, 100.0 if "sphere" in option else RADIUS), f"{name}.surf.gii")
    write_fields({"parcel": np.zeros(642, np.int32)}, "right.label.gii", hemisphere="R")
    image = nib.load("right.surf.gii")
    image.meta["AnatomicalStructurePrimary"] = "CortexRight"
    Path("right.surf.gii").write_bytes(image.to_xml())
    given = {"--sphere": "own.surf.gii", "--template-sphere": "own.surf.gii"} if "sphere" in option else {}
    given |= {option: "right.label.gii" if option == "--parcels" else "right.surf.gii"}
    words = [word for pair in given.items() for word in pair]
    assert main(["project", "r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii", *words]) == 1
    assert f"{given[option]}: is of hemisphere R, as it says, not L" in capsys.readouterr().err
    assert not list(folder.glob("r.*.gii")) and not list(folder.glob("r.*.tsv"))


def test_any_map_of_a_surface_is_drawn(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    height = shapes_of(folder).points[:, 2]
    write_fields({"height": height, "known": np.where(height > 0, height, np.nan)}, "m.func.gii")
    for words in ([], ["--name", "known"]):
        assert main(["picture", "x.surf.gii", "--field", "m.func.gii", *words, "-o", "m.png"]) == 0
    assert Path("m.png").read_bytes().startswith(b"\x89PNG")
    write_fields({"height": height[:-1]}, "short.func.gii")
    for field, words, said in (
        ("m.func.gii", ["--name", "depth"], "has no array depth (there are height, known)"),
        ("short.func.gii", [], "height has values of shape (641,) for 642 vertices"),
    ):
        assert main(["picture", "x.surf.gii", "--field", field, *words, "-o", "no.png"]) == 1
        assert said in capsys.readouterr().err
    assert main(["picture", "x.vtu", "--name", "height", "-o", "no.png"]) == 2
    assert main(["picture", "x.surf.gii", "--field", "m.func.gii", "--plane", "x", "-o", "no.png"]) == 2
    assert not Path("no.png").exists()


def test_sets_are_no_results(folder: Path, mesh: TetMesh) -> None:
    result = pyvista.read("x.vtu")  # as users make one: the mesh, with a field
    result["height"] = result.points[:, 2]
    result.save("r.vtu")
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    assert set(arrays("r.func.gii")) == {"height"}
    result.cell_data["q"] = np.ones(len(mesh.cells))  # a field of the solver that has this name
    result.save("s.vtu")
    assert project("s.vtu", "--mesh", "x.vtu", "-o", "s.func.gii") == 0
    assert set(arrays("s.func.gii")) == {"height", "q"}


def test_a_result_of_calculix_is_read(folder: Path, mesh: TetMesh) -> None:
    calculix = pytest.importorskip("pyvista_frd")
    result = grid(mesh.points, mesh.cells)
    result["DISP"] = mesh.points
    calculix.write("r.frd", result)
    assert project("r.frd", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    assert np.abs(arrays("r.func.gii")["DISP_3"] - shapes_of(folder).points[:, 2]).max() < 0.6


def test_a_frame_of_a_fold_is_projected_where_its_nodes_began(folder: Path, mesh: TetMesh) -> None:
    words = ["--ga", "28", "--end", "28.2", "--surfaces", "28.2", "--force"]  # no brain is so small
    assert main(["fold", "x.vtu", *words, "-o", "folded"]) == 0
    last = max(Path("folded/frames").glob("*.vtu"))
    assert main(["project", str(last), "--mesh", "x.vtu", "-o", "f.func.gii"]) == 0
    assert {"displacement_1", "stress_principal_1", "stretch", "J"} <= set(arrays("f.func.gii"))


def test_a_displacement_of_a_solver_is_no_frame_of_a_fold(folder: Path, mesh: TetMesh) -> None:
    """dolfinx writes its nodes where they began, in an order of its own."""
    order = np.random.default_rng(1).permutation(len(mesh.points))
    result = grid(mesh.points[order], np.argsort(order)[mesh.cells])
    result["displacement"] = 0.1 * mesh.points[order] + 1
    result.save("r.vtu")
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    found = np.column_stack([arrays("r.func.gii")[f"displacement_{axis}"] for axis in (1, 2, 3)])
    assert np.abs(found - 0.1 * shapes_of(folder).points - 1).max() < 0.1


def test_a_displacement_may_be_unknown_at_a_node(folder: Path, mesh: TetMesh) -> None:
    result = grid(mesh.points, mesh.cells)
    result["displacement"] = np.where(np.arange(len(mesh.points))[:, None] == 0, np.nan, mesh.points)
    result.save("r.vtu")
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    assert np.isfinite(arrays("r.func.gii")["displacement_1"]).mean() > 0.9


def test_a_mesh_may_come_with_its_matrices(folder: Path) -> None:
    Path("map.yaml").write_text("export: {map: true}")
    made = ["mesh", "x.surf.gii", "--ga", "28", "--cell-size", "3.5", "--config", "map.yaml", "-o", "m.mesh"]
    assert main(made) == 0
    record = json.loads(Path("m.mesh.json").read_text())
    certificate = json.loads(Path("m.certificate.json").read_text())
    assert record["map"]["mesh_sha256"] == certificate["mesh_sha256"]
    assert set(record["files"]) == {"m.mesh", record["map"]["to_surface"], record["map"]["from_surface"]}
    to_surface, back = (load_npz(record["map"][name]) for name in ("to_surface", "from_surface"))
    nodes, surface = braingrowth.read("m.mesh").points, shapes_of(folder)
    assert np.abs(to_surface @ nodes - surface.points).max() < 0.6
    assert back.shape == to_surface.shape[::-1]
