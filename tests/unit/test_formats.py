"""Every format gives back the mesh it was given: volumes, surface area, sets and fields; other programs read it too."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import gmsh
import h5py
import meshio
import numpy as np
import pytest
import pyvista
from cubes import cube_mesh
from exported import full_mesh
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import FORMATS, fenics, format_of, msh, surface_sets
from cortet.formats.gifti import read_surface
from cortet.formats.tags import regions
from cortet.geometry.topology import boundary_faces, boundary_surface, face_areas
from cortet.measure.quality import signed_volumes
from cortet.meshes import CoordinateFrame, TetMesh
from cortet.solver_files.export import export, write
from cortet.solver_files.sets import named_sets
from cortet.solver_files.verify import verify
from cortet.stages.generate import Generate, generate
from cortet.stages.solver_ready import surface_nodes_first
from cortet.stages.transfer import transfer

SURFACE = Path(__file__).parents[3] / "shared" / "data" / "fetal" / "CRL_STA22_left_white.surf.gii"
VOLUMES = [name for name, form in FORMATS.items() if not form.is_surface]
SURFACES = [name for name, form in FORMATS.items() if form.is_surface]
#: formats whose coordinates are single precision
SINGLE = {"carp_binary", "stl", "gifti"}
#: what a format cannot hold
WITHOUT_FIELDS = {"braingrowth", "nastran"}
WITHOUT_FACE_SETS = {"vtu", "vtk", "braingrowth"}
WITHOUT_NODE_SETS = {"gmsh", "gmsh_v2", "nastran", "braingrowth"}
WITHOUT_REGIONS = {"braingrowth"}
#: formats of whose sets of tetrahedra there are but the regions
ONLY_REGIONS = {"gmsh", "gmsh_v2", "nastran", "carp", "carp_binary"}
#: formats that hold the parts of the surface, but no other sets of faces
ONE_GROUP_PER_ELEMENT = {"gmsh", "gmsh_v2", "nastran"}


@pytest.fixture(scope="module")
def mesh() -> TetMesh:
    return full_mesh()


def written(mesh: TetMesh, folder: Path, name: str) -> Path:
    path = folder / f"hemi-L_res-0.6mm{FORMATS[name].suffix}"
    write(mesh, path, solver=name)
    return path


def assert_survives(mesh: TetMesh, name: str, folder: Path) -> None:
    """Write, verify, read back, compare."""
    path = written(mesh, folder, name)
    assert verify(path, name) == []
    back = FORMATS[name].read(path)
    precision = 1e-6 if name in SINGLE else 1e-9
    scale = np.abs(mesh.points).max()
    assert np.allclose(back.points, mesh.points, rtol=0, atol=precision * scale)
    assert np.array_equal(back.cells, mesh.cells)
    volumes, volumes_back = (signed_volumes(m.points, m.cells) for m in (mesh, back))
    assert np.allclose(volumes_back, volumes, rtol=1e-4 if name in SINGLE else 1e-6)
    areas = [face_areas(m.points, boundary_faces(m)).sum() for m in (mesh, back)]
    assert areas[1] == pytest.approx(areas[0], rel=precision)
    if name not in WITHOUT_NODE_SETS:
        assert_same_sets(back.sets.nodes, mesh.sets.nodes)
    if name not in WITHOUT_FACE_SETS:
        kept = surface_sets.SURFACE if name in ONE_GROUP_PER_ELEMENT else mesh.sets.faces
        assert_same_sets(back.sets.faces, {of: faces for of, faces in mesh.sets.faces.items() if of in kept})
    if name not in WITHOUT_REGIONS:
        of_cells = regions(mesh) if name in ONLY_REGIONS else mesh.sets.cells
        assert_same_sets(back.sets.cells, {of: cells for of, cells in mesh.sets.cells.items() if of in of_cells})
    assert np.array_equal(back.cell_data["region"], mesh.cell_data["region"])
    if name not in WITHOUT_FIELDS:
        assert_same_fields(back.point_data, mesh.point_data)


def assert_same_sets(found: dict[str, NDArray[np.int32]], given: dict[str, NDArray[np.int32]]) -> None:
    assert found.keys() == given.keys()
    for name, members in given.items():
        # the order of faces is the file's; that of the nodes of a face is the mesh's, up to where it begins
        rows = [
            np.array([min(np.roll(row, k).tolist() for k in range(3)) for row in m]) if m.ndim == 2 else m
            for m in (found[name], members)
        ]
        assert np.array_equal(*(np.unique(r, axis=0) for r in rows)), name


def assert_same_fields(found: dict[str, NDArray[np.float64]], given: dict[str, NDArray[np.float64]]) -> None:
    assert found.keys() == given.keys()
    for name, values in given.items():
        assert np.allclose(found[name], values, rtol=1e-11, atol=0), name


@pytest.mark.parametrize("name", VOLUMES)
def test_a_mesh_survives_with_volumes_area_sets_and_fields(name, mesh, tmp_path):
    assert_survives(mesh, name, tmp_path)


@pytest.mark.parametrize("name", VOLUMES)
def test_a_mesh_without_sets_and_fields_survives(name, tmp_path):
    mesh, _ = surface_nodes_first(cube_mesh(2, side=2.0, jitter=0.2))
    path = written(mesh, tmp_path, name)
    back = FORMATS[name].read(path)
    assert verify(path, name) == [] and np.array_equal(back.cells, mesh.cells)
    assert np.allclose(back.points, mesh.points, atol=1e-6)


@pytest.mark.parametrize("name", SURFACES)
def test_the_boundary_survives_with_its_area_and_enclosed_volume(name, mesh, tmp_path):
    path = written(mesh, tmp_path, name)
    assert verify(path, name) == []
    back, (boundary, nodes) = FORMATS[name].read(path), boundary_surface(mesh)
    assert len(back.points) == len(boundary.points) == nodes[-1] + 1
    assert np.allclose(back.points[back.faces], boundary.points[boundary.faces], atol=1e-5)
    if name == "gifti":
        assert np.allclose(back.point_data["thickness"], mesh.point_data["thickness"][nodes])
        assert np.array_equal(back.point_data["area"], mesh.point_data["area"][nodes])


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_mesh_gives_the_same_bytes(name, mesh, tmp_path):
    for folder in ("first", "second"):
        written(mesh, tmp_path / folder, name)
    files = [sorted((tmp_path / folder).iterdir()) for folder in ("first", "second")]
    assert [file.name for file in files[0]] == [file.name for file in files[1]]
    assert all(one.read_bytes() == other.read_bytes() for one, other in zip(*files, strict=True))


@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_file_is_refused_by_name(name, tmp_path):
    with pytest.raises(InputError, match=r"absent\..*(No such file|cannot be)"):
        FORMATS[name].read(tmp_path / f"absent{FORMATS[name].suffix}")


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_that_is_cut_off_is_refused_or_named_by_verify(name, mesh, tmp_path):
    path = tmp_path / f"m{FORMATS[name].suffix}"
    export(mesh, path, solver=name, certificate={"certified": True})
    content = path.read_bytes()
    for share in (0, 0.1, 0.5, 0.9):
        path.write_bytes(content[: int(share * len(content))])
        assert verify(path, name), share


def test_a_format_is_known_by_the_end_of_the_name(tmp_path):
    assert format_of(Path("x.boundary.surf.gii")).name == "gifti" and format_of(Path("a.b.inp")).name == "abaqus"
    with pytest.raises(InputError, match="no known mesh format"):
        format_of(Path("x.obj"))


def test_gifti_keeps_the_coordinate_system(mesh, tmp_path):
    frame = CoordinateFrame("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_MNI_152", (2, 0, 0, 5, *np.eye(4).ravel()[4:]))
    write(mesh, tmp_path / "m.surf.gii", solver="gifti", frame=frame)
    assert read_surface(tmp_path / "m.surf.gii").frame == frame


def test_gmsh_lists_the_groups(mesh, tmp_path):
    path = written(mesh, tmp_path, "gmsh")
    with msh.session():
        gmsh.open(str(path))
        found = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
        sizes = {
            name: sum(
                len(gmsh.model.mesh.getElements(group[0], e)[1][0])
                for e in gmsh.model.getEntitiesForPhysicalGroup(*group)
            )
            for name, group in found.items()
        }
        nodes, _ = gmsh.model.mesh.getNodesForPhysicalGroup(*found["medial_wall"])
    numbers = {"cortical_surface": 101, "medial_wall": 102, "cortex": 1, "core": 2}
    assert {name: number for name, (_, number) in found.items()} == numbers
    given = {name: members for name, members in {**mesh.sets.faces, **mesh.sets.cells}.items() if name in numbers}
    assert sizes == {name: len(members) for name, members in given.items()}
    assert np.array_equal(np.sort(nodes) - 1, mesh.sets.nodes["medial_wall"])


def test_elements_of_another_kind_and_groups_of_one_name_in_a_gmsh_file(tmp_path):
    path = tmp_path / "m.msh"
    tetrahedra = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
    with msh.session():
        gmsh.model.add("m")
        for tag, cell in enumerate(tetrahedra, start=1):
            gmsh.model.addDiscreteEntity(3, tag)
            new = [0, 1, 2, 3] if tag == 1 else [4]
            gmsh.model.mesh.addNodes(3, tag, [node + 1 for node in new], points[new].ravel())
            gmsh.model.mesh.addElementsByType(tag, 4, [tag], cell + 1)
            gmsh.model.addPhysicalGroup(3, [tag], tag=tag, name="one" if tag == 1 else "two")
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        gmsh.write(str(path))
    path.write_text(path.read_text().replace('"two"', '"one"'))
    assert msh.read(path).sets.cells["one"].tolist() == [0, 1]

    with msh.session():
        gmsh.open(str(path))
        gmsh.model.addDiscreteEntity(3, 9)
        gmsh.model.mesh.addNodes(3, 9, [9], [2, 2, 2])
        gmsh.model.mesh.addElementsByType(9, 7, [9], [1, 2, 5, 3, 9])
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.write(str(path))
    with pytest.raises(InputError, match="it holds Pyramid 5 elements, not only Tetrahedron 4"):
        msh.read(path)


def test_meshio_reads_the_gmsh_file(mesh, tmp_path):
    found = meshio.read(written(mesh, tmp_path, "gmsh"))
    assert sum(len(block.data) for block in found.cells if block.type == "tetra") == len(mesh.cells)
    assert {"cortical_surface", "medial_wall", "cortex", "core"} <= found.cell_sets.keys()
    assert np.allclose(found.points, mesh.points) and np.allclose(
        found.point_data["thickness"], mesh.point_data["thickness"]
    )


def test_pyvista_reads_the_vtu_file(mesh, tmp_path):
    grid = pyvista.read(written(mesh, tmp_path, "vtu"))
    assert grid.volume == pytest.approx(8.0**3) and set(grid.celltypes) == {pyvista.CellType.TETRA}
    assert np.array_equal(np.flatnonzero(grid.cell_data["region"] == 1), mesh.sets.cells["cortex"])
    assert np.array_equal(grid.point_data["normal"], mesh.point_data["normal"])
    assert grid.extract_surface(algorithm="dataset_surface").area == pytest.approx(6 * 8.0**2)


def test_pyvista_and_meshio_read_the_legacy_vtk_file(mesh, tmp_path):
    named = replace(mesh, point_data={**mesh.point_data, "two words": mesh.point_data["thickness"]})
    path = written(named, tmp_path, "vtk")
    grid = pyvista.read(path)
    assert grid.volume == pytest.approx(8.0**3) and set(grid.celltypes) == {pyvista.CellType.TETRA}
    assert np.array_equal(np.flatnonzero(grid.cell_data["region"] == 1), mesh.sets.cells["cortex"])
    assert np.array_equal(grid.point_data["two words"], mesh.point_data["thickness"])
    assert np.array_equal(meshio.read(path).cells_dict["tetra"], mesh.cells)
    for number, save in enumerate([grid.save, partial(grid.save, binary=False), meshio.read(path).write]):
        save(tmp_path / f"{number}.vtk")  # with metadata between arrays, or other names of types
        again = FORMATS["vtk"].read(tmp_path / f"{number}.vtk")
        assert np.array_equal(again.cells, mesh.cells)
        assert_same_sets(again.sets.cells, mesh.sets.cells)


@pytest.mark.parametrize("binary", [True, False])
def test_a_legacy_vtk_file_of_vtk_itself_is_read(mesh, tmp_path, binary):
    grid = pyvista.read(written(mesh, tmp_path, "vtu"))
    grid.save(tmp_path / "of_vtk.vtk", binary=binary)
    assert (tmp_path / "of_vtk.vtk").read_bytes().startswith(b"# vtk DataFile Version 5.1")
    back = FORMATS["vtk"].read(tmp_path / "of_vtk.vtk")
    assert np.array_equal(back.cells, mesh.cells) and np.allclose(back.points, mesh.points, atol=1e-5)
    assert_same_sets(back.sets.cells, mesh.sets.cells)
    assert np.allclose(back.point_data["normal"], mesh.point_data["normal"], atol=1e-5)


def test_another_grid_in_a_legacy_vtk_file_is_named(tmp_path):
    pyvista.ImageData(dimensions=(2, 2, 2)).save(tmp_path / "m.vtk")
    with pytest.raises(InputError, match="m.vtk.*it holds STRUCTURED_POINTS.*unstructured grid of tetrahedra"):
        FORMATS["vtk"].read(tmp_path / "m.vtk")


def test_gmsh_reads_the_nastran_file(mesh, tmp_path):
    path = written(mesh, tmp_path, "nastran")
    assert path.read_text().startswith("$ property 1: cortex\n$ property 2: core\n$ property 101: cortical_surface\n")
    with msh.session():
        gmsh.open(str(path))
        tets = {tag: len(gmsh.model.mesh.getElements(3, tag)[1][0]) for _, tag in gmsh.model.getEntities(3)}
        faces = {tag: len(gmsh.model.mesh.getElements(2, tag)[1][0]) for _, tag in gmsh.model.getEntities(2)}
    assert tets == {1: len(mesh.sets.cells["cortex"]), 2: len(mesh.sets.cells["core"])}
    assert faces == {101: len(mesh.sets.faces["cortical_surface"]), 102: len(mesh.sets.faces["medial_wall"])}


def test_an_xdmf_reader_reads_the_fenics_files(mesh, tmp_path):
    path = written(mesh, tmp_path, "fenics")
    cells, facets = meshio.read(path), meshio.read(fenics.facets_path(path))
    assert np.array_equal(cells.points, facets.points)  # one node numbering
    assert np.array_equal(cells.cells_dict["tetra"], mesh.cells)
    assert np.array_equal(np.flatnonzero(cells.cell_data["region"][0] == 2), mesh.sets.cells["core"])
    wall = facets.cells_dict["triangle"][facets.cell_data["surface"][0] == 102]
    assert np.array_equal(wall, mesh.sets.faces["medial_wall"])
    assert np.array_equal(cells.point_data["area"], mesh.point_data["area"])


def test_h5py_reads_the_data_of_the_fenics_files(mesh, tmp_path):
    path = written(mesh, tmp_path, "fenics")
    with h5py.File(fenics.data_path(path)) as file:
        assert np.array_equal(file["nodes"], mesh.points) and np.array_equal(file["mesh/topology"], mesh.cells)
        assert np.array_equal(file["mesh/node/thickness"], mesh.point_data["thickness"])
    with h5py.File(fenics.data_path(fenics.facets_path(path))) as file:
        assert len(file["facets/topology"]) == len(file["facets/surface"]) == 192


@pytest.mark.parametrize(
    ("centre", "message"), [("Cell", "values for .* cells"), ("Nod", "at 'Nod', neither Node nor Cell")]
)
def test_values_at_another_place_than_an_xdmf_file_says_are_refused(mesh, tmp_path, centre, message):
    path = written(mesh, tmp_path, "fenics")
    path.write_text(path.read_text().replace('Center="Node"', f'Center="{centre}"', 1))
    with pytest.raises(InputError, match=message):
        fenics.read(path)


@pytest.mark.parametrize(
    ("file", "key", "message"),
    [
        ("mesh", "mesh/topology", r"<Topology> has shape .*, not \(n, 4\)"),
        ("mesh", "nodes", r"<Geometry> has shape .*, not \(n, 3\)"),
        ("mesh", "mesh/region", "attribute region has shape .*, not one number each"),
        ("facets", "facets/topology", r"<Topology> has shape .*, not \(n, 3\)"),
        ("facets", "facets/surface", "attribute surface has shape .*, not one number each"),
    ],
)
def test_an_array_of_another_shape_is_refused(mesh, tmp_path, file, key, message):
    mesh_file = written(mesh, tmp_path, "fenics")
    path = mesh_file if file == "mesh" else fenics.facets_path(mesh_file)
    with h5py.File(fenics.data_path(path), "r+") as data:
        values = data[key][:]
        del data[key]
        data[key] = values[:, None] if values.ndim == 1 else values[:, :-1]
        shape = " ".join(map(str, data[key].shape))
    item = rf'(<DataItem Dimensions=")[^"]*("[^<]*/{key}<)'
    path.write_text(re.sub(item, rf"\g<1>{shape}\2", path.read_text()))
    with pytest.raises(InputError, match=message):
        fenics.read(mesh_file)


def test_the_tags_come_first_as_dolfinx_reads_the_first_attribute(mesh, tmp_path):
    path = written(mesh, tmp_path, "fenics")
    for file, name in ((path, "region"), (fenics.facets_path(path), "surface")):
        text = file.read_text()
        assert text.index(f'Attribute Name="{name}"') == text.index("Attribute Name=")


@pytest.mark.parametrize("name", VOLUMES)
def test_a_real_mesh_survives(name, real_mesh, tmp_path):
    assert_survives(real_mesh, name, tmp_path)


@pytest.fixture(scope="module")
def real_mesh() -> TetMesh:
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


@pytest.mark.parametrize("write", [msh.write, msh.write_v2])
def test_meshio_opens_a_gmsh_file_with_regions(write: Callable[[TetMesh, Path], None], tmp_path: Path) -> None:
    mesh = full_mesh()
    write(mesh, tmp_path / "m.msh")
    found = meshio.read(tmp_path / "m.msh")
    tets = np.concatenate([block.data for block in found.cells if block.type == "tetra"])
    same = {frozenset(map(tuple, corners.tolist())) for corners in mesh.points[mesh.cells]}
    assert {frozenset(map(tuple, corners.tolist())) for corners in found.points[tets]} == same


def test_meshio_finds_the_value_of_each_element_and_of_the_one_behind_a_triangle(tmp_path: Path) -> None:
    mesh = full_mesh()
    msh.write(replace(mesh, cell_data={"number": np.arange(len(mesh.cells))}), tmp_path / "m.msh")
    found = meshio.read(tmp_path / "m.msh")
    for block, numbers in zip(found.cells, found.cell_data["number"], strict=True):
        own = mesh.points[mesh.cells[numbers.astype(int)]]
        for corners, of in zip(found.points[block.data], own, strict=True):
            assert set(map(tuple, corners.tolist())) <= set(map(tuple, of.tolist()))
    assert {block.type for block in found.cells} == {"triangle", "tetra"}
