"""Every format as its users' programs read it: nodes, elements, volumes, fields and groups of what was written."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import gmsh
import h5py
import meshio
import numpy as np
import pytest
import pyvista
from cubes import cube_mesh
from exported import full_mesh
from read_back import READERS, by_gmsh, by_meshio, model
from shapes import ball_mesh

from cortet.errors import InputError
from cortet.formats import FORMATS, braingrowth, carp, fenics, format_of, msh, read_mesh, vtu
from cortet.formats.gifti import read_surface
from cortet.formats.tags import face_tags, regions
from cortet.geometry.topology import boundary_faces, boundary_surface, enclosed_volume
from cortet.measure.quality import signed_volumes
from cortet.meshes import REGION, CoordinateFrame, MeshSets, TetMesh
from cortet.solver_files.export import export
from cortet.solver_files.sets import named_sets
from cortet.stages.solver_ready import surface_nodes_first

SOLIDS = [name for name, form in FORMATS.items() if not form.is_surface]
SURFACES = [name for name, form in FORMATS.items() if form.is_surface]
#: formats that cortet reads
READ = ["vtu", "abaqus", "fenics", "gmsh", "nastran", "carp"]
#: sets of faces that divide the surface, or bound a region
PARTS = {"cortical_surface", "medial_wall", "white_interface", "tissue_interface"}
TETRAHEDRON = TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 1, 2, 3]])


def with_hole() -> TetMesh:
    """As of cortex 1 and ventricle 3 without the white matter 2."""
    return replace(model(), cell_data={REGION: np.where(model().cell_data[REGION] == 2, 3, 1).astype(np.int32)})


#: everything that an export can hold, and what may go wrong with the numbers and names of regions
MESHES: dict[str, Callable[[], TetMesh]] = {
    "full": full_mesh,
    "two regions": model,
    "labels in place of regions": lambda: model("tissue"),
    "a number left out": with_hole,
    "a region called tissue": lambda: named_sets(replace(model(), sets=MeshSets()), inner=["tissue"]),
    "neither sets nor fields": lambda: surface_nodes_first(cube_mesh(2, side=2.0, jitter=0.2))[0],
}


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return full_mesh()


def written(mesh: TetMesh, folder: Path, name: str) -> Path:
    path = folder / f"hemi-L_res-0.6mm{FORMATS[name].suffix}"
    FORMATS[name].write(mesh, path)
    return path


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("case", MESHES)
def test_every_program_finds_the_mesh(case, name, tmp_path):
    """Nodes, tetrahedra, their regions by number and name, sets, and fields on the right nodes; cortet does, too."""
    mesh = MESHES[case]()
    path = written(mesh, tmp_path, name)
    for program, read in READERS[name].items():
        found = read(path)
        mirrored = [1, 0, 2] if name == "braingrowth" else [0, 1, 2]
        points = np.asarray(found.points, float)[:, mirrored]
        assert np.allclose(points, mesh.points, rtol=0, atol=1e-9 * np.abs(mesh.points).max()), program
        order, given = (np.lexsort(cells.T) for cells in (found.cells, mesh.cells))
        assert np.array_equal(found.cells[order], mesh.cells[given]), program
        if name == "braingrowth":  # whose loader sees negative volumes
            assert signed_volumes(found.points, found.cells.astype(np.int32)).max() < 0
        if found.region is not None and REGION in mesh.cell_data:
            assert np.array_equal(found.region[order], mesh.cell_data[REGION][given]), program
            assert found.names in ({}, {number: called for called, number in regions(mesh).items()}), program
        for called, members in found.sets.items():
            assert np.array_equal(np.sort(members), mesh.sets.cells.get(called, np.arange(len(mesh.cells)))), called
        for field in mesh.point_data if "point_data" in FORMATS[name].holds and name != "abaqus" else ():
            assert np.allclose(found.fields[field], mesh.point_data[field], rtol=1e-11, atol=1e-11), (program, field)
    if name in READ and REGION in mesh.cell_data:
        found_by_cortet(mesh, path, name)


def found_by_cortet(mesh: TetMesh, path: Path, name: str) -> None:
    """cortet reads its own files with regions and parts of the surface."""
    back = read_mesh(path)
    assert np.allclose(back.points, mesh.points, rtol=0, atol=1e-8) and np.array_equal(back.cells, mesh.cells)
    assert regions(back) == regions(mesh) and np.array_equal(back.cell_data[REGION], mesh.cell_data[REGION])
    for called in regions(mesh):
        assert np.array_equal(np.sort(back.sets.cells[called]), np.sort(mesh.sets.cells[called]))
    for called in PARTS & mesh.sets.faces.keys():
        faces = mesh.sets.faces[called]
        if name in ("vtu", "fenics", "gmsh", "nastran"):
            assert {*map(frozenset, back.sets.faces[called].tolist())} == {*map(frozenset, faces.tolist())}
        if name in ("vtu", "fenics", "gmsh"):  # outward, too
            volume = enclosed_volume(mesh.points, faces)
            assert enclosed_volume(back.points, back.sets.faces[called]) == pytest.approx(volume)
        if name == "abaqus":
            assert np.array_equal(back.sets.nodes[called], np.unique(faces))
    for field, values in mesh.point_data.items() if name in ("vtu", "fenics") else ():
        assert np.array_equal(back.point_data[field], values)


@pytest.mark.parametrize("name", SURFACES)
def test_programs_find_the_boundary_and_its_frame(name, mesh, tmp_path):
    frame = CoordinateFrame("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_MNI_152", (2, 0, 0, 5, *np.eye(4).ravel()[4:]))
    path, (boundary, nodes) = tmp_path / f"m{FORMATS[name].suffix}", boundary_surface(mesh)
    FORMATS[name].write(mesh, path, frame=frame)
    for found in (read(path) for read in READERS[name].values()):
        assert np.allclose(found.points[found.cells], boundary.points[boundary.faces], atol=1e-5)
        if name == "gifti":
            assert np.allclose(found.fields["thickness"], mesh.point_data["thickness"][nodes])
            assert np.array_equal(found.fields["area"], mesh.point_data["area"][nodes])
            assert read_surface(path).frame == frame
    assert len(read_surface(path).points) == len(boundary.points) == nodes[-1] + 1


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_mesh_gives_the_same_bytes(name, mesh, tmp_path):
    for folder in ("first", "second"):
        written(mesh, tmp_path / folder, name)
    files = [sorted((tmp_path / folder).iterdir()) for folder in ("first", "second")]
    assert [file.name for file in files[0]] == [file.name for file in files[1]]
    assert all(one.read_bytes() == other.read_bytes() for one, other in zip(*files, strict=True))


@pytest.mark.parametrize(
    ("of", "name", "instead"),
    [
        *((format_of, name, instead) for name, instead in (("x.obj", ".vtu"), ("x.vtk", ".vtu"), ("x.bpts", ".pts"))),
        *((read_mesh, name, ".vtu") for name in ("x.feb", "x.mesh", "x")),
        *((read_mesh, "x.bpts", ".vtu"), (read_mesh, "x.stl", "mesh")),
    ],
)
def test_a_file_of_no_format_is_refused_with_what_to_use_instead(of, name, instead):
    assert format_of(Path("x.boundary.surf.gii")).name == "gifti" and format_of(Path("a.b.inp")).name == "abaqus"
    with pytest.raises(InputError, match=instead) as caught:
        of(Path(name))
    assert caught.value.file == Path(name)


# --- numbers and names of regions


def test_the_sidecar_and_the_file_have_the_table_of_regions(tmp_path):
    for name in ("vtu", "nastran", "carp", "abaqus", "fenics"):
        path = tmp_path / f"m{FORMATS[name].suffix}"
        export(model(), path, solver=name)
        record = json.loads(path.with_name(f"{path.name}.json").read_text())
        assert record["regions"] == {"cortex": 1, "white": 2}
        assert record["surface"] == {"cortical_surface": 101, "white_interface": 112}
    assert pyvista.read(tmp_path / "m.vtu").field_data["white"].tolist() == [2, 3]
    assert meshio.read(tmp_path / "m_facets.xdmf").field_data["white_interface"].tolist() == [112, 2]
    assert (tmp_path / "m.regions.tsv").read_text() == "tag\tname\n1\tcortex\n2\twhite\n"
    assert "$ property 2: white\n$ property 101: cortical_surface" in (tmp_path / "m.bdf").read_text()
    assert "** region 1: cortex\n** region 2: white\n" in (tmp_path / "m.inp").read_text()


def test_regions_beyond_99_and_labels_of_0_have_numbers_of_their_own():
    mesh = model()
    labels = np.where(mesh.cell_data["tissue"] == 3, 0, 1035).astype(np.int32)
    fields = {REGION: mesh.cell_data[REGION], "parc": labels}
    tagged = named_sets(replace(mesh, cell_data=fields), inner=["white"], tissues=["parc"], tags="parc")
    assert regions(tagged) == {"parc_1035": 1035, "parc_0": 1036}
    assert face_tags(tagged) == {"cortical_surface": 10001, "white_interface": 10010 + 1037}
    with pytest.raises(InputError, match="missing"):
        named_sets(mesh, inner=["white"], tags="missing")


def test_no_element_of_a_gmsh_file_is_in_two_groups_and_no_number_means_two(mesh, tmp_path):
    """dolfinx makes an element of each member of each group (`gmshio.extract_topology_and_markers`)."""
    gmsh.initialize(argv=[], readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(written(mesh, tmp_path, "gmsh")))
        groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
        entities = {name: gmsh.model.getEntitiesForPhysicalGroup(*group) for name, group in groups.items()}
        elements = {
            name: np.concatenate([gmsh.model.mesh.getElements(groups[name][0], one)[1][0] for one in some])
            for name, some in entities.items()
        }
        nodes, _ = gmsh.model.mesh.getNodesForPhysicalGroup(*groups["medial_wall"])
    finally:
        gmsh.finalize()
    numbers = {"cortical_surface": 101, "medial_wall": 102, "cortex": 1, "core": 2}
    assert {name: tag for name, (_, tag) in groups.items()} == numbers
    every = np.concatenate(list(elements.values()))
    assert len(np.unique(every)) == len(every) == len(mesh.cells) + len(boundary_faces(mesh))
    given = {**mesh.sets.faces, **mesh.sets.cells}
    assert {name: len(some) for name, some in elements.items()} == {name: len(given[name]) for name in numbers}
    assert np.array_equal(np.sort(nodes) - 1, mesh.sets.nodes["medial_wall"])
    cells = {'a "b" c': mesh.sets.cells["cortex"], "core": mesh.sets.cells["core"]}
    msh.write(replace(mesh, sets=replace(mesh.sets, cells=cells)), tmp_path / "quoted.msh")
    assert by_gmsh(tmp_path / "quoted.msh").names == {1: "a 'b' c", 2: "core"}


def test_the_facets_of_fenics_have_the_nodes_of_the_mesh_and_tags_first(tmp_path):
    mesh = model()
    path = written(mesh, tmp_path, "fenics")
    facets = meshio.read(fenics.facets_path(path))
    assert np.array_equal(by_meshio("xdmf", REGION)(path).points, facets.points)
    for tag, called in ((101, "cortical_surface"), (112, "white_interface")):
        found = facets.cells_dict["triangle"][facets.cell_data["surface"][0] == tag]
        assert {*map(frozenset, found.tolist())} == {*map(frozenset, mesh.sets.faces[called].tolist())}
    for file, name in ((path, REGION), (fenics.facets_path(path), "surface")):
        text = file.read_text()  # dolfinx reads the first attribute
        assert text.index(f'Attribute Name="{name}"') == text.index("Attribute Name=")
    with h5py.File(fenics.data_path(fenics.facets_path(path))) as file:
        assert len(file["facets/topology"]) == len(file["facets/surface"])


# --- text as the manuals say, bit for bit

#: file -> what a tetrahedron is in it
TEXTS = {
    "m.inp": """*HEADING|Tetrahedral mesh, coordinates in mm|*NODE, NSET=all_nodes|1, 0, 0, 0|2, 1, 0, 0|3, 0, 1, 0
