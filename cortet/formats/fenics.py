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

from cortet.formats.atomic import atomic_path
from cortet.formats.set_arrays import CELL_SET, FACE_SET, NODE_SET
from cortet.formats.surface_sets import among, listed_faces, members, with_surface
from cortet.formats.tags import face_tags, region_numbers, regions
from cortet.meshes import REGION, TetMesh

#: name of the table of tags
_NAMES = "Information"
_XDMF_TYPES = {"i": "Int", "u": "UInt", "f": "Float"}


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
        f"mesh/node/{NODE_SET}{name}": members(len(mesh.points), nodes) for name, nodes in mesh.sets.nodes.items()
    }
    arrays |= {
        f"mesh/cell/{CELL_SET}{name}": members(len(mesh.cells), cells)
        for name, cells in mesh.sets.cells.items()
        if name not in known
    }
    arrays |= {
        f"facets/cell/{FACE_SET}{name}": among(faces, subset).astype(np.uint8)
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
