"""FEniCS (dolfinx): `<name>.xdmf` (tetrahedra) and `<name>_facets.xdmf` (boundary triangles), each with its `.h5` file.

dolfinx opens the HDF5 file of the same name. Both XDMF files refer to one table of nodes, that of `<name>.h5`, since
`dolfinx.io.XDMFFile.read_meshtags` finds a facet by the numbers of its nodes. Grids are named `mesh` and `facets`; the
first attribute of each is what `read_meshtags` returns, `region` and `surface`: the numbers of `tags`, which a table in
each file names (<Information>, as meshio has it). Further attributes hold sets as 0 and 1, and the fields of nodes.
Numbers count from 0, volumes are positive, triangles face outward. Sources: https://www.xdmf.org (XDMF Model and
Format, version 3) and the dolfinx documentation of `XDMFFile`.

    with XDMFFile(comm, "mesh.xdmf", "r") as file:
        mesh = file.read_mesh(name="mesh")
        region = file.read_meshtags(mesh, name="mesh")
    mesh.topology.create_connectivity(2, 3)
    with XDMFFile(comm, "mesh_facets.xdmf", "r") as file:
        surface = file.read_meshtags(mesh, name="facets")
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import (
    listed_faces,
    members,
    with_surface,
)
from cortet.formats.tags import face_tags, named_once, region_numbers, regions, with_names
from cortet.formats.untrusted import check_file, content, sound, xml_root
from cortet.geometry.topology import packed
from cortet.meshes import REGION, IntArray, MeshSets, TetMesh

_NODE_SET, _CELL_SET, _FACE_SET = "node_set_", "cell_set_", "face_set_"
#: name of the table of tags
_NAMES = "Information"
_XDMF_TYPES = {"i": "Int", "u": "UInt", "f": "Float"}
_CORNERS = {"Tetrahedron": 4, "Triangle": 3}


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path` (.xdmf) and the three files beside it, each complete or not at all."""
    mesh = with_surface(mesh)
    faces, tags, known = listed_faces(mesh), face_tags(mesh), regions(mesh)
    names = {"mesh": {name: (tag, 3) for name, tag in known.items()}}
    names["facets"] = {name: (tag, 2) for name, tag in tags.items()}
    arrays: dict[str, NDArray[Any]] = {
        "nodes": mesh.points,
        "mesh/topology": mesh.cells,
        "mesh/region": region_numbers(mesh),
        "facets/topology": faces,
        "facets/surface": np.concatenate(
            [np.full(len(mesh.sets.faces[name]), tag, np.int32) for name, tag in tags.items()]
        ),
    }
    arrays |= {f"mesh/node/{name}": values for name, values in mesh.point_data.items()}
    arrays |= {f"mesh/cell/{name}": values for name, values in mesh.cell_data.items() if name != REGION}
    arrays |= {
        f"mesh/node/{_NODE_SET}{name}": members(len(mesh.points), nodes) for name, nodes in mesh.sets.nodes.items()
    }
    arrays |= {
        f"mesh/cell/{_CELL_SET}{name}": members(len(mesh.cells), cells)
        for name, cells in mesh.sets.cells.items()
        if name not in known
    }
    arrays |= {
        f"facets/cell/{_FACE_SET}{name}": _faces_among(faces, subset).astype(np.uint8)
        for name, subset in mesh.sets.faces.items()
        if name not in tags
    }
    files = {"mesh": Path(path), "facets": facets_path(path)}
    place = {key: f"{data_path(files[_grid_of(key)]).name}:/{key}" for key in arrays}
    for grid, target in files.items():
        with atomic_path(data_path(target)) as temporary:
            temporary.write_bytes(_hdf5({key: values for key, values in arrays.items() if _grid_of(key) == grid}))
        with atomic_path(target) as temporary:
            document = ElementTree.ElementTree(_document(grid, arrays, place, names[grid]))
            document.write(temporary, encoding="utf-8", xml_declaration=True)


def _hdf5(arrays: dict[str, NDArray[Any]]) -> bytes:
    """An HDF5 file of arrays, made in memory: on a full disk the library crashes."""
    with h5py.File("memory", "w", driver="core", backing_store=False) as file:
        for key, values in arrays.items():
            file.create_dataset(key, data=values)
        file.flush()
        content: bytes = file.id.get_file_image()
    return content


def _grid_of(key: str) -> str:
    """Name of the grid whose HDF5 file holds a dataset."""
    return "facets" if key.startswith("facets/") else "mesh"


def facets_path(path: str | Path) -> Path:
    """The file of the boundary triangles beside a mesh file."""
    return Path(path).with_name(Path(path).name.removesuffix(".xdmf") + "_facets.xdmf")


def data_path(path: str | Path) -> Path:
    """The HDF5 file beside an XDMF file."""
    return Path(path).with_name(Path(path).name.removesuffix(".xdmf") + ".h5")


