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

from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import with_surface
from cortet.formats.tags import region_numbers, regions
from cortet.formats.values import in_components, write_rows
from cortet.meshes import FloatArray, IntArray, TetMesh

#: name of the set of all nodes
ALL_NODES = "all_nodes"
#: largest number of a region, the id of its material; those of FreeSurfer's cortical labels are below
_MOST_MATERIALS = 3000
#: Young's modulus and Poisson's ratio of the placeholder materials, for shear modulus 1 and bulk modulus 5
_YOUNG, _POISSON = 2.8125, 0.40625


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
    """
    number = region_numbers(mesh)
    parts = {name: np.flatnonzero(number == tag) for name, tag in regions(mesh).items()}
    element, facet = {4: ("tet4", "tri3"), 10: ("tet10", "tri6")}[cells.shape[1]]
    with atomic_path(path) as temporary, temporary.open("w", encoding="ascii") as file:
        file.write('<?xml version="1.0" encoding="ISO-8859-1"?>\n<febio_spec version="4.0">\n')
        file.write('<Module type="solid"/>\n')
        file.write(f"<Material>\n{_placeholders(regions(mesh))}</Material>\n")
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
        file.write("</febio_spec>\n")


def _placeholders(parts: Mapping[str, int]) -> str:
    """A neo-Hookean material for each part, given by its number; InputError for a number that is not such an id."""
    names = {number: name for name, number in parts.items()}
    if wrong := [number for number in names if not 1 <= number <= _MOST_MATERIALS]:
        what = f"the region {names[wrong[0]]} has the number {wrong[0]}, but FEBio numbers materials in sequence from 1"
        raise InputError(what, remedy=f"number the regions from 1 to at most {_MOST_MATERIALS}")
    return "".join(
        f'<material id="{number}" name={quoteattr(names.get(number, f"no_part_{number}"))} type="neo-Hookean">'
        f"<density>1</density><E>{_YOUNG}</E><v>{_POISSON}</v></material>\n"
        for number in range(1, max(names) + 1)
    )


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
