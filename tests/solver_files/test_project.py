"""Results of solvers on the surface: what is read, matched and refused, and the file that comes out."""

from __future__ import annotations

import re
import signal
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import meshio
import nibabel as nib
import numpy as np
import pytest
import pyvista
from numpy.typing import NDArray
from shapes import ball_surface

from cortet.cli import main
from cortet.formats import vtu
from cortet.formats.gifti import read_surface, write_surface
from cortet.meshes import TetMesh

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
    height = mesh.points[mesh.cells].mean(axis=1)[:, 2]
    return {"u": mesh.points, "T": mesh.points[:, 2]}, {"S": stress, "e": np.ones(len(mesh.cells)), "h": height}


def grid(points: NDArray[np.float64], cells: NDArray[np.integer]) -> pyvista.UnstructuredGrid:
    return pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, points)


def write(mesh: TetMesh, path: Path | str, *, order: NDArray[np.intp] | None = None, scale: float = 1.0) -> None:
    """A result with the nodes in an order, and the tetrahedra in another one for each scale."""
    of_nodes, of_cells = fields(mesh)
    order = np.arange(len(mesh.points)) if order is None else order
    shift = 0 if scale == 1 else 7
    made = grid(mesh.points[order] * scale, np.roll(np.argsort(order)[mesh.cells], shift, axis=0))
    for name, values in of_nodes.items():
        made.point_data[name] = values[order]
    for name, values in of_cells.items():
        made.cell_data[name] = np.roll(values, shift, axis=0)
    made.save(path)


def arrays(path: Path | str) -> dict[str, NDArray[np.float64]]:
    return {one.meta["Name"]: one.data for one in nib.load(path).darrays}


def project(*words: str) -> int:
    try:
        return main(["project", *words])
    except SystemExit as stop:
        return int(stop.code or 0)


def projected(result: str, *words: str, mesh: str = "x.vtu", out: str = "r.func.gii") -> dict[str, NDArray[np.float64]]:
    """The arrays that the command makes of a result."""
    assert project(result, "--mesh", mesh, "-o", out, "--force", *words) == 0
    return arrays(out)


def heights() -> NDArray[np.float64]:
    """z of the vertices of the surface, mm."""
    return np.asarray(read_surface("x.surf.gii").points[:, 2])


def test_all_fields_come_back_by_their_names(folder, mesh):
    write(mesh, "r.vtu")
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    found = projected("r.vtu")
    assert all((folder / name).read_bytes() == content for name, content in before.items() if name[0] != ".")
    assert all(values.shape == (642,) and values.dtype == np.float32 for values in found.values())
    points = read_surface("x.surf.gii").points
    assert np.abs(np.stack([found[f"u_{axis}"] for axis in (1, 2, 3)], axis=1) - points).max() < 1.0
    assert np.array_equal(found["T"], found["u_3"]) and found["e"] == pytest.approx(1)
    invariant = {"principal_1": 3, "principal_2": 1, "principal_3": -1, "pressure": -1, "von_mises": np.sqrt(12)}
    assert all(found[f"S_{name}"] == pytest.approx(value) for name, value in invariant.items())
    assert dict(nib.load("r.func.gii").meta) == {"AnatomicalStructurePrimary": "CortexLeft"}
    assert not set(found) & {"cortical_surface", "core", "cortex"}


def test_another_order_and_unit_give_the_same(mesh):
    write(mesh, "r.vtu")
    write(mesh, "other.vtu", order=np.random.default_rng(0).permutation(len(mesh.points)), scale=1e-3)
    one, other = projected("r.vtu"), projected("other.vtu", out="other.func.gii")
    assert one.keys() == other.keys()
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_depth_is_one_or_a_range(mesh):
    write(mesh, "r.vtu")
    for depth, middle in (("2", 2), ("1:5", 3)):
        assert np.abs(projected("r.vtu", "--depth", depth)["T"] - (1 - middle / RADIUS) * heights()).max() < 0.25
    for depth in ("5:1", "1:2:3", "-1", "deep"):
        assert project("r.vtu", "--mesh", "x.vtu", "--depth", depth, "-o", "r.func.gii") == 2
    assert project("r.vtu", "--mesh", "x.vtu", "--depth", "99", "-o", "none.func.gii") == 1
    assert not Path("none.func.gii").exists()


