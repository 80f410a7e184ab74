"""Only certified meshes are exported, only files that keep their solver's conventions; each says what it is."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from exported import full_mesh
from shapes import ball_mesh

from cortet.api.meshing import tetrahedra
from cortet.errors import InputError, StageError
from cortet.formats import FORMATS, carp, read_mesh, vtu
from cortet.formats.hashing import mesh_sha256
from cortet.geometry.topology import boundary_surface
from cortet.measure.quality import quality
from cortet.meshes import CoordinateFrame, MeshSets
from cortet.solver_files.export import convert, export, export_made
from cortet.solver_files.fields import FieldSource
from cortet.solver_files.meshed import Origin
from cortet.stages.solver_ready import surface_nodes_first


def test_an_uncertified_mesh_is_written_only_on_demand(tmp_path):
    mesh, path = surface_nodes_first(ball_mesh())[0], tmp_path / "ball.mesh"
    certificate = {"certified": False, "reasons": ["worst q 0.8 must be below 0.6"], "mesh_sha256": mesh_sha256(mesh)}
    known = {"certificate": certificate, "origin": Origin(), "sets": {}, "labels": {}}
    known |= {"arguments": {"solver": "braingrowth"}}
    with pytest.raises(StageError, match="worst q 0.8"):
        export_made(mesh, boundary_surface(mesh)[0], path, uncertified=False, **known)
    assert not list(tmp_path.iterdir())
    export_made(mesh, boundary_surface(mesh)[0], path, uncertified=True, **known)
    assert path.exists()


def test_the_sidecar_says_what_is_in_the_file_and_where_it_came_from(tmp_path):
    source = tmp_path / "thickness.shape.gii"
    source.write_bytes(b"values")
    sources = {
        "thickness": FieldSource(str(source), hashlib.sha256(b"values").hexdigest(), "mm", "scalar", {}),
        "area": FieldSource("area.label.gii", "0" * 64, "unknown", "label", {0: "Medial wall"}),
    }
    frame = CoordinateFrame("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_TALAIRACH")
    mesh, path = full_mesh(), tmp_path / "m.pts"
    export(mesh, path, solver="carp", unit="um", frame=frame, sources=sources)
    record = json.loads((tmp_path / "m.pts.json").read_text())
    assert record["format"] == "carp" and record["units"] == {"coordinates": "um"}
    assert record["coordinate_system"]["dataspace"] == "NIFTI_XFORM_SCANNER_ANAT"
    assert record["files"]["m.elem"] == hashlib.sha256((tmp_path / "m.elem").read_bytes()).hexdigest()
    assert set(record["files"]) == {file.name for file in tmp_path.iterdir()} - {"m.pts.json", source.name}
    assert record["volume_mm3"] == pytest.approx(8.0**3) and record["surface_area_mm2"] == pytest.approx(6 * 8.0**2)
    assert record["sets"]["nodes"]["medial_wall"] == len(mesh.sets.nodes["medial_wall"])
    assert record["sets"]["cells"].keys() == {"core", "cortex"}
    thickness = record["fields"]["thickness"]
    assert (thickness["source"], thickness["units"]) == (str(source), "mm")
    assert thickness["source_sha256"] == hashlib.sha256(b"values").hexdigest()
    assert record["fields"]["normal"]["units"] == "unknown" and record["fields"]["normal"]["components"] == 3


def test_an_export_replaces_all_files_of_an_earlier_one(tmp_path):
    path = tmp_path / "m.pts"
    export(full_mesh(), path, solver="carp")
    assert (tmp_path / "m.area_V1.vtx").exists() and (tmp_path / "m.thickness.dat").exists()
    export(surface_nodes_first(ball_mesh())[0], path, solver="carp")
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        "m.elem",
        "m.lon",
        "m.pts",
        "m.pts.json",
        "m.regions.tsv",
    ]


@pytest.mark.parametrize("solver", [name for name, form in FORMATS.items() if form.has_q])
def test_files_for_viewers_have_q_measured_anew(solver, tmp_path):
    mesh = full_mesh()
    vtu.write(replace(mesh, cell_data={**mesh.cell_data, "q": np.ones(len(mesh.cells))}), tmp_path / "m.vtu")
    file = tmp_path / f"n{FORMATS[solver].suffix}"
    convert(tmp_path / "m.vtu", file, source_unit="mm")
    assert np.array_equal(read_mesh(file).cell_data["q"], quality(mesh.points, mesh.cells).astype(np.float32))
    told = convert(file, tmp_path / "o.inp", source_unit="mm")
    assert not any("q" in re.split(", |: ", line) for line in told) and "q" not in tetrahedra(file).cell_data


@pytest.mark.parametrize("target", [name for name, form in FORMATS.items() if name != "vtu"])
def test_every_format_is_made_of_another_and_what_it_lacks_is_told(tmp_path, target):
    source = tmp_path / "m.xdmf"
    frame = CoordinateFrame("NIFTI_XFORM_SCANNER_ANAT")
    sources = {"thickness": FieldSource("thickness.shape.gii", "0" * 64, "mm", "scalar", {})}
    mesh = full_mesh()
    mesh = replace(mesh, cell_data={**mesh.cell_data, "stiffness": np.ones(len(mesh.cells))})
    export(mesh, source, solver="fenics", frame=frame, sources=sources)
    path = tmp_path / f"n{FORMATS[target].suffix}"
    lacking = {
        "braingrowth": ["fields of the nodes", "sets of tetrahedra", "stiffness"],
        "gmsh": ["sets of nodes", "area"],
        "nastran": ["fields of the nodes", "sets of nodes", "area", "stiffness"],
        "carp": ["area", "stiffness"],
        "abaqus": ["stiffness"],
        "febio": ["stiffness"],
    }.get(target, [])
    told = " ".join(convert(source, path, unit="mm", source_unit="mm"))
    assert all(what in told for what in lacking) and bool(told) == bool(lacking)
    record = json.loads(path.with_name(path.name + ".json").read_text())
    assert record["coordinate_system"]["dataspace"] == "NIFTI_XFORM_SCANNER_ANAT"
    assert record["units"] == {"coordinates": "mm"}
    if "thickness" in record["fields"]:
        assert record["fields"]["thickness"]["source"] == "thickness.shape.gii"


def test_a_node_that_no_tetrahedron_uses_does_not_count_in_the_size(tmp_path):
    ball = ball_mesh(2, radius=20.0)
    vtu.write(replace(ball, points=np.vstack([ball.points, [900.0, 0, 0]])), tmp_path / "m.vtu")
    with pytest.raises(InputError, match="1 node belongs to no tetrahedron"):
        convert(tmp_path / "m.vtu", tmp_path / "x.inp")


def test_a_file_without_sets_of_nodes_is_not_said_to_have_them(tmp_path):
    mesh = full_mesh()
    vtu.write(replace(mesh, sets=MeshSets({}, {}, mesh.sets.cells)), tmp_path / "m.vtu")
    told = convert(tmp_path / "m.vtu", tmp_path / "m.inp", source_unit="mm")
    assert told == ["cortet made sets of faces from its boundary"]


@pytest.mark.parametrize("faces", [True, False])
def test_sets_are_kept_on_the_way_to_another_format(tmp_path, faces):
    """Also of a VTU file that another program wrote: sets of nodes and tetrahedra, none of faces."""
    mesh = full_mesh()
    given = mesh if faces else replace(mesh, sets=MeshSets(mesh.sets.nodes, {}, mesh.sets.cells))
    vtu.write(given, tmp_path / "m.vtu")
    told = convert(tmp_path / "m.vtu", tmp_path / "m.inp", source_unit="mm")
    assert told == ([] if faces else ["cortet made sets of faces from its sets of nodes"])
    found = read_mesh(tmp_path / "m.inp").sets
    for name in mesh.sets.nodes.keys() - {"cortical_surface"}:  # without faces its rim is that of the medial wall
        assert np.array_equal(found.nodes[name], mesh.sets.nodes[name]), name
    for name, cells in mesh.sets.cells.items():
        assert np.array_equal(found.cells[name], cells)
    surfaces = re.findall(r"\*SURFACE, TYPE=ELEMENT, NAME=(\w+)", (tmp_path / "m.inp").read_text())
    assert set(surfaces) == {*mesh.sets.faces}


@pytest.mark.parametrize(("unit", "factor"), [("m", 1e-3), ("cm", 0.1), ("um", 1e3)])
def test_a_foreign_mesh_in_another_unit_is_refused_until_its_unit_is_named(tmp_path, unit, factor):
    ball = ball_mesh(2, radius=20.0)
    vtu.write(replace(ball, points=factor * ball.points), tmp_path / "foreign.vtu")
    with pytest.raises(InputError, match="foreign.vtu: .*--source-unit") as caught:
        convert(tmp_path / "foreign.vtu", tmp_path / "x.inp")
    assert f" {unit}" in caught.value.remedy
    convert(tmp_path / "foreign.vtu", tmp_path / "x.vtu", source_unit=unit)
    assert np.allclose(vtu.read(tmp_path / "x.vtu").points, ball.points, rtol=1e-6)


def test_a_carp_mesh_in_mm_without_a_sidecar_is_named_as_mm_and_no_other_unit_is_believed(tmp_path):
    """The unit of CARP is um: the remedy took the mm for that, and named m, which gave a mesh of 40 m."""
    carp.write(ball_mesh(2, radius=20.0), tmp_path / "b.pts", unit="mm")
    with pytest.raises(InputError) as caught:
        convert(tmp_path / "b.pts", tmp_path / "b.vtu")
    assert "in mm, add --source-unit mm" in caught.value.remedy
    with pytest.raises(InputError, match="4e.04 mm long.*source-unit mm"):
        convert(tmp_path / "b.pts", tmp_path / "b.vtu", source_unit="m")
    convert(tmp_path / "b.pts", tmp_path / "b.vtu", source_unit="mm")


def test_inverted_tetrahedra_of_a_foreign_mesh_are_those_of_the_input(tmp_path):
    ball = ball_mesh(2, radius=20.0)
    vtu.write(replace(ball, cells=ball.cells[:, [1, 0, 2, 3]]), tmp_path / "foreign.vtu")
    with pytest.raises(InputError, match="foreign.vtu: .*inverted.*cortet improve"):
        convert(tmp_path / "foreign.vtu", tmp_path / "x.inp")