4, 0, 0, 0.333333333333|*ELEMENT, TYPE=C3D4, ELSET=all_elements|1, 1, 2, 3, 4|*NSET, NSET=cortical_surface|1, 2, 3, 4
*SURFACE, TYPE=ELEMENT, NAME=cortical_surface|1, S3|1, S4|1, S2|1, S1""",
    "m_fields.inp": """** variable 1: age, component 1 of 1, real|*INITIAL CONDITIONS, TYPE=FIELD, VARIABLE=1|1, 1.5
2, 2|3, 3|4, 4""",
    "m.feb": """<?xml version="1.0" encoding="ISO-8859-1"?>|<febio_spec version="4.0">|<Module type="solid"/>|<Material>
<material id="1" name="tissue" type="neo-Hookean"><density>1</density><E>2.8125</E><v>0.40625</v></material>|</Material>
<Mesh>|<Nodes name="nodes">|<node id="1">0,0,0</node>|<node id="2">1,0,0</node>|<node id="3">0,1,0</node>
<node id="4">0,0,0.333333333333</node>|</Nodes>|<Elements type="tet4" name="tissue">|<elem id="1">1,2,3,4</elem>
</Elements>|<Surface name="cortical_surface">|<tri3 id="1">2,3,4</tri3>|<tri3 id="2">1,4,3</tri3>
<tri3 id="3">1,2,4</tri3>|<tri3 id="4">1,3,2</tri3>|</Surface>|<NodeSet name="all_nodes">1,2,3,4</NodeSet>
<NodeSet name="cortical_surface">1,2,3,4</NodeSet>|</Mesh>|<MeshDomains>|<SolidDomain name="tissue" mat="tissue"/>
</MeshDomains>|<MeshData>|<NodeData name="age" node_set="all_nodes" data_type="scalar">|<node lid="1">1.5</node>
<node lid="2">2</node>|<node lid="3">3</node>|<node lid="4">4</node>|</NodeData>|</MeshData>|</febio_spec>""",
    "m.pts": "4|0 0 0|1000 0 0|0 1000 0|0 0 333.33333333333331",
    "m.elem": "1|Tt 0 1 2 3 1",
    "m.lon": "1|1 0 0",
    "m.mesh": """4|0.000000000 0.000000000 0.000000000|1.000000000 0.000000000 0.000000000
