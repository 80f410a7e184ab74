"""Each format as other programs read it: regions by one number and name, elements, and fields on the right nodes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
import pyvista
from cubes import cube_mesh
from read_back import linear, main, model, seen
from shapes import ball_surface

import cortet
from cortet.api.meshing import tetrahedra
from cortet.cli import main as cortet_command
from cortet.cli.given import read_mesh
from cortet.errors import InputError, StageError
from cortet.folding.models import stiffness_of
from cortet.folding.section import Settings
from cortet.formats import FORMATS, format_of, msh, nastran, vtu
from cortet.formats.gifti import write_surface
from cortet.formats.tags import face_tags, region_numbers, regions
from cortet.geometry.quadratic import quadratic
from cortet.geometry.topology import boundary_faces, boundary_surface, compact
from cortet.measure.certify import certify
from cortet.meshes import REGION, MeshSets, TetMesh
from cortet.solver_files import others
from cortet.solver_files.export import convert, export
from cortet.solver_files.sets import named_sets, tagged
from cortet.solver_files.sidecar import CHANGED, changed_since
from cortet.solver_files.ten_nodes import write_ten_nodes
from cortet.stages.solver_ready import surface_nodes_first

CERTIFIED = {"certified": True, "reasons": []}
VOLUMES = [name for name, form in FORMATS.items() if not form.is_surface]


@pytest.mark.parametrize("tags", [None, "tissue"])
@pytest.mark.parametrize("name", VOLUMES)
def test_every_program_finds_the_same_numbers_and_names_and_the_field_where_it_is(
    name: str, tags: str | None, tmp_path: Path
) -> None:
    mesh = model(tags)
    names = {1: "cortex", 2: "white"} if tags is None else {3: "tissue_left", 7: "tissue_right"}
    sizes = [336, 48] if tags is None else [192, 192]
    for program, found in seen(mesh, name, tmp_path):
        if found.region is None:  # sets alone
            assert {called: len(found.sets[called]) for called in names.values()} == dict(
                zip(names.values(), sizes, strict=True)
            )
        else:
            numbers, count = np.unique(found.region, return_counts=True)
            assert numbers.tolist() == list(names) and count.tolist() == sizes, program
            assert found.names in ({}, names), program
            inside = (np.abs(found.points[found.cells].mean(axis=1) - 4) < 2).all(axis=1)
            if tags is None:
                assert np.array_equal(found.region == 2, inside), program
        if name not in ("braingrowth", "nastran", "abaqus"):  # these have no fields, or have them in a file beside it
            assert np.abs(found.fields["linear"] - linear(found.points)).max() < 1e-5, program


def test_the_table_is_printed(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["read_back.py"])
    main()
    rows = capsys.readouterr().out.splitlines()
    assert {row.split()[0] for row in rows[1:]} == FORMATS.keys()
    assert sum("1 cortex, 2 white" in row for row in rows) >= 9


def test_the_sidecar_and_the_file_have_the_table(tmp_path: Path) -> None:
    for name in ("vtu", "vtk", "nastran", "carp", "abaqus", "fenics"):
        path = tmp_path / f"m{FORMATS[name].suffix}"
        export(model(), path, solver=name, certificate=CERTIFIED)
        record = json.loads(path.with_name(f"{path.name}.json").read_text())
        assert record["regions"] == {"cortex": 1, "white": 2}
        assert record["surface"] == {"cortical_surface": 101, "white_interface": 112}
    assert pyvista.read(tmp_path / "m.vtu").field_data["white"].tolist() == [2, 3]
    assert pyvista.read(tmp_path / "m.vtk").field_data["white_interface"].tolist() == [112, 2]
    assert meshio.read(tmp_path / "m_facets.xdmf").field_data["white_interface"].tolist() == [112, 2]
    assert (tmp_path / "m.regions.tsv").read_text() == "tag\tname\n1\tcortex\n2\twhite\n"
    assert "$ property 2: white\n$ property 101: cortical_surface" in (tmp_path / "m.bdf").read_text()
    assert "** region 1: cortex\n** region 2: white\n" in (tmp_path / "m.inp").read_text()


def test_no_element_of_a_gmsh_file_is_in_two_groups_and_no_number_means_two(tmp_path: Path) -> None:
    """dolfinx makes an element of each member of each group (`gmshio.extract_topology_and_markers`)."""
    mesh = model()
    msh.write(mesh, tmp_path / "m.msh")
    with msh.session():
        gmsh.open(str(tmp_path / "m.msh"))
        groups = gmsh.model.getPhysicalGroups()
        elements: dict[int, list[int]] = {2: [], 3: []}
        for dimension, number in groups:
            for entity in gmsh.model.getEntitiesForPhysicalGroup(dimension, number):
                elements[dimension] += gmsh.model.mesh.getElements(dimension, entity)[1][0].tolist()
    numbers = [number for _, number in groups]
    assert len(set(numbers)) == len(numbers) == 4
    assert len(set(elements[3])) == len(elements[3]) == len(mesh.cells)
    assert (
        len(set(elements[2])) == len(elements[2]) == len(boundary_faces(mesh)) + len(mesh.sets.faces["white_interface"])
    )


def test_regions_beyond_99_and_labels_of_0_have_numbers_of_their_own() -> None:
    mesh = model()
    labels = np.where(mesh.cell_data["tissue"] == 3, 0, 1035).astype(np.int32)
    tagged = named_sets(
        replace(mesh, cell_data={REGION: mesh.cell_data[REGION], "parc": labels}),
        inner=["white"],
        tissues=["parc"],
        tags="parc",
    )
    assert regions(tagged) == {"parc_1035": 1035, "parc_0": 1036}
    assert face_tags(tagged) == {"cortical_surface": 10001, "white_interface": 10010 + 1037}
    with pytest.raises(InputError, match="the tetrahedra have no labels missing"):
        named_sets(mesh, inner=["white"], tags="missing")


def test_region_is_kept_where_no_names_are_known(tmp_path: Path) -> None:
    """A mesh of another program, with numbers from 0."""
    cube = surface_nodes_first(cube_mesh(2))[0]
    number = np.arange(len(cube.cells), dtype=np.int32) % 3
    vtu.write(replace(cube, cell_data={REGION: number}), tmp_path / "m.vtu")
    told = convert(tmp_path / "m.vtu", tmp_path / "m.bdf", source_unit="mm")
    assert "regions are numbered from 1: 1 more than in the file" in told
    back = nastran.read(tmp_path / "m.bdf")
    assert np.array_equal(region_numbers(back), number + 1)
    assert regions(back) == {"region_1": 1, "region_2": 2, "region_3": 3}


@pytest.mark.parametrize("name", ["vtu", "vtk", "gmsh", "abaqus", "fenics", "stl", "gifti"])
def test_a_difference_that_another_program_sees_is_named(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, read = next(reversed(others.READERS[name].items()))

    def turned(path: Path) -> others.Seen:
        found = read(path)
        return replace(found, points=found.points[::-1])

    monkeypatch.setitem(others.READERS, name, {program: turned})
    with pytest.raises(StageError, match=f"{program} reads other (nodes|triangles)"):
        export(model(), tmp_path / f"m{FORMATS[name].suffix}", solver=name, certificate=CERTIFIED)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("what", ["points", "cells", "linear", "region", "white"])
def test_a_file_that_holds_another_mesh_is_refused(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def other(mesh: TetMesh, path: Path) -> None:
        if what == "points":
            mesh = replace(mesh, points=mesh.points * 1.001)
        elif what == "cells":
            mesh = replace(mesh, cells=mesh.cells[::-1], cell_data={}, sets=replace(mesh.sets, cells={}))
        elif what == "linear":
            mesh = replace(mesh, point_data={"linear": mesh.point_data["linear"][::-1]})
        elif what == "region":
            mesh = replace(mesh, cell_data={REGION: 3 - mesh.cell_data[REGION]})
        else:
            mesh = replace(
                mesh, sets=replace(mesh.sets, cells={**mesh.sets.cells, "white": mesh.sets.cells["cortex"][:9]})
            )
        vtu_write(mesh, path)

    vtu_write = vtu.write
    monkeypatch.setattr(vtu, "write", other)
    with pytest.raises(StageError, match="not (those|that) of the mesh"):
        export(model(), tmp_path / "m.vtu", solver="vtu", certificate=CERTIFIED)


def slit(gap: float) -> TetMesh:
    """A cube with a slit whose two banks are `gap` apart, turned so that no coordinate is a whole number; mm."""
    cube = cube_mesh(6, side=6.0)
    x, _, z = cube.points[cube.cells].mean(axis=1).T
    points, cells, _ = compact(cube.points, cube.cells[~((x > 2) & (x < 3) & (z > 2))])
    moved = points.copy()
    moved[(points[:, 2] > 2.01) & (np.abs(points[:, 0] - 3) < 1e-9), 0] = 2 + gap
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    return surface_nodes_first(TetMesh(moved @ (turn * np.linalg.det(turn)).T + [30.1, 40.7, 10.3], cells))[0]


@pytest.mark.parametrize("suffix", [".mesh", ".bdf", ".bpts", ".stl", ".surf.gii"])
def test_banks_that_cross_once_they_are_rounded_are_refused(suffix: str, tmp_path: Path) -> None:
    vtu.write(slit(1e-9), tmp_path / "m.vtu")
    with pytest.raises(StageError, match="triangles cross others with the coordinates of the file"):
        convert(tmp_path / "m.vtu", tmp_path / f"n{suffix}", source_unit="mm")
    vtu.write(slit(1e-3), tmp_path / "m.vtu")
    convert(tmp_path / "m.vtu", tmp_path / f"n{suffix}", source_unit="mm")


def test_ten_nodes_for_gmsh_have_each_triangle_once_and_the_names_of_regions(tmp_path: Path) -> None:
    mesh = model()
    parcels = {"half": np.where(mesh.points[:, 1] < 4, 1, 2).astype(np.int32)}
    mesh = named_sets(replace(mesh, point_data=parcels), inner=["white"], tissues=["tissue"])
    curved = quadratic(mesh, boundary_surface(mesh)[0])
    told = write_ten_nodes(mesh, curved, tmp_path / "m.msh")
    found = meshio.read(tmp_path / "m.msh")
    corners = np.concatenate([block.data[:, :3] for block in found.cells if block.type == "triangle6"])
    assert len(np.unique(np.sort(corners, axis=1), axis=0)) == len(corners)
    assert {name: tag.tolist() for name, tag in found.field_data.items()} == {
        "cortex": [1, 3],
        "white": [2, 3],
        "cortical_surface": [101, 2],
        "white_interface": [112, 2],
    }
    assert any("half_1, half_2" in words for words in told) and any("tissue_3, tissue_7" in words for words in told)


@pytest.mark.parametrize("strange", [7, 0, -1, 2**31 - 1, np.nan, 1.5])
def test_a_region_that_no_surface_bounds_is_refused(strange: float) -> None:
    mesh = model()
    inner = np.flatnonzero(mesh.cell_data[REGION] == 2)
    within = boundary_surface(TetMesh(*compact(mesh.points, mesh.cells[inner])[:2]))[0]
    surface = replace(boundary_surface(mesh)[0], inner={"white": within})
    mesh = TetMesh(mesh.points, mesh.cells, cell_data={REGION: mesh.cell_data[REGION]})
    assert [one.number for one in certify(mesh, surface).regions] == [1, 2]
    region = mesh.cell_data[REGION].astype(float)
    region[:5] = strange
    with pytest.raises(
        InputError, match=r"5 tetrahedra are in the region .*which no surface bounds.*1 cortex, 2 white"
    ):
        certify(replace(mesh, cell_data={REGION: region}), surface)
    for other in (mesh.cell_data[REGION][:, None], mesh.cell_data[REGION].astype(str)):
        with pytest.raises(InputError, match=r"regions .*are not numbers, one for each tetrahedron.*1 cortex, 2 white"):
            certify(replace(mesh, cell_data={REGION: other}), surface)


@pytest.mark.parametrize("suffix", [".pts", ".v2.msh", ".msh", ".bdf"])
def test_labels_that_a_file_cannot_hold_beside_its_regions_are_said_and_may_take_their_place(
    suffix: str, tmp_path: Path
) -> None:
    export(model(), tmp_path / "m.vtu", solver="vtu", certificate=CERTIFIED)
    told = convert(tmp_path / "m.vtu", tmp_path / f"m{suffix}", source_unit="mm")
    assert "left out, as an element has one number, and is in one set: tissue_left, tissue_right" in told
    assert "`cortet convert --tags tissue` writes labels of tissue in place of the regions" in told
    command = ["convert", str(tmp_path / "m.vtu"), str(tmp_path / f"n{suffix}"), "--tags", "tissue"]
    assert cortet_command(command) == 0
    back = format_of(tmp_path / f"n{suffix}").read(tmp_path / f"n{suffix}")
    assert regions(back) == {"tissue_left": 3, "tissue_right": 7}


@pytest.mark.parametrize("name", ["m.vtu.json", "m.meshed.surf.gii", "m.certificate.json", "m.vtu"])
def test_a_page_does_not_take_the_name_of_what_the_command_makes(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_surface(ball_surface(3, radius=10.0), tmp_path / "s.surf.gii")
    command = ["mesh", str(tmp_path / "s.surf.gii"), "--cell-size", "4", "-o", str(tmp_path / "m.vtu")]
    assert cortet_command([*command, "--page", str(tmp_path / name)]) == 1
    assert "another" in (said := capsys.readouterr().err) or "twice" in said
    assert sorted(file.name for file in tmp_path.iterdir()) == ["s.surf.gii"]


@pytest.mark.parametrize("name", VOLUMES)
def test_a_region_keeps_its_number_where_a_hole_leaves_one_out(name: str, tmp_path: Path) -> None:
    """As of cortex 1 and ventricle 3 without the white matter 2."""
    mesh = model()
    mesh = replace(mesh, cell_data={REGION: np.where(mesh.cell_data[REGION] == 2, 3, 1).astype(np.int32)})
    path = tmp_path / f"m{FORMATS[name].suffix}"
    export(mesh, path, solver=name, certificate=CERTIFIED)
    back = FORMATS[name].read(path)
    assert np.array_equal(back.cell_data[REGION], mesh.cell_data[REGION])
    if name != "braingrowth":
        assert regions(back) == {"cortex": 1, "white": 3}


def test_python_has_the_same_numbers_and_names(tmp_path: Path) -> None:
    balls = [ball_surface(3, radius=radius) for radius in (10.0, 7.0)]
    made = cortet.mesh(balls[0], 2.0, inner={"white": balls[1]}, progress=False)
    assert made.regions == {"cortex": 1, "white": 2}
    record = {one.name: one.number for one in made.certificate.regions}
    back = meshio.read(made.save(tmp_path / "m.vtu"))
    in_file = {name: int(tag[0]) for name, tag in back.field_data.items() if tag[1] == 3}
    assert made.regions == record == in_file
    assert np.array_equal(back.cell_data["region"][0], made.named().cell_data[REGION])
    far = np.linalg.norm(made.points[made.cells].mean(axis=1), axis=1)
    assert np.array_equal(made.mesh.cell_data[REGION] == 1, far > 6.9)
    alone = cortet.mesh(balls[0], 2.5, progress=False)
    assert alone.regions == {"cortex": 1, "core": 2}


def test_the_number_after_the_largest_byte_does_not_wrap(tmp_path: Path) -> None:
    mesh, half = model(), np.arange(384) < 192
    vtu.write(replace(mesh, cell_data={"tissue": np.where(half, 0, 255).astype(np.uint8)}), tmp_path / "in.vtu")
    convert(tmp_path / "in.vtu", tmp_path / "out.bdf", tags="tissue", source_unit="mm")
    assert regions(nastran.read(tmp_path / "out.bdf")) == {"tissue_255": 255, "tissue_0": 256}


def test_a_region_whose_number_no_format_holds_is_refused(tmp_path: Path) -> None:
    mesh = model()
    for number in (10**7, -(10**7), 2**31 - 1):
        region = np.where(np.arange(384) < 192, number, 1)
        with pytest.raises(InputError, match=f"in the region {number}, which has more than seven digits"):
            region_numbers(replace(mesh, cell_data={REGION: region}))
    largest = replace(mesh, cell_data={"tissue": np.where(np.arange(384) < 192, 10**7 - 2, 1)})
    export(tagged(largest, "tissue"), tmp_path / "m.bdf", solver="nastran", certificate=CERTIFIED)
    assert np.unique(nastran.read(tmp_path / "m.bdf").cell_data[REGION]).tolist() == [1, 10**7 - 2]


@pytest.mark.parametrize("name", [name for name in VOLUMES if name != "braingrowth"])
def test_a_region_may_be_called_tissue(name: str, tmp_path: Path) -> None:
    mesh = named_sets(replace(model(), sets=MeshSets()), inner=["tissue"])
    export(mesh, path := tmp_path / f"m{FORMATS[name].suffix}", solver=name, certificate=CERTIFIED)
    assert regions(FORMATS[name].read(path)) == {"cortex": 1, "tissue": 2}


@pytest.mark.parametrize(
    ("name", "plain"),
    [("abaqus", "weisse_Substanz"), ("nastran", "weisse, Substanz"), ("carp", "weisse, Substanz")],
)
def test_names_that_a_format_cannot_hold_are_said(name: str, plain: str, tmp_path: Path) -> None:
    mesh, called = model(), "weiße, Substanz"
    cells = {called if one == "white" else one: part for one, part in mesh.sets.cells.items()}
    vtu.write(replace(mesh, sets=replace(mesh.sets, cells=cells)), tmp_path / "in.vtu")
    told = convert(tmp_path / "in.vtu", out := tmp_path / f"out{FORMATS[name].suffix}", source_unit="mm")
    assert f"{called} is called {plain}" in told
    assert regions(FORMATS[name].read(out)) == {"cortex": 1, plain: 2}


@pytest.mark.parametrize("name", ["gmsh", "gmsh_v2"])
def test_a_name_with_quotation_marks_does_not_end_at_them(name: str, tmp_path: Path) -> None:
    mesh = model()
    cells = {'a "b" c' if one == "white" else one: part for one, part in mesh.sets.cells.items()}
    mesh = replace(mesh, sets=replace(mesh.sets, cells=cells))
    export(mesh, path := tmp_path / f"m{FORMATS[name].suffix}", solver=name, certificate=CERTIFIED)
    assert regions(FORMATS[name].read(path)) == {"cortex": 1, "a 'b' c": 2}


def test_a_field_does_not_take_the_name_of_a_component(tmp_path: Path) -> None:
    mesh = model()
    two = {"two": np.column_stack([mesh.points[:, 0], mesh.points[:, 1]]), "two_1": mesh.points[:, 2]}
    with pytest.raises(InputError, match="field two would be written as two_1, two_2, and there is a field two_1"):
        export(replace(mesh, point_data=two), tmp_path / "m.msh", solver="gmsh", certificate=CERTIFIED)


@pytest.mark.parametrize("name", [name for name in VOLUMES if name not in ("nastran", "braingrowth")])
def test_a_field_may_be_one_column(name: str, tmp_path: Path) -> None:
    mesh = model()
    column = replace(mesh, point_data={"linear": mesh.point_data["linear"][:, None]})
    export(column, path := tmp_path / f"m{FORMATS[name].suffix}", solver=name, certificate=CERTIFIED)
    found = FORMATS[name].read(path).point_data["linear"].ravel()
    assert np.allclose(found, mesh.point_data["linear"], rtol=1e-9)


@pytest.mark.parametrize("name", ["vtu", "vtk", "carp"])
def test_surface_groups_of_another_program_are_kept_beside_the_whole_surface(name: str, tmp_path: Path) -> None:
    mesh = model()
    group = mesh.sets.faces["cortical_surface"][:10]
    vtu.write(replace(mesh, sets=MeshSets(faces={"inlet": group}, cells=mesh.sets.cells)), tmp_path / "in.vtu")
    convert(tmp_path / "in.vtu", path := tmp_path / f"m{FORMATS[name].suffix}", source_unit="mm")
    faces = FORMATS[name].read(path).sets.faces
    assert len(faces["cortical_surface"]) == 192 and len(faces["inlet"]) == 10


@pytest.mark.parametrize("sidecar", [True, False])
@pytest.mark.parametrize(
    ("inner", "now"),
    [(["white", "ventricle"], {"cortex": 1, "white": 2, "ventricle": 3}), (["white"], {"cortex": 1, "core": 2})],
)
def test_a_file_of_an_earlier_cortet_is_numbered_as_today(
    inner: list[str], now: dict[str, int], sidecar: bool, tmp_path: Path
) -> None:
    mesh = model()
    centre = mesh.points[mesh.cells].mean(axis=1)
    octant = ((centre > 4) & (centre < 6)).all(axis=1)
    right = mesh.cell_data[REGION] + (octant if len(inner) == 2 else 0)
    mesh = named_sets(replace(mesh, sets=MeshSets(), cell_data={REGION: right.astype(np.int32)}), inner=inner)
    cells = {name: mesh.sets.cells[name] for name in ("core", "cortex", *inner)}
    if len(inner) == 1:
        del cells["white"]  # it was the core
    old = replace(mesh, sets=replace(mesh.sets, cells=cells), cell_data={REGION: np.where(right == 1, 2, 1)})
    vtu.write(old, tmp_path / "old.vtu")
    if sidecar:
        export(old, tmp_path / "old.vtu", solver="vtu", certificate=CERTIFIED)
        record = json.loads((tmp_path / "old.vtu.json").read_text())
        del record["regions"], record["surface"]
        (tmp_path / "old.vtu.json").write_text(json.dumps(record))
    told = convert(tmp_path / "old.vtu", tmp_path / "new.feb", source_unit="mm")
    assert told[0].startswith(
        "regions were numbered as by an earlier cortet, 1 core, 2 cortex; now they are 1 cortex, 2 "
    )
    back = FORMATS["febio"].read(tmp_path / "new.feb")
    assert regions(back) == now and np.array_equal(region_numbers(back), right)


def test_a_companion_that_was_edited_is_said(tmp_path: Path) -> None:
    export(model(), path := tmp_path / "m.pts", solver="carp", certificate=CERTIFIED)
    assert not any("was changed" in line for line in convert(path, tmp_path / "before.vtu"))
    (tmp_path / "m.regions.tsv").write_text("tag\tname\n1\twhite\n2\tcortex\n")
    assert convert(path, tmp_path / "after.vtu")[0].startswith("m.pts was changed after cortet wrote it")


@pytest.mark.parametrize("name", [*FORMATS])
def test_a_field_of_any_numbers_is_written_or_refused_by_name(name: str, tmp_path: Path) -> None:
    mesh, path = model(), tmp_path / f"m{FORMATS[name].suffix}"
    n = len(mesh.points)
    fields = {"flag": np.arange(n) % 2 == 0, "half": (np.arange(n) / 8).astype(np.float16)}
    fields |= {"tensor": mesh.points[:, :, None] * mesh.points[:, None, :], "long": np.arange(n).astype(np.longdouble)}
    export(replace(mesh, point_data=fields), path, solver=name, certificate=CERTIFIED)
    found = FORMATS[name].read(path).point_data
    columns = {"tensor": [f"tensor_{one}" for one in range(1, 10)]} if "tensor_1" in found else {}
    kept = compact(mesh.points, boundary_faces(mesh))[2] if FORMATS[name].is_surface else np.arange(n)
    for field, values in fields.items() if found else ():
        read = np.column_stack([found[one] for one in columns.get(field, [field])])
        assert np.allclose(read.reshape(len(kept), -1), values[kept].reshape(len(kept), -1).astype(float), rtol=1e-6)
    for wrong in (np.full(n, 1j), np.full(n, "x"), np.empty((n, 0))):
        with pytest.raises(InputError, match=rf"the field wave has the shape .* and the type {wrong.dtype}, .*\(give "):
            export(replace(mesh, point_data={"wave": wrong}), path, solver=name, certificate=CERTIFIED)


def test_a_label_beyond_32_bits_is_refused_before_it_is_written(tmp_path: Path) -> None:
    large = replace(model(), point_data={"label": np.full(len(model().points), 2**33)})
    with pytest.raises(InputError, match="field `label` has the label 8589934592, and labels have at most 32 bits"):
        export(large, tmp_path / "m.inp", solver="abaqus", certificate=CERTIFIED)


@pytest.mark.parametrize("name", VOLUMES)
@pytest.mark.parametrize("called", ["a/b", "a\tb", "x" * 81, "a\nb", "..", "", "a.b"])
def test_a_name_of_any_letters_is_kept_or_its_change_is_said(name: str, called: str, tmp_path: Path) -> None:
    mesh, path = model(), tmp_path / f"m{FORMATS[name].suffix}"
    some = np.arange(5, dtype=np.int32)
    cells = {called if one == "white" else one: part for one, part in mesh.sets.cells.items()}
    sets = replace(mesh.sets, nodes={called: some}, cells=cells)
    told = export(replace(mesh, sets=sets), path, solver=name, certificate=CERTIFIED)
    back = FORMATS[name].read(path)
    now = next((line.removeprefix(f"{called} is called ") for line in told if "is called" in line), called)
    assert now in regions(back) or name == "braingrowth"  # which has no names
    assert now in back.sets.nodes or any(
        line.startswith("left out, as the format has no sets of nodes") for line in told
    )


@pytest.mark.parametrize("number", [150, 2035])
def test_febio_has_labels_above_100_by_their_number(number: int, tmp_path: Path) -> None:
    mesh = model()
    region = np.where(mesh.cell_data[REGION] == 2, number, 1).astype(np.int32)
    numbered = replace(mesh, cell_data={REGION: region})
    export(numbered, tmp_path / "m.feb", solver="febio", certificate=CERTIFIED)
    assert regions(FORMATS["febio"].read(tmp_path / "m.feb")) == {"cortex": 1, "white": number}
    with pytest.raises(InputError, match=r"the region white has the number 3001, .*\(number the regions from 1 to at"):
        export(
            replace(mesh, cell_data={REGION: np.where(region == 1, 1, 3001)}),
            tmp_path / "n.feb",
            solver="febio",
            certificate=CERTIFIED,
        )


@pytest.mark.parametrize("name", ["vtu", "carp", "gmsh"])
def test_a_number_means_the_region_of_today_in_a_file_of_an_earlier_cortet(name: str, tmp_path: Path) -> None:
    """It numbered the cortex 0 and the white matter 1 between stages, and the core 1 and the cortex 2 in exports."""
    mesh, path = model(), tmp_path / f"m{FORMATS[name].suffix}"
    white = mesh.cell_data[REGION] == 2
    if name == "vtu":
        vtu.write(TetMesh(mesh.points, mesh.cells, cell_data={REGION: np.where(white, 1, 0)}), path)
    else:
        cells = {"core": np.flatnonzero(white).astype(np.int32), "cortex": mesh.sets.cells["cortex"]}
        old = replace(mesh, cell_data={REGION: np.where(white, 1, 2)}, sets=replace(mesh.sets, cells=cells))
        export(old, path, solver=name, certificate=CERTIFIED)
        (tmp_path / "m.regions.tsv").unlink(missing_ok=True)
        record = json.loads((tmp_path / f"{path.name}.json").read_text())
        del record["regions"], record["surface"]
        (tmp_path / f"{path.name}.json").write_text(json.dumps(record))
    for read in (tetrahedra, read_mesh):
        settings = Settings(gestational_age=28.0, region_stiffness={2: 5.0})
        moduli = stiffness_of(read(path), settings)
        assert np.array_equal(moduli > moduli.min(), white)


@pytest.mark.parametrize(
    ("what", "said"), [("renamed", True), ("renamed and edited", True), ("deleted", True), ("as it was", False)]
)
def test_an_export_that_lost_a_companion_or_was_edited_under_another_name_is_said(
    what: str, said: bool, tmp_path: Path
) -> None:
    export(model(), path := tmp_path / "m.pts", solver="carp", certificate=CERTIFIED)
    if what == "deleted":
        (tmp_path / "m.regions.tsv").unlink()
    if "renamed" in what:
        export(model(), path := tmp_path / "m.vtk", solver="vtk", certificate=CERTIFIED)
        (tmp_path / "m.vtk.json").rename(tmp_path / "n.vtk.json")
        path = path.rename(tmp_path / "n.vtk")
        assert not changed_since(path)
        edited = FORMATS["vtk"].read(path)
        FORMATS["vtk"].write(replace(edited, points=edited.points + 1), path)
    assert changed_since(path) == said
    told = convert(path, tmp_path / "o.vtu")
    assert told[:1] == [f"{path.name} was {CHANGED}"] if said else not any(CHANGED in line for line in told)


@pytest.mark.parametrize(
    ("name", "file", "before", "after"),
    [
        ("carp", "m.regions.tsv", "white", "cortex"),
        ("nastran", "m.bdf", "property 2: white", "property 2: cortex"),
        ("fenics", "m.xdmf", 'key="white"', 'key="cortex"'),
    ],
)
def test_a_table_that_calls_two_numbers_by_one_name_is_refused(
    name: str, file: str, before: str, after: str, tmp_path: Path
) -> None:
    export(model(), path := tmp_path / f"m{FORMATS[name].suffix}", solver=name, certificate=CERTIFIED)
    text = (tmp_path / file).read_text()
    assert before in text
    (tmp_path / file).write_text(text.replace(before, after))
    with pytest.raises(InputError, match=r"calls 1 and 2 cortex \(give each number a name of its own\)"):
        FORMATS[name].read(path)


@pytest.mark.parametrize("suffix", [".vtu", ".xdmf", ".inp"])
def test_ten_nodes_have_the_table_of_names_beside_them(suffix: str, tmp_path: Path) -> None:
    mesh = model()
    write_ten_nodes(mesh, quadratic(mesh, boundary_surface(mesh)[0]), tmp_path / f"m{suffix}")
    record = json.loads((tmp_path / "m.quadratic.json").read_text())
    assert record["regions"] == {"cortex": 1, "white": 2} and record["surface"]["white_interface"] == 112


def test_names_that_braingrowth_cannot_hold_are_in_its_sidecar_and_come_back(tmp_path: Path) -> None:
    mesh = model()
    export(mesh, tmp_path / "x.mesh", solver="braingrowth", certificate=CERTIFIED)
    names = json.loads((tmp_path / "x.mesh.json").read_text())["regions"]
    assert names == regions(mesh) and not any(name.startswith("region_") for name in names)
    assert regions(read_mesh(tmp_path / "x.mesh")) == names