def series(mesh: TetMesh, path: str, times: Sequence[float]) -> None:
    with meshio.xdmf.TimeSeriesWriter(path) as writer:
        writer.write_points_cells(mesh.points, [("tetra", mesh.cells)])
        for number, time in enumerate(times, start=1):
            values = number / 2 * mesh.points[:, 2]
            writer.write_data(time, point_data={"T": values}, cell_data={"e": [np.full(len(mesh.cells), number / 2)]})


def collection(mesh: TetMesh, path: str, times: Sequence[float]) -> None:
    entries = []
    for number, time in enumerate(times, start=1):
        made = grid(mesh.points, mesh.cells)
        made.point_data["T"], made.cell_data["e"] = number / 2 * mesh.points[:, 2], np.full(len(mesh.cells), number / 2)
        made.save(f"step{number}.vtu")
        entries.append(f'<DataSet timestep="{time!r}" file="step{number}.vtu"/>')
    text = "".join(entries)
    Path(path).write_text(f'<VTKFile type="Collection" version="0.1"><Collection>{text}</Collection></VTKFile>')


@pytest.mark.parametrize(("name", "make"), [("r.xdmf", series), ("r.pvd", collection)])
@pytest.mark.parametrize(("times", "names"), [((0.5, 1.0), ["0.5", "1"]), ((1.0, 1 + 1e-11), ["0", "1"])])
def test_a_series_has_an_array_for_each_time_or_else_for_each_step(mesh, name, make, times, names):
    make(mesh, name, times)
    found = projected(name)
    assert sorted(found) == sorted(f"{field}_{of}" for field in "Te" for of in names)
    for number, of in enumerate(names, start=1):
        assert found[f"e_{of}"] == pytest.approx(number / 2)
        assert np.abs(found[f"T_{of}"] - number / 2 * heights()).max() < 1.0


@pytest.mark.parametrize("name", ["r.vtk", "r.xdmf", "r.msh", "r.med"])
def test_what_meshio_writes_is_read(mesh, folder, name):
    made = meshio.Mesh(mesh.points, [("tetra", mesh.cells)], {"T": mesh.points[:, 2].copy()})
    made.write(name, **({"file_format": "gmsh"} if name == "r.msh" else {}))
    (only,) = (values for key, values in projected(name).items() if key.startswith("T"))
    assert np.abs(only - heights()).max() < 1.0


def test_midside_nodes_and_other_cells_are_left_out(mesh, folder):
    assert main(["quadratic", "x.vtu", "-o", "ten.vtu"]) == 0
    ten = pyvista.read("ten.vtu")
    ten.point_data["T"] = ten.points[:, 2]
    ten.cell_data["e"] = np.ones(ten.n_cells)
    ten.save("r.vtu")
    assert ten.n_points > len(mesh.points)
    found = projected("r.vtu")
    assert found["e"] == pytest.approx(1) and np.abs(found["T"] - heights()).max() < 1.0


def fewer(mesh: TetMesh) -> None:
    used, cells = np.unique(mesh.cells[10:-200], return_inverse=True)
    grid(mesh.points[used], cells.reshape(-1, 4)).save("r.vtu")


def diverged(mesh: TetMesh, name: str, nodes: slice) -> None:
    made = grid(mesh.points, mesh.cells)
    values = mesh.points[:, 2].copy()
    values[nodes] = np.nan
    made["u"] = values
    made.save(name)


def test_single_fields_are_projected_by_name(mesh, folder, capsys):
    write(mesh, "r.vtu")
    assert projected("r.vtu", "--field", "T", "--field", "h").keys() == {"T", "h"}
    assert project("r.vtu", "--mesh", "x.vtu", "--field", "v", "-o", "s.func.gii") == 1
    assert re.search(r"no field v .*T.*h", capsys.readouterr().err)


def test_a_result_that_is_partly_nan_is_counted(mesh, folder, capsys):
    diverged(mesh, "r.vtu", slice(5))
    assert project("r.vtu", "--mesh", "x.vtu", "-o", "r.func.gii") == 0
    counted = int(np.isnan(arrays("r.func.gii")["u"]).sum())
    assert counted > 0 and f"u: {counted} of" in capsys.readouterr().out


