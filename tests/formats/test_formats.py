"""Every format as its users' programs read it: nodes, elements, volumes, fields and groups of what was written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import gmsh
import h5py
import meshio
import numpy as np
import pytest
from cubes import cube_mesh
from exported import full_mesh
from read_back import READERS, by_gmsh, by_meshio, model

from cortet.config.stages import Generate
from cortet.errors import InputError
from cortet.formats import FORMATS, fenics, format_of, msh, read_mesh
from cortet.formats.gifti import read_surface
from cortet.formats.tags import regions
from cortet.geometry.topology import boundary_faces, boundary_surface, enclosed_volume
from cortet.measure.quality import signed_volumes
from cortet.meshes import REGION, CoordinateFrame, MeshSets, TetMesh
from cortet.solver_files.export import write
from cortet.solver_files.sets import named_sets
from cortet.stages.generate import generate
from cortet.stages.solver_ready import surface_nodes_first
from cortet.stages.transfer import transfer

SURFACE = Path(__file__).parents[3] / "shared" / "data" / "fetal" / "CRL_STA22_left_white.surf.gii"
SOLIDS = [name for name, form in FORMATS.items() if not form.is_surface]
SURFACES = [name for name, form in FORMATS.items() if form.is_surface]
#: formats that cortet reads
READ = ["vtu", "abaqus", "fenics", "gmsh", "nastran", "carp"]
#: sets of faces that divide the surface, or bound a region
PARTS = {"cortical_surface", "medial_wall", "white_interface", "tissue_interface"}


@cache
def real() -> TetMesh:
    """A fetal hemisphere in coarse tetrahedra, with a field, labels and sets."""
    if not SURFACE.exists():
        pytest.skip("../shared/data/fetal is not here")
    surface = read_surface(SURFACE)
    height = surface.points[:, 2]
    fields = {"height": height, "area": np.digitize(height, np.quantile(height, [0.3, 0.7])).astype(np.int32)}
    surface = replace(surface, point_data=fields)
    fast = Generate(backend="cgal", odt=False, lloyd=False, perturb=False, exude=False)
    mesh, _ = generate(surface, fast, cell_size=4.0, mesher="cgal")
    ready, _ = surface_nodes_first(transfer(mesh, surface)[0])
    return named_sets(ready, medial_wall={"area": [0]})


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
    "real": real,
}


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return full_mesh()


def written(mesh: TetMesh, folder: Path, name: str) -> Path:
    path = folder / f"hemi-L_res-0.6mm{FORMATS[name].suffix}"
    write(mesh, path, solver=name)
    return path


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("case", MESHES)
def test_every_program_finds_the_mesh(case: str, name: str, tmp_path: Path) -> None:
    """Nodes, tetrahedra, their regions by number and name, sets, and fields on the right nodes."""
    if (case, name) == ("real", "febio"):
        pytest.skip("pyfebio takes ten seconds")
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


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("case", [case for case in MESHES if case not in ("neither sets nor fields", "real")])
def test_cortet_reads_its_own_files_with_regions_and_parts_of_the_surface(case: str, name: str, tmp_path: Path) -> None:
    mesh = MESHES[case]()
    back = read_mesh(written(mesh, tmp_path, name))
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
    for field, values in mesh.point_data.items() if name in ("vtu", "fenics", "gmsh") else ():
        assert np.array_equal(back.point_data[field], values)


@pytest.mark.parametrize("name", SURFACES)
def test_programs_find_the_boundary(name, mesh, tmp_path):
    path, (boundary, nodes) = written(mesh, tmp_path, name), boundary_surface(mesh)
    for found in (read(path) for read in READERS[name].values()):
        assert np.allclose(found.points[found.cells], boundary.points[boundary.faces], atol=1e-5)
        if name == "gifti":
            assert np.allclose(found.fields["thickness"], mesh.point_data["thickness"][nodes])
            assert np.array_equal(found.fields["area"], mesh.point_data["area"][nodes])
    back = read_surface(path)
    assert len(back.points) == len(boundary.points) == nodes[-1] + 1


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_mesh_gives_the_same_bytes(name, mesh, tmp_path):
    for folder in ("first", "second"):
        written(mesh, tmp_path / folder, name)
    files = [sorted((tmp_path / folder).iterdir()) for folder in ("first", "second")]
    assert [file.name for file in files[0]] == [file.name for file in files[1]]
    assert all(one.read_bytes() == other.read_bytes() for one, other in zip(*files, strict=True))


def test_a_format_is_known_by_the_end_of_the_name() -> None:
    assert format_of(Path("x.boundary.surf.gii")).name == "gifti" and format_of(Path("a.b.inp")).name == "abaqus"
    for name, instead in (("x.obj", ".vtu"), ("x.vtk", ".vtu"), ("x.bpts", ".pts")):
        with pytest.raises(InputError, match=rf"{name}.*{instead}"):
            format_of(Path(name))


@pytest.mark.parametrize(
    ("name", "instead"), [("x.feb", ".vtu"), ("x.mesh", ".vtu"), ("x.bpts", "meshtool"), ("x", ".vtu")]
)
def test_a_file_that_is_not_read_is_refused_with_what_to_give_instead(name, instead):
    with pytest.raises(InputError, match=instead) as caught:
        read_mesh(Path(name))
    assert caught.value.file == Path(name)


def test_gifti_keeps_the_coordinate_system(mesh, tmp_path):
    frame = CoordinateFrame("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_MNI_152", (2, 0, 0, 5, *np.eye(4).ravel()[4:]))
    write(mesh, tmp_path / "m.surf.gii", solver="gifti", frame=frame)
    assert read_surface(tmp_path / "m.surf.gii").frame == frame


def test_no_element_of_a_gmsh_file_is_in_two_groups_and_no_number_means_two(mesh, tmp_path):
    """dolfinx makes an element of each member of each group (`gmshio.extract_topology_and_markers`)."""
    path = written(mesh, tmp_path, "gmsh")
    gmsh.initialize(argv=[], readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.open(str(path))
    groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
    elements = {
        name: np.concatenate(
            [
                gmsh.model.mesh.getElements(dim, entity)[1][0]
                for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
            ]
        )
        for name, (dim, tag) in groups.items()
    }
    nodes, _ = gmsh.model.mesh.getNodesForPhysicalGroup(*groups["medial_wall"])
    gmsh.finalize()
    numbers = {"cortical_surface": 101, "medial_wall": 102, "cortex": 1, "core": 2}
    assert {name: tag for name, (_, tag) in groups.items()} == numbers
    every = np.concatenate(list(elements.values()))
    assert len(np.unique(every)) == len(every) == len(mesh.cells) + len(boundary_faces(mesh))
    given = {**mesh.sets.faces, **mesh.sets.cells}
    assert {name: len(some) for name, some in elements.items()} == {name: len(given[name]) for name in numbers}
    assert np.array_equal(np.sort(nodes) - 1, mesh.sets.nodes["medial_wall"])


def test_a_name_with_quotation_marks_does_not_end_at_them(mesh, tmp_path):
    cells = {'a "b" c': mesh.sets.cells["cortex"], "core": mesh.sets.cells["core"]}
    msh.write(replace(mesh, sets=replace(mesh.sets, cells=cells)), tmp_path / "m.msh")
    assert by_gmsh(tmp_path / "m.msh").names == {1: "a 'b' c", 2: "core"}


def test_the_facets_of_fenics_have_the_nodes_of_the_mesh_and_tags_first(tmp_path: Path) -> None:
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
