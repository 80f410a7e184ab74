"""Each format as other programs read it: regions by one number and name, elements, and fields on the right nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from read_back import READERS, model

from cortet.errors import InputError
from cortet.formats import FORMATS, read_mesh, vtu
from cortet.formats.tags import region_numbers, regions
from cortet.geometry.topology import boundary_faces, boundary_surface, compact
from cortet.measure.certify import certify
from cortet.meshes import REGION, TetMesh
from cortet.solver_files.export import convert, export
from cortet.solver_files.sets import tagged
from cortet.solver_files.sidecar import CHANGED, changed_since

#: formats that cortet reads
READ = ["vtu", "abaqus", "fenics", "gmsh", "nastran", "carp"]


@pytest.mark.parametrize("strange", [7, 0, -1, 2**31 - 1, np.nan, 1.5])
def test_a_region_that_no_surface_bounds_is_refused(strange):
    mesh = model()
    inner = np.flatnonzero(mesh.cell_data[REGION] == 2)
    within = boundary_surface(TetMesh(*compact(mesh.points, mesh.cells[inner])[:2]))[0]
    surface = replace(boundary_surface(mesh)[0], inner={"white": within})
    mesh = TetMesh(mesh.points, mesh.cells, cell_data={REGION: mesh.cell_data[REGION]})
    assert [one.number for one in certify(mesh, surface).regions] == [1, 2]
    region = mesh.cell_data[REGION].astype(float)
    region[:5] = strange
    for wrong in (region, mesh.cell_data[REGION][:, None], mesh.cell_data[REGION].astype(str)):
        with pytest.raises(InputError, match=r"1 cortex, 2 white"):
            certify(replace(mesh, cell_data={REGION: wrong}), surface)


def test_numbers_of_regions_do_not_wrap_and_those_that_no_format_holds_are_refused(tmp_path):
    mesh, half = model(), np.arange(384) < 192
    vtu.write(replace(mesh, cell_data={"tissue": np.where(half, 0, 255).astype(np.uint8)}), tmp_path / "in.vtu")
    convert(tmp_path / "in.vtu", tmp_path / "out.bdf", tags="tissue", source_unit="mm")
    assert regions(read_mesh(tmp_path / "out.bdf")) == {"tissue_255": 255, "tissue_0": 256}
    for number in (10**7, -(10**7), 2**31 - 1):
        with pytest.raises(InputError, match=f"{number}"):
            region_numbers(replace(mesh, cell_data={REGION: np.where(half, number, 1)}))
    largest = replace(mesh, cell_data={"tissue": np.where(half, 10**7 - 2, 1)})
    export(tagged(largest, "tissue"), tmp_path / "m.bdf", solver="nastran")
    assert np.unique(read_mesh(tmp_path / "m.bdf").cell_data[REGION]).tolist() == [1, 10**7 - 2]


@pytest.mark.parametrize("name", [*FORMATS])
def test_a_field_of_any_numbers_is_written_or_refused_by_name(name, tmp_path):
    mesh, path = model(), tmp_path / f"m{FORMATS[name].suffix}"
    n = len(mesh.points)
    fields = {"flag": np.arange(n) % 2 == 0, "half": (np.arange(n) / 8).astype(np.float16)}
    fields |= {"tensor": mesh.points[:, :, None] * mesh.points[:, None, :], "long": np.arange(n).astype(np.longdouble)}
    export(replace(mesh, point_data=fields), path, solver=name)
    kept = compact(mesh.points, boundary_faces(mesh))[2] if FORMATS[name].is_surface else np.arange(n)
    for found in (read(path).fields for read in READERS[name].values()):
        columns = {"tensor": [f"tensor_{one}" for one in range(1, 10)]} if "tensor_1" in found else {}
        for field, values in fields.items() if found else ():
            read = np.column_stack([found[one] for one in columns.get(field, [field])])
            whole = values[kept].reshape(len(kept), -1).astype(float)
            assert np.allclose(read.reshape(len(kept), -1), whole, rtol=1e-6)
    for wrong in (np.full(n, 1j), np.full(n, "x"), np.empty((n, 0))):
        with pytest.raises(InputError, match=rf"wave.*{wrong.dtype}"):
            export(replace(mesh, point_data={"wave": wrong}), path, solver=name)
    if name == "abaqus":
        with pytest.raises(InputError, match="label.*8589934592"):
            export(replace(mesh, point_data={"label": np.full(n, 2**33)}), path, solver=name)


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("called", ["a/b", "a\tb", "x" * 81, "a\nb", "..", "", "a.b", "weiße, Substanz"])
def test_a_name_of_any_letters_is_kept_or_its_change_is_said(name, called, tmp_path):
    mesh, path = model(), tmp_path / f"m{FORMATS[name].suffix}"
    some = np.arange(5, dtype=np.int32)
    cells = {called if one == "white" else one: part for one, part in mesh.sets.cells.items()}
    sets = replace(mesh.sets, nodes={called: some}, cells=cells)
    told = export(replace(mesh, sets=sets), path, solver=name)
    back = read_mesh(path)
    now = next((line.removeprefix(f"{called} was renamed to ") for line in told if "was renamed to" in line), called)
    assert now in regions(back)
    assert now in back.sets.nodes or "nodes" not in FORMATS[name].holds or name == "carp"


@pytest.mark.parametrize("what", ["edited", "deleted", "renamed and edited", "renamed", "as it was"])
def test_an_export_that_lost_a_companion_or_was_edited_is_said(what, tmp_path):
    export(model(), path := tmp_path / "m.pts", solver="carp")
    if what == "deleted":
        (tmp_path / "m.regions.tsv").unlink()
    if what == "edited":
        (tmp_path / "m.regions.tsv").write_text("tag\tname\n1\twhite\n2\tcortex\n")
    if "renamed" in what:
        export(model(), path := tmp_path / "m2.vtu", solver="vtu")
        (tmp_path / "m2.vtu.json").rename(tmp_path / "n.vtu.json")
        path = path.rename(tmp_path / "n.vtu")
    if what == "renamed and edited":
        edited = vtu.read(path)
        vtu.write(replace(edited, points=edited.points + 1), path)
    said = what not in ("renamed", "as it was")
    assert changed_since(path) == said
    told = convert(path, tmp_path / "o.vtu")
    assert told[:1] == [f"{path.name} was {CHANGED}"] if said else not any(CHANGED in line for line in told)