0.000000000 1.000000000 0.000000000|0.000000000 0.000000000 0.333333333|1|1 1 2 4 3|4|101 2 3 4|101 1 4 3|101 1 2 4
101 1 3 2""",
}


def test_a_tetrahedron_is_written_as_the_manuals_say(tmp_path):
    tetrahedron = replace(TETRAHEDRON, point_data={"age": np.array([1.5, 2, 3, 4])})
    for name in ("abaqus", "febio", "carp", "braingrowth"):
        FORMATS[name].write(tetrahedron, tmp_path / f"m{FORMATS[name].suffix}")
    for name, text in TEXTS.items():
        assert (tmp_path / name).read_text().splitlines() == text.replace("|", "\n").splitlines(), name
    with pytest.raises(InputError, match="solver_ready"):
        braingrowth.write(cube_mesh(3), tmp_path / "other.mesh")
    assert not (tmp_path / "other.mesh").exists()


def test_coordinates_of_opencarp_come_back_bit_for_bit_in_mm_and_scaled_in_um(tmp_path):
    cube = cube_mesh(3, side=np.pi, jitter=0.2)
    mesh = TetMesh(cube.points, cube.cells, cell_data={REGION: np.arange(len(cube.cells), dtype=np.int32)})
    carp.write(mesh, tmp_path / "hemi-L_res-0.6mm.pts", unit="mm")
    back = carp.read(tmp_path / "hemi-L_res-0.6mm", unit="mm")
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cell_data[REGION], mesh.cell_data[REGION])
    carp.write(mesh, tmp_path / "m", unit="um")
    assert np.allclose(carp.read(tmp_path / "m", unit="um").points, mesh.points, rtol=1e-15)
    assert carp.read(tmp_path / "m", unit="mm").points.max() == pytest.approx(1000 * np.pi)


def test_every_array_of_a_vtu_file_comes_back_bit_for_bit(tmp_path):
    cube, random = cube_mesh(3), np.random.default_rng(1)
    n, m = len(cube.points), len(cube.cells)
    of_nodes = {"thickness": random.normal(size=n), "label": random.integers(-5, 9, n, dtype=np.int32)}
    of_nodes["two words"] = np.eye(n, 3)
    of_cells = {"fibre": random.normal(size=(m, 3)), "region": np.arange(m, dtype=np.uint8)}
    mesh = TetMesh(cube.points + 1e-13 * random.normal(size=(n, 3)), cube.cells, of_nodes, of_cells)
    vtu.write(mesh, tmp_path / "mesh.vtu")
    back = vtu.read(tmp_path / "mesh.vtu")
    assert np.array_equal(back.points, mesh.points) and np.array_equal(back.cells, mesh.cells)
    for before, after in [(mesh.point_data, back.point_data), (mesh.cell_data, back.cell_data)]:
        assert before.keys() == after.keys()
        for name, values in before.items():
            assert after[name].dtype == values.dtype and np.array_equal(after[name], values), name


def test_half_a_mesh_and_one_of_another_program_have_no_counts(tmp_path):
    """A mesh that was cut short with its old date stayed certified in the table; a folder ended the run."""
    file = tmp_path / "mesh.vtu"
    vtu.write(ball_mesh(1), file)
    mesh = vtu.read(file)
    assert vtu.counts(file) == (len(mesh.points), len(mesh.cells))
    file.write_bytes(file.read_bytes()[:-40])
    assert vtu.counts(file) is None
    file.write_bytes(b"")
    assert vtu.counts(file) is None
    with pytest.raises(InputError, match="cannot be read"):
        vtu.counts(tmp_path)