def _document(
    grid: str, arrays: dict[str, NDArray[Any]], place: dict[str, str], names: dict[str, tuple[int, int]]
) -> ElementTree.Element:
    """XDMF of one grid: its topology, the nodes, its tags first and then its other attributes, and the tags' names."""
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    uniform = ElementTree.SubElement(domain, "Grid", Name=grid, GridType="Uniform")
    cells = arrays[f"{grid}/topology"]
    topology = ElementTree.SubElement(
        uniform,
        "Topology",
        TopologyType={4: "Tetrahedron", 3: "Triangle"}[cells.shape[1]],
        NumberOfElements=str(len(cells)),
        NodesPerElement=str(cells.shape[1]),
    )
    _item(topology, cells, place[f"{grid}/topology"])
    _item(ElementTree.SubElement(uniform, "Geometry", GeometryType="XYZ"), arrays["nodes"], place["nodes"])
    for key, values in arrays.items():
        parent, _, name = key.rpartition("/")
        if not parent.startswith(grid) or name == "topology":
            continue
        attribute = ElementTree.SubElement(
            uniform,
            "Attribute",
            Name=name,
            AttributeType={1: "Scalar", 3: "Vector"}.get(values.size // len(values), "Matrix"),
            Center="Node" if parent.endswith("/node") else "Cell",
        )
        _item(attribute, values, place[key])
    ElementTree.indent(root)
    table = ElementTree.Element("main")
    for name, (tag, dimension) in names.items():
        ElementTree.SubElement(table, "map", key=name, dim=str(dimension)).text = str(tag)
    information = ElementTree.SubElement(uniform, "Information", Name=_NAMES, Value=str(len(names)))
    information.text = ElementTree.tostring(table, "unicode")
    return root


def _item(parent: ElementTree.Element, values: NDArray[Any], where: str) -> None:
    item = ElementTree.SubElement(
        parent,
        "DataItem",
        Dimensions=" ".join(map(str, values.shape)),
        NumberType=_XDMF_TYPES[values.dtype.kind],
        Precision=str(values.dtype.itemsize),
        Format="HDF",
    )
    item.text = where


def read(path: str | Path) -> TetMesh:
    """Read the four files; tetrahedra are returned as they are there, positive or not. Others' files: `foreign_xdmf`.

    Raises
    ------
    InputError
        a file is missing or truncated, an XDMF file has a shape that differs from that of its data, or the two files
        have different nodes; or as `foreign_xdmf.read`
    """
    root = xml_root(content(path), path)
    if root.find(f"Domain/Grid[@Name='mesh']/Attribute[@Name='{REGION}']") is None:
        from cortet.formats import foreign_xdmf  # meshio loads for these only

        return foreign_xdmf.read(Path(path), root)
    cells = _grid(Path(path), "mesh", "Tetrahedron")
    facets = _grid(facets_path(path), "facets", "Triangle")
    if not np.array_equal(cells.points, facets.points):
        raise DamagedFileError("has other nodes than the tetrahedra", file=facets_path(path))
    number = _tags(cells, REGION, path)
    surface = _tags(facets, "surface", facets_path(path))
    faces = {name: facets.topology[surface == tag] for name, tag in facets.names.items() if (surface == tag).any()}
    sets = MeshSets(
        {
            name: np.flatnonzero(values).astype(np.int32)
            for name, values in _taken(cells.nodes_of, _NODE_SET, path).items()
        },
        faces
        | {
            name: facets.topology[values > 0]
            for name, values in _taken(facets.cells_of, _FACE_SET, facets_path(path)).items()
        },
        {
            name: np.flatnonzero(values).astype(np.int32)
            for name, values in _taken(cells.cells_of, _CELL_SET, path).items()
        },
    )
    of_cells = {REGION: number, **cells.cells_of}
    return sound(path, cells.points, cells.topology, cells.nodes_of, of_cells, with_names(sets, number, cells.names))


class _Grid:
    """What one XDMF file holds."""

    def __init__(self) -> None:
        self.points: NDArray[Any] = np.empty((0, 3))
        self.topology: IntArray = np.empty((0, 4), np.int32)
        self.nodes_of: dict[str, NDArray[Any]] = {}
        self.cells_of: dict[str, NDArray[Any]] = {}
        self.names: dict[str, int] = {}


def _grid(path: Path, name: str, kind: str) -> _Grid:
    root = xml_root(content(path), path)
    grid = root.find(f"Domain/Grid[@Name='{name}']")
    topology = grid.find("Topology") if grid is not None else None
    geometry = grid.find("Geometry") if grid is not None else None
    if grid is None or topology is None or geometry is None:
        raise DamagedFileError(f"has no grid {name} with a topology and a geometry", file=path)
    if topology.get("TopologyType") != kind:
        raise DamagedFileError(f"grid {name} holds {topology.get('TopologyType')}, not {kind}", file=path)
    found = _Grid()
    found.points, found.topology = _values(geometry, path), _values(topology, path)
    for element, values, columns in ((geometry, found.points, 3), (topology, found.topology, _CORNERS[kind])):
        if values.ndim != 2 or values.shape[1] != columns:
            raise DamagedFileError(f"<{element.tag}> has shape {values.shape}, not (n, {columns})", file=path)
    if found.topology.dtype.kind != "i":
        raise DamagedFileError(f"<{topology.tag}> holds {found.topology.dtype}, not integers", file=path)
    at = {"Node": (found.nodes_of, len(found.points)), "Cell": (found.cells_of, len(found.topology))}
    for attribute in grid.iterfind("Attribute"):
        called, centre, values = attribute.get("Name", ""), attribute.get("Center", ""), _values(attribute, path)
        if centre not in at:
            raise DamagedFileError(f"attribute {called} is at {centre!r}, neither Node nor Cell", file=path)
        where, count = at[centre]
        if len(values) != count:
            raise DamagedFileError(
                f"attribute {called} has {len(values)} values for {count} {centre.lower()}s", file=path
            )
        where[called] = values
    if table := grid.findtext(f"Information[@Name='{_NAMES}']"):
        found.names = _names(table, path)
    return found


def _names(table: str, path: Path) -> dict[str, int]:
    """Name -> tag of a table of tags."""
    try:
        return named_once([(row.get("key", ""), int(row.text or "")) for row in xml_root(table.encode(), path)], path)
    except ValueError as error:
        raise DamagedFileError(f"its table of tags cannot be read: {error}", file=path) from error


def _values(element: ElementTree.Element, path: Path) -> NDArray[Any]:
    """Values of the HDF5 dataset that the DataItem of an element names."""
    item = element.find("DataItem")
    if item is None:
        raise DamagedFileError(f"<{element.tag} {element.get('Name', '')}> has no DataItem", file=path)
    file, _, key = (item.text or "").strip().partition(":")
    if file != data_path(path).name and file != data_path(path.with_name(f"{_first(path)}.xdmf")).name:
        raise DamagedFileError(f"names the data file `{file}`, not one beside it of its own name", file=path)
    source = path.with_name(file)
    check_file(source)
    try:
        with h5py.File(source, "r") as data:
            values = _dataset(data, key, source)
    except (
        OSError,
        RuntimeError,
        ValueError,
        TypeError,
        AttributeError,
    ) as error:  # h5py raises these for damaged files
        raise InputError(f"cannot be read: {error}", file=source, remedy="export the mesh again") from error
    except KeyError as error:
        raise DamagedFileError(f"has no dataset {key}", file=source) from error
    if item.get("Dimensions", "").split() != [str(size) for size in values.shape]:
        raise DamagedFileError(
            f"says that {key} has {item.get('Dimensions')} values, but it has {values.shape}", file=path
        )
    return values


def _first(path: Path) -> str:
    """Name, without suffix, of the tetrahedra's file that belongs to a file of facets."""
    return path.name.removesuffix(".xdmf").removesuffix("_facets")


def _dataset(data: h5py.File, key: str, source: Path) -> NDArray[Any]:
    """The numbers of a dataset, after a check that this file itself stores them.

    Links and external storage lead out of the file.
    """
    if not isinstance(data.get(key, getlink=True), h5py.HardLink):
        raise KeyError(key)
    dataset = data[key]
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in _XDMF_TYPES or not dataset.shape:
        raise DamagedFileError(f"{key} is not an array of numbers", file=source)
    if dataset.external or dataset.is_virtual or dataset.compression or dataset.scaleoffset is not None:
        raise DamagedFileError(f"the values of {key} are compressed, or in another file", file=source)
    if dataset.nbytes > dataset.id.get_storage_size():
        raise DamagedFileError(f"{key} declares {dataset.nbytes:,} bytes, which the file does not hold", file=source)
    values: NDArray[Any] = dataset[()]
    return values


def _faces_among(faces: IntArray, subset: IntArray) -> NDArray[np.bool_]:
    """Which of `faces` are in `subset`, regardless of the order of their nodes."""
    key = packed(np.concatenate([faces, subset]))
    return np.isin(key[: len(faces)], key[len(faces) :])


def _tags(grid: _Grid, name: str, path: Path | str) -> NDArray[Any]:
    """The attribute that tags each cell of a grid; it is removed from the grid."""
    if name not in grid.cells_of:
        raise DamagedFileError(f"has no attribute {name} of its cells", file=path)
    return _of_each(grid.cells_of.pop(name), name, path)


def _taken(attributes: dict[str, NDArray[Any]], prefix: str, path: Path | str) -> dict[str, NDArray[Any]]:
    """The attributes whose names begin with `prefix`, by the rest of the name; they are removed from `attributes`."""
    names = [name for name in attributes if name.startswith(prefix)]
    return {name.removeprefix(prefix): _of_each(attributes.pop(name), name, path) for name in names}


def _of_each(values: NDArray[Any], name: str, path: Path | str) -> NDArray[Any]:
    """The given values, after a check that there is one number per row."""
    if values.ndim != 1:
        raise DamagedFileError(f"attribute {name} has shape {values.shape}, not one number each", file=path)
    return values