#: what is done to a result, its mesh or its surface, and which file the error names with which word
WRONG: dict[str, tuple[Callable[[TetMesh], object], str]] = {
    "moved": (
        lambda mesh: grid(mesh.points + 0.5 * (mesh.points[:, :1] > 0), mesh.cells).save("r.vtu"),
        "r.vtu.*undeformed",
    ),
    "grown": (lambda mesh: grid(1.1 * mesh.points, mesh.cells).save("r.vtu"), "r.vtu.*1.1 times"),
    "fewer nodes": (fewer, "r.vtu.* nodes"),
    "Exodus": (lambda _: Path("r.vtu").rename("r.e").write_bytes(b"CDF\1"), "r.e: .*Exodus.*ParaView"),
    "no fields": (lambda mesh: grid(mesh.points, mesh.cells).save("r.vtu"), "r.vtu.*no numeric field"),
    "diverged": (lambda mesh: diverged(mesh, "r.vtu", slice(None)), "r.vtu.*no finite value"),
    "step missing": (
        lambda _: (
            Path("r.vtu")
            .rename("r.pvd")
            .write_text(
                '<VTKFile type="Collection"><Collection><DataSet timestep="0" file="s.0vtu"/></Collection></VTKFile>'
            )
        ),
        "r.pvd: names 1 file that is missing, of 1: s.0vtu",
    ),
    "no step": (lambda _: Path("r.vtu").rename("r.pvd").write_text("<VTKFile/>"), "r.pvd: names no file"),
    "no piece": (
        lambda _: Path("r.vtu").rename("r.pvtu").write_text('<VTKFile><Piece Source="a&amp;b.vtu"/></VTKFile>'),
        "r.pvtu: names 1 file that is missing, of 1: a&b.vtu",
    ),
    "cut off": (lambda _: Path("r.vtu").write_bytes(Path("r.vtu").read_bytes()[:300]), "r.vtu"),
    "mesh changed": (lambda _: Path("x.vtu").write_bytes(Path("x.vtu").read_bytes() + b"\n"), "x.vtu.*changed"),
    "no sidecar": (lambda _: Path("x.vtu.json").unlink(), "x.vtu.*--surface"),
    "another surface": (lambda _: write_surface(ball_surface(3, RADIUS + 1), "x.surf.gii"), "x.surf.gii.*--surface"),
    "no surface": (lambda _: Path("x.surf.gii").unlink(), "x.surf.gii.*--surface"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_does_not_belong_together_is_refused(mesh, folder, capfd, case):
    write(mesh, "r.vtu")
    make, word = WRONG[case]
    make(mesh)
    result = next(file.name for file in sorted(Path().glob("r.*")))
    assert project(result, "--mesh", "x.vtu", "-o", "r.func.gii") == 1
    said = capfd.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("cortet: ") and re.search(word, said), said
    assert not list(folder.glob("*r.func.gii*"))


def test_a_named_surface_takes_the_place_of_that_of_the_sidecar(mesh, folder, capsys):
    write(mesh, "r.vtu")
    own = projected("r.vtu", out="own.func.gii")["T"]
    write_surface(ball_surface(3, 3 * RADIUS), "inflated.surf.gii")
    assert np.array_equal(projected("r.vtu", "--surface", "inflated.surf.gii")["T"], own)
    write_surface(ball_surface(2, RADIUS), "coarse.surf.gii")
    assert len(projected("r.vtu", "--surface", "coarse.surf.gii")["T"]) == 162
    write_surface(ball_surface(2, 2 * RADIUS), "far.surf.gii")
    assert project("r.vtu", "--mesh", "x.vtu", "--surface", "far.surf.gii", "-o", "far.func.gii") == 1
    assert "far.surf.gii" in capsys.readouterr().err
    Path("x.vtu.json").unlink()
    assert projected("r.vtu", "--surface", "x.surf.gii")["T"] == pytest.approx(own, abs=0.1)


def test_a_node_that_does_not_exist_and_a_reader_that_breaks_down_are_refused(mesh, folder, capsys, monkeypatch):
    """Of damaged `.vtk` files, 4 in 10 end VTK with a signal."""
    made = grid(mesh.points, mesh.cells)
    made.point_data["T"] = mesh.points[:, 2]
    made.save("r.vtk", binary=False)
    head, mark, rest = Path("r.vtk").read_text().partition("CONNECTIVITY vtktypeint64\n")
    Path("r.vtk").write_text(head + mark + rest.replace(rest.split()[0], "4000000", 1))
    words = ["r.vtk", "--mesh", "x.vtu", "-o", "r.func.gii"]
    assert mark and project(*words) == 1
    assert re.search("^cortet: r.vtk: ", capsys.readouterr().err)
    broken = subprocess.CompletedProcess([], -signal.SIGSEGV, "", "")
    monkeypatch.setattr("cortet.formats.child.run", lambda *_, **__: broken)
    assert project(*words) == 1
    assert re.search("r.vtk.*SIGSEGV", capsys.readouterr().err)
    assert not Path("r.func.gii").exists()
