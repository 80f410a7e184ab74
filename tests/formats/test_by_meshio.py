"""Meshes of other programs: what meshio reads is right, and what it would read wrongly is refused by name."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import gmsh
import meshio
import numpy as np
import pytest
import pyvista
from cubes import cube_mesh
from exported import full_mesh
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

from cortet.errors import InputError
from cortet.formats import FORMATS, braingrowth, carp, read_mesh, vtu
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh

CUBE = cube_mesh(2)
FIELDS = {"depth": np.arange(27.0), "normal": np.arange(81.0).reshape(27, 3)}
REGION = (np.arange(48) % 2 + 1).astype(np.int32)


def written(path: Path, *more: tuple[str, Any], tetrahedra: bool = True, **how: Any) -> Path:
    """The file of the tetrahedra of a cube and further cells, each with a number."""
    blocks = [*more, ("tetra", CUBE.cells)] if tetrahedra else [*more]
    numbers = [np.zeros(len(cells), np.int32) for _, cells in more]
    name = "gmsh:physical" if path.suffix == ".msh" else "region"
    mesh = meshio.Mesh(CUBE.points, blocks, FIELDS, {name: [*numbers, REGION][: len(blocks)]})
    if path.suffix == ".msh":
        mesh.cell_data["gmsh:geometrical"] = mesh.cell_data[name]
    meshio.write(path, mesh, **how)
    return path


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("x.xdmf", {"data_format": "XML"}),
        ("x.vtu", {}),
        ("x.vtu", {"binary": False}),
        ("x.vtk", {}),
        ("x.vtk", {"file_format": "vtk42"}),
        ("x.vtk", {"binary": False}),
        ("x.msh", {"file_format": "gmsh22"}),
    ],
)
def test_a_mesh_of_meshio_is_read_with_its_fields_and_regions(tmp_path, name, how):
    mesh = read_mesh(written(tmp_path / name, **how))
    assert np.allclose(mesh.points, CUBE.points) and np.array_equal(mesh.cells, CUBE.cells)
    for field, values in FIELDS.items() if name != "x.msh" else ():
        assert np.allclose(mesh.point_data[field], values)
    assert np.array_equal(mesh.cell_data["region"], REGION)


@pytest.mark.parametrize("suffix", [".xdmf", ".vtu", ".vtk"])
def test_triangles_and_lines_are_left_out_and_other_cells_refused(tmp_path, suffix):
    triangle = ("triangle", np.array([[0, 1, 4]]))
    mesh = read_mesh(written(tmp_path / f"x{suffix}", triangle, ("line", np.array([[0, 1]]))))
    assert np.array_equal(mesh.cells, CUBE.cells) and np.array_equal(mesh.cell_data["region"], REGION)
    assert "triangle" in refused(written(tmp_path / f"y{suffix}", triangle, tetrahedra=False))
    assert "hexahedron" in refused(written(tmp_path / f"z{suffix}", ("hexahedron", np.arange(8)[None])))


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert caught.value.remedy and Path(caught.value.file or "").parent == path.parent
    return str(caught.value)


def saved_by_vtk(grid: pyvista.UnstructuredGrid, path: Path, mode: str, *, compressed: bool) -> None:
    """The file of a grid in one of the forms that VTK writes."""
    if path.suffix == ".vtk":
        grid.save(path, binary=mode == "binary")
        return
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    {"ascii": writer.SetDataModeToAscii, "binary": writer.SetDataModeToBinary}.get(mode, writer.SetDataModeToAppended)()
    writer.SetEncodeAppendedData(mode == "appended")
    writer.SetBlockSize(4096)
    if not compressed:
        writer.SetCompressorTypeToNone()
    assert writer.Write()


@pytest.mark.parametrize(
    ("name", "mode", "compressed"),
    [
        *(("m.vtu", mode, True) for mode in ("ascii", "binary", "appended", "raw")),
        ("m.vtu", "raw", False),
        *(("m.vtk", mode, False) for mode in ("ascii", "binary")),
    ],
)
def test_every_form_that_vtk_writes_is_read(tmp_path, name, mode, compressed):
    mesh = full_mesh()
    vtu.write(mesh, tmp_path / "own.vtu")
    saved_by_vtk(pyvista.read(tmp_path / "own.vtu"), tmp_path / name, mode, compressed=compressed)
    back = read_mesh(tmp_path / name)
    assert np.allclose(back.points, mesh.points, rtol=1e-5, atol=1e-5) and np.array_equal(back.cells, mesh.cells)
    assert np.allclose(back.point_data["normal"], mesh.point_data["normal"], rtol=1e-5, atol=1e-6)
    assert np.array_equal(back.point_data["area"], mesh.point_data["area"])
    assert np.array_equal(back.sets.cells["cortex"], mesh.sets.cells["cortex"])


def test_groups_of_gmsh_are_read_in_its_newest_version(tmp_path):
    FORMATS["gmsh"].write(full_mesh(), tmp_path / "m.msh")
    gmsh.initialize(argv=[], readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.open(str(tmp_path / "m.msh"))
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.write(str(tmp_path / "n.msh"))
    gmsh.finalize()
    mesh, back = full_mesh(), read_mesh(tmp_path / "n.msh")
    assert {name: len(some) for name, some in back.sets.cells.items()} == {
        name: len(mesh.sets.cells[name]) for name in ("cortex", "core")
    }
    assert {name: len(some) for name, some in back.sets.faces.items()} == {
        name: len(mesh.sets.faces[name]) for name in ("cortical_surface", "medial_wall")
    }


def test_a_file_without_its_data_and_a_series_of_times_are_refused(tmp_path, monkeypatch):
    path = written(tmp_path / "x.xdmf")
    (tmp_path / "x.h5").unlink()
    assert "x.h5" in refused(path)
    monkeypatch.chdir(tmp_path)  # meshio puts the data there
    with meshio.xdmf.TimeSeriesWriter("y.xdmf") as series:
        series.write_points_cells(CUBE.points, [("tetra", CUBE.cells)])
        series.write_data(0.0, point_data={"depth": FIELDS["depth"]})
    assert "meshio" in refused(tmp_path / "y.xdmf")


@pytest.mark.parametrize("name", ["vtu", "vtk", "gmsh", "abaqus", "nastran", "fenics", "carp"])
def test_a_file_that_is_missing_cut_off_or_of_another_kind_is_refused(name, tmp_path):
    path = tmp_path / f"m{FORMATS[name].suffix if name in FORMATS else '.vtk'}"
    assert "No such file" in refused(path)
    written(path) if name == "vtk" else FORMATS[name].write(full_mesh(), path)
    content = path.read_bytes()
    shares = {"abaqus": (0, 0.1, 0.5), "vtk": (0, 0.5), "vtu": (0, 0.5)}  # each look of VTK begins a process
    for share in shares.get(name, (0, 0.1, 0.5, 0.9)):
        path.write_bytes(content[: int(share * len(content))])
        refused(path)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" * 9)
    refused(path)
    path.unlink()
    path.mkdir()
    assert "is not a file" in refused(path)


@pytest.mark.parametrize("suffix", [".vtu", ".inp", ".bdf", ".xdmf", ".pts"])
def test_nodes_that_are_not_finite_or_not_there_are_refused(tmp_path, suffix):
    form = next(form for form in FORMATS.values() if form.suffix == suffix)
    points = CUBE.points.copy()
    points[0, 1] = np.nan
    form.write(replace(CUBE, points=points), tmp_path / f"m{suffix}")
    refused(tmp_path / f"m{suffix}")
    if suffix in (".inp", ".pts"):
        form.write(CUBE, tmp_path / f"n{suffix}")
        file = tmp_path / ("n.elem" if suffix == ".pts" else "n.inp")
        last = max(map(int, re.findall(r"\d+", file.read_text())))
        file.write_text(re.sub(r"(\n(?:Tt \d+|\d+, \d+)[ ,]+\d+)", rf"\g<1>{last}", file.read_text(), count=40))
        refused(tmp_path / f"n{suffix}")


@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        *((".elem", text) for text in ("1\nHx 0 1 2 3 4 5 6 7 1\n", "1\nTt 0 1 2 99 1\n")),
        *((".pts", text) for text in ("twenty\n", "1\n0 0\n")),
        *((".lon", "1\n1 0 0\n"), (".regions.tsv", "tag\tname\n1\n")),
        *((".mesh", text) for text in ("", "4\n0 0 0\n", "x\n", "1\n0 0 0\n1\n1 1 2 3 4\n")),
    ],
)
def test_damaged_text_of_opencarp_and_braingrowth_is_refused(tmp_path, suffix, text):
    FORMATS["carp"].write(CUBE, tmp_path / "m.pts")
    (tmp_path / f"m{suffix}").write_text(text)
    with pytest.raises(InputError, match="m\\.") as caught:
        braingrowth.read(tmp_path / "m.mesh") if suffix == ".mesh" else read_mesh(tmp_path / "m.pts")
    assert caught.value.remedy


# --- Abaqus: meshio skips keywords that it does not know


def rewritten(path: Path, lines: str) -> TetMesh:
    """What is read of a cube when lines stand before its sets."""
    FORMATS["abaqus"].write(CUBE, path)
    text = path.read_text()
    assert text.count("*NSET") == 1
    path.write_text(text.replace("*NSET", f"{lines}\n*NSET"))
    return read_mesh(path)


def test_sets_of_abaqus_are_read(tmp_path):
    lines = "*ELSET, ELSET=left\n1, 2, 7\n*ELSET, ELSET=right, GENERATE\n9, 12, 1\n*NSET, NSET=some, GENERATE\n1, 9, 4"
    sets = rewritten(tmp_path / "m.inp", lines).sets
    assert {name: some.tolist() for name, some in sets.cells.items()} == {"left": [0, 1, 6], "right": [8, 9, 10, 11]}
    assert sets.nodes["some"].tolist() == [0, 4, 8]
    text = (tmp_path / "m.inp").read_text().replace("\n31, ", "\n*ELEMENT, TYPE=C3D4, ELSET=cortex\n31, ", 1)
    (tmp_path / "m.inp").write_text(text.replace("ELSET=all_elements", "ELSET=core"))
    cells = read_mesh(tmp_path / "m.inp").sets.cells  # a block of elements is a set
    assert np.array_equal(np.sort(np.concatenate([cells["core"], cells["cortex"]])), range(48))


def test_lower_case_and_commas_at_the_end_of_lines_of_abaqus_are_read(tmp_path):
    FORMATS["abaqus"].write(CUBE, tmp_path / "m.inp")
    text = re.sub(r"^(\d.*)$", r"\1,", (tmp_path / "m.inp").read_text().replace("C3D4", "c3d4"), flags=re.MULTILINE)
    (tmp_path / "m.inp").write_text(text)
    mesh = read_mesh(tmp_path / "m.inp")
    assert np.array_equal(mesh.cells, CUBE.cells) and np.allclose(mesh.points, CUBE.points)


@pytest.mark.parametrize("lines", ["*NODE PRINT, NSET=all_nodes\nU\n*NODE FILE\nU", "** a comment"])
def test_steps_and_comments_of_abaqus_do_not_matter(tmp_path, lines):
    rewritten(tmp_path / "m.inp", lines)
    text = (tmp_path / "m.inp").read_text()
    assert text.count("\n9, ") > 1
    (tmp_path / "m.inp").write_text(text.replace("\n9, ", "\n** within a block\n9, "))
    mesh = read_mesh(tmp_path / "m.inp")
    assert np.array_equal(mesh.cells, CUBE.cells) and np.allclose(mesh.points, CUBE.points)


@pytest.mark.parametrize(
    "lines",
    [
        "*INCLUDE, INPUT=other.inp",
        "*NFILL\nx0, x1, 3",
        "*NODE, SYSTEM=C\n900, 1, 2, 3",
        "*SYSTEM\n0, 0, 0, 1, 1, 1",
        "*NODE\n900, 1, 2, 3",
        "*NSET, NSET=a\ncortical_surface",
        "*ELSET, ELSET=a\nall_elements",
        "*ELEMENT, TYPE=C3D4, ELSET=all_elements\n900, 1, 2, 3, 4",
        "*PART, NAME=a\n*END PART\n*PART, NAME=b\n*END PART",
        "*INSTANCE, NAME=a\n*END INSTANCE\n*INSTANCE, NAME=b\n*END INSTANCE",
        "*INSTANCE, NAME=a, PART=b\n5., 0., 0.\n*END INSTANCE",
        "*NSET, NSET=a\n1, 2\n*Nset, generate, nset = A\n3, 9, 1",
        "*ELSET, ELSET=a\n1\n*ELSET, ELSET=a\n2",
        "*ELEMENT, TYPE=S3\n900, 1, 2, 3, 4",
        "*ELEMENT, TYPE=C3D10\n900, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10",
    ],
)
def test_what_meshio_would_miss_or_take_for_something_else_is_refused(tmp_path, lines):
    with pytest.raises(InputError) as caught:
        rewritten(tmp_path / "m.inp", lines)
    assert caught.value.file == tmp_path / "m.inp" and caught.value.remedy


def test_a_second_block_of_nodes_is_named_in_words(tmp_path):
    with pytest.raises(InputError, match="not a second block .NODE"):
        rewritten(tmp_path / "m.inp", "*NODE\n900, 1, 2, 3")


# --- other formats of which meshio reads a part


#: what Gmsh does to a mesh of two volumes, of which meshio cannot read the file
OF_GMSH = {
    "partitioned": lambda gmsh: gmsh.model.mesh.partition(2),
    "all entities": lambda gmsh: gmsh.option.setNumber("Mesh.SaveAll", 1),
    "version 4.0": lambda gmsh: gmsh.option.setNumber("Mesh.MshFileVersion", 4.0),
}


@pytest.mark.parametrize("how", OF_GMSH)
def test_files_of_gmsh_that_meshio_cannot_read_are_read(tmp_path, how):
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        outer, inner = (gmsh.model.occ.addBox(-half, -half, -half, *[2 * half] * 3) for half in (30, 15))
        gmsh.model.occ.fragment([(3, outer)], [(3, inner)])
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", 20)
        for (_, tag), name in zip(gmsh.model.getEntities(3), ("inner", "outer"), strict=True):
            gmsh.model.addPhysicalGroup(3, [tag], name=name)
        gmsh.model.mesh.generate(3)
        OF_GMSH[how](gmsh)
        gmsh.write(str(tmp_path / "a.msh"))
    finally:
        gmsh.finalize()
    mesh = read_mesh(tmp_path / "a.msh")
    assert np.abs(signed_volumes(mesh.points, mesh.cells)).sum() == pytest.approx(60**3)
    members = {name: np.abs(signed_volumes(mesh.points, mesh.cells[of])).sum() for name, of in mesh.sets.cells.items()}
    assert members == {"inner": pytest.approx(30**3), "outer": pytest.approx(60**3 - 30**3)}


@pytest.mark.parametrize("other", [2, 3])
def test_two_groups_of_gmsh_with_one_name_are_refused(tmp_path, other):
    """The set had the members of one of them, in silence."""
    path = written(tmp_path / "x.msh", file_format="gmsh22", binary=False)
    groups = f'$PhysicalNames\n2\n{other} 1 "brain"\n3 2 "brain"\n$EndPhysicalNames\n$Nodes'
    path.write_text(path.read_text().replace("$Nodes", groups, 1))
    assert "two physical groups have the name 'brain'" in refused(path)


def test_fibre_and_sheet_directions_of_opencarp_are_read_and_other_elements_named(tmp_path):
    carp.write(CUBE, tmp_path / "x.pts")
    _, *fibres = (tmp_path / "x.lon").read_text().splitlines()
    (tmp_path / "x.lon").write_text("\n".join(["2", *(f"{fibre} 0 1 0" for fibre in fibres)]) + "\n")
    assert np.array_equal(carp.read(tmp_path / "x.pts").cell_data["fibre"], np.tile([1.0, 0, 0], (len(CUBE.cells), 1)))
    with (tmp_path / "x.elem").open("a") as elements:
        elements.write("Tr 0 1 2 9\n")
    assert "elements of type Tr" in refused(tmp_path / "x.pts")


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_cells_of_vtk_that_meshio_does_not_know_are_refused(tmp_path, suffix):
    kinds = np.repeat([pyvista.CellType.TETRA, pyvista.CellType.VOXEL], [len(CUBE.cells), 1])
    cells = np.concatenate([np.column_stack([np.full(48, 4), CUBE.cells]).ravel(), [8, *range(8)]])
    pyvista.UnstructuredGrid(cells, kinds, CUBE.points).save(tmp_path / f"x{suffix}")
    assert "not hexahedron, tetra" in refused(tmp_path / f"x{suffix}"), "a voxel is one"


def test_bulk_data_of_nastran_may_have_tabs_and_no_first_line(tmp_path):
    FORMATS["nastran"].write(CUBE, tmp_path / "m.bdf")
    text = (tmp_path / "m.bdf").read_text().replace("BEGIN BULK\n", "")
    (tmp_path / "m.bdf").write_text(re.sub(r"^CTETRA.*$", lambda card: re.sub(" +", "\t", card[0]), text, flags=re.M))
    assert np.array_equal(read_mesh(tmp_path / "m.bdf").cells, CUBE.cells)
    (tmp_path / "m.bdf").write_text(text.replace("ENDDATA", ""))
    assert "no line ENDDATA" in refused(tmp_path / "m.bdf")


@pytest.mark.parametrize("card", ["INCLUDE 'other.bdf'", "CORD2R,1,0,5.,0.,0.,5.,0.,1.\n+,6.,0.,0."])
def test_nodes_of_nastran_that_are_elsewhere_are_refused(tmp_path, card):
    FORMATS["nastran"].write(CUBE, tmp_path / "m.bdf")
    text = (tmp_path / "m.bdf").read_text()
    (tmp_path / "m.bdf").write_text(text.replace("BEGIN BULK\n", f"BEGIN BULK\n{card}\n"))
    assert card[:7] in refused(tmp_path / "m.bdf")


def test_ghost_cells_and_files_cut_off_in_an_array_are_refused(tmp_path):
    """VTK hides the ones, and reads what is there of the others."""
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: CUBE.cells}, CUBE.points)
    grid["f"] = np.arange(len(CUBE.points), dtype=float)
    grid.save(tmp_path / "whole.vtk", binary=True)
    (tmp_path / "cut.vtk").write_bytes((tmp_path / "whole.vtk").read_bytes()[:-100])
    assert "f" in read_mesh(tmp_path / "whole.vtk").point_data and "Error reading" in refused(tmp_path / "cut.vtk")
    grid.cell_data["vtkGhostType"] = np.arange(len(CUBE.cells), dtype=np.uint8) % 2
    grid.save(tmp_path / "ghosts.vtu")
    assert "ghost cells" in refused(tmp_path / "ghosts.vtu")
