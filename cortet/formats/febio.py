"""FEBio `.feb`, specification 4.0 (FEBio User Manual 4, chapter 3, "Free Format Input"; https://febio.org/knowledgebase).

Nodes and elements count from 1 in the order of the mesh; `tet4` elements have positive volume, `tri3` facets face
outward. Every region is an `Elements` part with a `SolidDomain` and a material of its own, whose id is the number of
the region (`tags`); since FEBio wants ids in sequence, materials without a part fill gaps. The materials are
neo-Hookean with a shear modulus of 1 and a bulk modulus of 5, the ratio of the folding model (Tallinen et al. 2016). To
run the file, replace them by yours and add `Control`, `Boundary`, `Loads` and `Output`. Fields of nodes are `MeshData`,
where FEBio allows scalars and vectors of three components; a field with any other number k of components becomes k
scalars `<name>_1` to `<name>_k`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cortet.errors import DamagedFileError, InputError
from cortet.formats.as_read import AsRead
from cortet.formats.atomic import atomic_path
from cortet.formats.components import in_components
from cortet.formats.numbering import indices, whole
from cortet.formats.surface_sets import with_surface
from cortet.formats.tags import region_numbers, regions, without_tissue
from cortet.formats.text import BadRowError, read_rows, write_rows
from cortet.formats.untrusted import content, require_ascii, sound, xml_root
from cortet.meshes import REGION, FloatArray, IntArray, MeshSets, TetMesh

if TYPE_CHECKING:
    import meshio

#: name of the set of all nodes
ALL_NODES = "all_nodes"
#: largest number of a region, the id of its material; those of FreeSurfer's cortical labels are below
_MOST_MATERIALS = 3000
#: Young's modulus and Poisson's ratio of the placeholder materials, for shear modulus 1 and bulk modulus 5
_YOUNG, _POISSON = 2.8125, 0.40625

#: sections of a file, in the order of the manual, and the sections that it must have
SECTIONS = (
    "Module",
    "Control",
    "Globals",
    "Material",
    "Mesh",
    "MeshDomains",
    "MeshData",
    "MeshAdaptor",
    "Initial",
    "Boundary",
    "Rigid",
    "Loads",
    "Contact",
    "Constraints",
    "Discrete",
    "LoadData",
    "Output",
    "Step",
)
REQUIRED = ("Module", "Material", "Mesh", "MeshDomains")

#: long lists of a file, with the element of a row and its number; these are read as tables, the rest as XML
_LISTS = {
    "Nodes": ("node", "id"),
    "Elements": ("elem", "id"),
    "Surface": ("tri3", "id"),
    "NodeData": ("node", "lid"),
    "ElementData": ("elem", "lid"),
}
_BEGIN = re.compile(rb"<(%s)\b[^<>]*(?<!/)>" % "|".join(_LISTS).encode())
_ANY_BEFORE = re.compile(rb"""<(?:node|elem|tri3)\s+(?:id|lid)\s*=\s*["']\s*(\d+)\s*["']\s*>""")
_ANY_AFTER = re.compile(rb"</(?:node|elem|tri3)\s*>")


def write(mesh: TetMesh, path: str | Path) -> None:
    """Write `path`, complete or not at all."""
    mesh = with_surface(mesh)
    write_elements(mesh, mesh.points, mesh.cells, mesh.sets.nodes, mesh.sets.faces, mesh.point_data, path)


def write_elements(
    mesh: TetMesh,
    points: FloatArray,
    cells: IntArray,
    node_sets: Mapping[str, IntArray],
    faces: Mapping[str, IntArray],
    fields: Mapping[str, NDArray[Any]],
    path: str | Path,
    *,
    sections: Mapping[str, str] | None = None,
) -> None:
    """Write `path`, complete or not at all, with `tet4` and `tri3`, or with `tet10` and `tri6` elements.

    Parameters
    ----------
    mesh : has the sets of elements
    points : (n, 3) mm
    cells : (m, 4), or (m, 10) whose midside nodes are in the order 1-2, 2-3, 3-1, 1-4, 2-4, 3-4
    node_sets : name -> nodes
    faces : name -> (f, 3), or (f, 6) whose midside nodes are in the order 1-2, 2-3, 3-1
    fields : name -> (n,) or (n, k) values of the nodes
    sections : name -> content, for a file that can be run. `Material` replaces the placeholders; other names are those
        of `SECTIONS` that the mesh does not fill, and `MeshData` if there are no fields
    """
    require_ascii([*node_sets, *faces, *fields, *mesh.sets.cells], path)
    number = region_numbers(mesh)
    parts = {name: np.flatnonzero(number == tag) for name, tag in regions(mesh).items()}
    more = sections or {}
    element, facet = {4: ("tet4", "tri3"), 10: ("tet10", "tri6")}[cells.shape[1]]
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write('<?xml version="1.0" encoding="ISO-8859-1"?>\n<febio_spec version="4.0">\n')
        file.write('<Module type="solid"/>\n')
        _write_sections(file, {"Material": _placeholders(regions(mesh)), **more}, before="Mesh")
        file.write('<Mesh>\n<Nodes name="nodes">\n')
        ids = np.arange(1, len(points) + 1)
        write_rows(file, '<node id="%d">%.12g,%.12g,%.12g</node>\n', ids, points)
        file.write("</Nodes>\n")
        for name, members in parts.items():
            file.write(f'<Elements type="{element}" name={quoteattr(name)}>\n')
            write_rows(file, _row("elem", cells.shape[1]), members + 1, cells[members] + 1)
            file.write("</Elements>\n")
        for name, nodes in faces.items():
            file.write(f"<Surface name={quoteattr(name)}>\n")
            write_rows(file, _row(facet, nodes.shape[1]), np.arange(1, len(nodes) + 1), nodes + 1)
            file.write("</Surface>\n")
        _write_sets(file, "ElementSet", {name: found for name, found in mesh.sets.cells.items() if name not in parts})
        _write_sets(file, "NodeSet", {ALL_NODES: np.arange(len(points)), **node_sets})
        file.write("</Mesh>\n<MeshDomains>\n")
        for name in parts:
            file.write(f"<SolidDomain name={quoteattr(name)} mat={quoteattr(name)}/>\n")
        file.write("</MeshDomains>\n")
        _write_fields(file, fields, ids)
        _write_sections(file, more, after="Mesh")
        file.write("</febio_spec>\n")


def _placeholders(parts: Mapping[str, int]) -> str:
    """A neo-Hookean material for each part, given by its number; InputError for a number that is not such an id."""
    names = {number: name for name, number in parts.items()}
    if wrong := [number for number in names if not 1 <= number <= _MOST_MATERIALS]:
        what = f"the region {names[wrong[0]]} has the number {wrong[0]}, and ids of materials are in sequence from 1"
        raise InputError(what, remedy=f"number the regions from 1 to at most {_MOST_MATERIALS}")
    return "".join(
        f'<material id="{number}" name={quoteattr(names.get(number, f"no_part_{number}"))} type="neo-Hookean">'
        f"<density>1</density><E>{_YOUNG}</E><v>{_POISSON}</v></material>\n"
        for number in range(1, max(names) + 1)
    )


def _write_sections(file: IO[str], sections: Mapping[str, str], *, before: str = "", after: str = "") -> None:
    """Write, in order, the sections before or after a certain section."""
    place = SECTIONS.index(before or after)
    for name in SECTIONS[:place] if before else SECTIONS[place + 1 :]:
        if name in sections:
            file.write(f"<{name}>\n{sections[name]}</{name}>\n")


def _row(tag: str, nodes: int) -> str:
    """Template of the line of one element."""
    return f'<{tag} id="%d">{",".join(["%d"] * nodes)}</{tag}>\n'


def _write_sets(file: IO[str], tag: str, sets: dict[str, Any]) -> None:
    for name, numbers in sets.items():
        file.write(f"<{tag} name={quoteattr(name)}>{','.join(map(str, (numbers + 1).tolist()))}</{tag}>\n")


def _write_fields(file: IO[str], fields: Mapping[str, NDArray[Any]], ids: NDArray[np.int64]) -> None:
    if not fields:
        return
    file.write("<MeshData>\n")
    for name, values in in_components(fields, (1, 3)).items():
        number = "%d" if np.issubdtype(values.dtype, np.integer) else "%.12g"
        kind = "vec3" if values.shape[1] == 3 else "scalar"
        file.write(f'<NodeData name={quoteattr(name)} node_set="{ALL_NODES}" data_type="{kind}">\n')
        write_rows(file, f'<node lid="%d">{",".join([number] * values.shape[1])}</node>\n', ids, values)
        file.write("</NodeData>\n")
    file.write("</MeshData>\n")


def read(path: str | Path) -> TetMesh:
    """Read the mesh of a file: `tet4` parts, sets, and fields of nodes as real numbers.

    Tetrahedra are returned as they are in the file, positive or not, in the order of their ids. Parts become sets of
    tetrahedra, except the part that `write` makes for a mesh without regions.

    Raises
    ------
    InputError
        the file is missing, is not XML, has another version, holds other elements, or names nodes or elements it lacks
    """
    root, tables = read_xml(path)
    node_ids, points = _nodes(root, tables, path)
    parts: dict[str, NDArray[np.int64]] = {}
    ids, cells = [], []
    for part in root.iterfind("Mesh/Elements"):
        if part.get("type") != "tet4":
            if part.get("type") == "tet10":
                raise InputError(
                    "holds tetrahedra of ten nodes", file=path, remedy="export the tetrahedra of four nodes alone"
                )
            raise DamagedFileError(f"holds elements of type {part.get('type')}, not tet4", file=path)
        rows = _table(part, tables, 5, np.int64, path)
        name = part.get("name", "")
        parts[name] = np.concatenate([parts[name], rows[:, 0]]) if name in parts else rows[:, 0]
        ids.append(rows[:, 0])
        cells.append(rows[:, 1:])
    if not len(points) or not cells:
        raise DamagedFileError("holds no nodes or no elements", file=path)
    cell_ids = np.concatenate(ids)
    order = np.argsort(cell_ids, kind="stable")
    cell_ids = cell_ids[order]
    sets = MeshSets(
        {
            name: indices(numbers, node_ids, "node", path)
            for name, numbers in _sets(root.iterfind("Mesh/NodeSet"), path).items()
            if name != ALL_NODES
        },
        {
            name: indices(corners, node_ids, "node", path)
            for name, corners in _surfaces(root.iterfind("Mesh/Surface"), tables, path).items()
        },
        {
            **{name: indices(np.sort(rows), cell_ids, "element", path) for name, rows in without_tissue(parts).items()},
            **{
                name: indices(numbers, cell_ids, "element", path)
                for name, numbers in _sets(root.iterfind("Mesh/ElementSet"), path).items()
            },
        },
    )
    given = list(root.iterfind("MeshData/NodeData"))
    fields = {str(data.get("name")): _field(data, tables, path) for data in given}
    if len(fields) < len(given):
        raise InputError("two <NodeData> have the same name", file=path, remedy="name each field otherwise")
    corners = indices(np.concatenate(cells)[order], node_ids, "node", path)
    return sound(path, points, corners, fields, _region(root, sets, len(corners)), sets)


def read_ten_nodes(path: str | Path) -> meshio.Mesh:
    """The `tet10` elements of a file, in the order of their ids, with the number of their region and fields of nodes.

    Raises
    ------
    InputError
        as of `read`
    """
    import meshio

    root, tables = read_xml(path)
    node_ids, points = _nodes(root, tables, path)
    tags = {str(one.get("name")): int(str(one.get("id"))) for one in root.iterfind("Material/material")}
    rows, numbers = [], []
    for part in root.iterfind("Mesh/Elements"):
        if str(part.get("name")) not in tags:
            raise DamagedFileError(f"<Elements {part.get('name')}> has no material", file=path)
        rows.append(_table(part, tables, 11, np.int64, path))
        numbers.append(np.full(len(rows[-1]), tags[str(part.get("name"))]))
    table = np.concatenate(rows)
    order = np.argsort(table[:, 0], kind="stable")
    return meshio.Mesh(
        points,
        [("tetra10", indices(table[order, 1:], node_ids, "node", path))],
        point_data={str(data.get("name")): _field(data, tables, path) for data in root.iterfind("MeshData/NodeData")},
        cell_data={REGION: [np.concatenate(numbers)[order]]},
    )


def _region(root: ElementTree.Element, sets: MeshSets, count: int) -> dict[str, IntArray]:
    """The id of the material of each element, if all have one."""
    ids = {str(one.get("name")): str(one.get("id")) for one in root.iterfind("Material/material")}
    number = np.zeros(count, np.int32)
    for domain in root.iterfind("MeshDomains/SolidDomain"):
        own = ids.get(str(domain.get("mat")), "")
        if re.fullmatch(r"\d{1,9}", own):
            number[sets.cells.get(str(domain.get("name")), [])] = int(own)
    return {REGION: number} if count and number.all() else {}


def read_xml(path: str | Path) -> tuple[ElementTree.Element, list[bytes]]:
    """The XML of a file and the contents of its long lists; in the XML, an index into the contents replaces each list.

    Raises
    ------
    InputError
        the file is missing, is not well-formed XML, or is not a `febio_spec` of version 4.0
    """
    tables: list[bytes] = []
    around, begin = [], 0
    text = content(path)
    while opening := _BEGIN.search(text, begin):
        end = text.find(b"</%s>" % opening[1], opening.end())
        if end < 0:
            break
        around += [text[begin : opening.end()], str(len(tables)).encode()]
        tables.append(text[opening.end() : end])
        begin = end
    root = xml_root(b"".join([*around, text[begin:]]), path)
    if root.tag != "febio_spec" or root.get("version") != "4.0":
        raise DamagedFileError(
            f"is <{root.tag} version={root.get('version')}>, not <febio_spec version=4.0>", file=path
        )
    return root, tables


def _table(
    element: ElementTree.Element, tables: list[bytes], columns: int, dtype: Any, path: str | Path
) -> NDArray[Any]:
    """Rows of a long list: each has the id, then the values."""
    if not element.text:
        return np.empty((0, columns), dtype)
    if not re.fullmatch(r"\d{1,9}", element.text) or int(element.text) >= len(tables):
        raise DamagedFileError(f"<{element.tag} {element.get('name', '')}> is not a list", file=path)
    given, (tag, number) = tables[int(element.text)], _LISTS[element.tag]
    rows = given.replace(f'<{tag} {number}="'.encode(), b"").replace(b'">', b",").replace(f"</{tag}>".encode(), b"\n")
    if b"<" in rows:  # the rows are not written in the usual way
        rows = _ANY_AFTER.sub(b"\n", _ANY_BEFORE.sub(rb"\1,", given))
    try:
        return read_rows(rows, columns, dtype, delimiter=",")
    except BadRowError as error:
        name = f"{element.tag} {element.get('name', '')}".strip()
        raise DamagedFileError(f"<{name}>: entry {error.row + 1} {error}", file=path) from error


def _nodes(
    root: ElementTree.Element, tables: list[bytes], path: str | Path
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    rows = [_table(nodes, tables, 4, float, path) for nodes in root.iterfind("Mesh/Nodes")]
    table = np.concatenate([np.empty((0, 4)), *rows])
    return whole(table[:, 0], "node", path), table[:, 1:]


def _sets(elements: Iterable[ElementTree.Element], path: str | Path) -> dict[str, NDArray[np.int64]]:
    """Ids of each set; a set that occurs twice has the members of both."""
    found: dict[str, NDArray[np.int64]] = {}
    for element in elements:
        name, numbers = str(element.get("name")), _numbers(element, path)
        found[name] = np.union1d(found[name], numbers) if name in found else numbers
    return found


def _surfaces(
    elements: Iterable[ElementTree.Element], tables: list[bytes], path: str | Path
) -> dict[str, NDArray[np.int64]]:
    """Corners of the triangles of each surface; a surface that occurs twice has the triangles of both."""
    found: dict[str, NDArray[np.int64]] = {}
    for element in elements:
        name, corners = str(element.get("name")), _table(element, tables, 4, np.int64, path)[:, 1:]
        found[name] = np.concatenate([found[name], corners]) if name in found else corners
    return found


def _numbers(element: ElementTree.Element, path: str | Path) -> NDArray[np.int64]:
    """Ids of a set, separated by commas."""
    if len(element):  # older versions of the format list elements here
        raise InputError(
            f"<{element.tag} {element.get('name')}> holds <{element[0].tag}>, not ids separated by commas",
            file=path,
            remedy="save it again in FEBio Studio as version 4.0",
        )
    try:
        return np.array((element.text or "").replace(",", " ").split(), np.int64)
    except (ValueError, OverflowError) as error:
        raise DamagedFileError(f"<{element.tag} {element.get('name')}>: {error}", file=path) from error


def _field(data: ElementTree.Element, tables: list[bytes], path: str | Path) -> NDArray[Any]:
    """Values of a NodeData on all nodes, in their order."""
    columns = {"scalar": 1, "vec3": 3}.get(data.get("data_type", ""))
    if columns is None or data.get("node_set") != ALL_NODES:
        raise DamagedFileError(f"<NodeData {data.get('name')}> is not a scalar or vec3 on {ALL_NODES}", file=path)
    rows = _table(data, tables, 1 + columns, float, path)
    if not np.array_equal(np.sort(rows[:, 0]), np.arange(1, len(rows) + 1)):
        raise DamagedFileError(
            f"<NodeData {data.get('name')}> does not number its values from 1 to {len(rows)}", file=path
        )
    values = rows[np.argsort(rows[:, 0], kind="stable"), 1:]
    return values[:, 0] if columns == 1 else values


def as_read(path: Path) -> AsRead:
    """The file as FEBio sees it; raises InputError if it cannot be read."""
    root, _ = read_xml(path)
    return AsRead(read(path), [*_sections(root), *_names(root), *_domains(root), *_data(root)])


def _sections(root: ElementTree.Element) -> Iterator[str]:
    found = [section.tag for section in root]
    for tag in found:
        if tag not in SECTIONS:
            yield f"<{tag}> is not a section of a FEBio file"
    for tag in REQUIRED:
        if tag not in found:
            yield f"there is no section <{tag}>"
    known = [SECTIONS.index(tag) for tag in found if tag in SECTIONS]
    if known != sorted(set(known)):
        yield f"the sections come in the order {', '.join(found)}, or one comes twice; it must be {', '.join(SECTIONS)}"


def _names(root: ElementTree.Element) -> Iterator[str]:
    for kind in (
        "Material/material",
        "Mesh/Elements",
        "Mesh/NodeSet",
        "Mesh/Surface",
        "Mesh/ElementSet",
        "MeshData/NodeData",
    ):
        names = [element.get("name") for element in root.iterfind(kind)]
        tag = kind.partition("/")[2]
        if not all(names):
            yield f"a <{tag}> has no name"
        for name in sorted({str(name) for name in names if names.count(name) > 1}):
            yield f"two <{tag}> are named {name}"
    ids = [material.get("id") for material in root.iterfind("Material/material")]
    if ids != [str(number + 1) for number in range(len(ids))]:
        yield f"materials are numbered {', '.join(map(str, ids))}, not from 1"


def _domains(root: ElementTree.Element) -> Iterator[str]:
    parts = {element.get("name") for element in root.iterfind("Mesh/Elements")}
    materials = {element.get("name") for element in root.iterfind("Material/material")}
    domains = {element.get("name"): element.get("mat") for element in root.iterfind("MeshDomains/SolidDomain")}
    for part in sorted(map(str, parts - domains.keys())):
        yield f"part {part} has no <SolidDomain>"
    for part in sorted(map(str, domains.keys() - parts)):
        yield f"<SolidDomain> {part} is not part of the mesh"
    for name, material in domains.items():
        if material not in materials:
            yield f"<SolidDomain> {name} names the material {material}, which there is not"


def _data(root: ElementTree.Element) -> Iterator[str]:
    sets = {element.get("name") for element in root.iterfind("Mesh/NodeSet")}
    for data in root.iterfind("MeshData/NodeData"):
        if data.get("node_set") not in sets:
            yield f"field {data.get('name')} is of the node set {data.get('node_set')}, which there is not"
