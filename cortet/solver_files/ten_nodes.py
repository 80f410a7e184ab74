"""Files of ten-node tetrahedra for Abaqus and CalculiX, FEBio, Gmsh, ParaView and FEniCS.

The corners keep the numbers that they have in the files of the straight mesh; the midside nodes follow. meshio writes
VTU, XDMF and Gmsh files, and knows the order of midside nodes in each; Abaqus and FEBio use the order of
`geometry.quadratic.EDGES` (Abaqus Elements Guide, "Three-dimensional solid element library"; FEBio User Manual,
"Elements").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import abaqus, febio, format_of
from cortet.formats.atomic import atomic_folder, write_json
from cortet.formats.ownership import record_of
from cortet.formats.surface_sets import members, sides, with_surface
from cortet.formats.tags import face_tags, region_numbers, regions
from cortet.geometry.quadratic import EDGES, QuadraticMesh
from cortet.geometry.topology import TRI_EDGES, boundary_nodes, unit_vectors
from cortet.measure.electrodes import ELECTRODE
from cortet.measure.layers import COLUMN
from cortet.meshes import REGION, IntArray, MeshSets, TetMesh
from cortet.solver_files.names import held, left_out, writable

VERSION: int = 3

#: writes a straight mesh, its curved one and the sets of that
Writer = Callable[[TetMesh, QuadraticMesh, MeshSets, Path], None]


def write_ten_nodes(mesh: TetMesh, curved: QuadraticMesh, path: Path) -> list[str]:
    """Write `path`, and beside it `<stem>.quadratic.json` with counts and names; complete or not at all.

    Parameters
    ----------
    mesh : the straight mesh, its named sets and fields
    curved : `geometry.quadratic.quadratic` of it
    path : its suffix selects the program

    Returns
    -------
    what the file cannot hold, or not by its name, in words
    """
    if path.suffix not in _WRITERS:
        raise InputError(
            "has a file extension that cortet does not write with ten-node elements",
            file=path,
            remedy=f"use {', '.join(_WRITERS)}",
        )
    (writer, holds), form = _WRITERS[path.suffix], format_of(path)
    loads = [name for name in mesh.point_data if name.startswith(ELECTRODE)]
    mesh = replace(mesh, point_data={name: values for name, values in mesh.point_data.items() if name not in loads})
    mesh, renamed = writable(with_surface(mesh), form.name)
    if loads:
        renamed.append(f"left out, because loads of contacts are those of four-node elements: {', '.join(loads)}")
    sets = MeshSets(node_sets(mesh, curved), mesh.sets.faces, mesh.sets.cells)
    with atomic_folder(path) as folder:
        writer(mesh, curved, sets, folder / path.name)
        made = record_of(sorted(folder.iterdir()))
        names = {"regions": regions(mesh), "surface": face_tags(mesh)}  # not every format has a table of them
        write_json(made | record(curved) | names, folder / f"{path.stem}.quadratic.json")
    return renamed + left_out(mesh, held(mesh, holds, groups=form.has_groups))


def record(curved: QuadraticMesh) -> dict[str, Any]:
    """The numbers of a ten-node mesh, ready for JSON."""
    counts = {"nodes": len(curved.points), "tetrahedra": len(curved.cells)}
    arrays = ("points", "cells", "ends", "on_surface")
    return counts | {name: value for name, value in asdict(curved).items() if name not in arrays}


def with_middles(mesh: TetMesh, curved: QuadraticMesh) -> dict[str, NDArray[Any]]:
    """The fields of corners on all nodes: numbers are averaged, a label is that of the edge's first end.

    The directions of columns stay unit vectors.
    """
    fields = {}
    for name, values in mesh.point_data.items():
        first, second = (values[curved.ends[:, end]] for end in (0, 1))
        middle = first if np.issubdtype(values.dtype, np.integer) else (first + second) / 2
        if name == COLUMN and values.ndim == 2:
            middle = unit_vectors(middle)
        fields[name] = np.concatenate([values, middle])
    return fields


def node_sets(mesh: TetMesh, curved: QuadraticMesh) -> dict[str, IntArray]:
    """Named sets with the midside nodes between two nodes of the set; for sets of the surface, along the surface."""
    corners, found = len(mesh.points), {}
    outside = boundary_nodes(mesh)
    for name, nodes in mesh.sets.nodes.items():
        inside = np.zeros(corners, bool)
        inside[nodes] = True
        chosen = inside[curved.ends].all(axis=1)
        if np.isin(nodes, outside).all():
            chosen &= curved.on_surface
        found[name] = np.concatenate([nodes, (corners + np.flatnonzero(chosen)).astype(np.int32)])
    return found


def _six_nodes(mesh: TetMesh, curved: QuadraticMesh, faces: IntArray) -> IntArray:
    """Corners of faces (f, 3) and the nodes between them: (f, 6)."""
    owners, _ = sides(mesh, faces)
    nodes = curved.cells[owners]
    low, high = (np.sort(faces[:, TRI_EDGES], axis=2)[:, :, end] for end in (0, 1))
    ends = np.sort(nodes[:, EDGES], axis=2)
    middles = [
        nodes[:, 4:][(ends[:, :, 0] == low[:, [side]]) & (ends[:, :, 1] == high[:, [side]])] for side in range(3)
    ]
    return np.column_stack([faces, *middles])


def _write_abaqus(mesh: TetMesh, curved: QuadraticMesh, sets: MeshSets, path: Path) -> None:
    abaqus.write_elements(mesh, curved.points, curved.cells, sets.nodes, path)


def _write_febio(mesh: TetMesh, curved: QuadraticMesh, sets: MeshSets, path: Path) -> None:
    faces = {name: _six_nodes(mesh, curved, three) for name, three in sets.faces.items()}
    of_nodes = with_middles(mesh, curved)
    febio.write_elements(mesh, curved.points, curved.cells, sets.nodes, faces, of_nodes, path)


def _write_by_meshio(mesh: TetMesh, curved: QuadraticMesh, sets: MeshSets, path: Path) -> None:
    """Write a format that meshio knows by the suffix: fields, and sets as arrays of 0 and 1."""
    of_nodes = with_middles(mesh, curved)
    of_nodes |= {f"node_set_{name}": members(len(curved.points), nodes) for name, nodes in sets.nodes.items()}
    of_cells: dict[str, list[NDArray[Any]]] = {REGION: [region_numbers(mesh)]}
    of_cells |= {f"cell_set_{name}": [members(len(curved.cells), part)] for name, part in sets.cells.items()}
    of_cells |= {name: [values] for name, values in mesh.cell_data.items() if name != REGION}
    names = {name: np.array([tag, 3]) for name, tag in regions(mesh).items()}
    content = meshio.Mesh(
        curved.points, [("tetra10", curved.cells)], point_data=of_nodes, cell_data=of_cells, field_data=names
    )
    meshio.write(path, content)


def _write_gmsh(mesh: TetMesh, curved: QuadraticMesh, sets: MeshSets, path: Path) -> None:
    """Write a file whose groups are those of the straight mesh: regions, parts of the surface and interfaces."""
    numbers = {2: face_tags(mesh), 3: regions(mesh)}
    cells: list[tuple[str, IntArray]] = [("tetra10", curved.cells)]
    cells += [("triangle6", _six_nodes(mesh, curved, sets.faces[name])) for name in numbers[2]]
    groups = [region_numbers(mesh), *(np.full(len(sets.faces[name]), tag) for name, tag in numbers[2].items())]
    content = meshio.Mesh(
        curved.points,
        cells,
        point_data=with_middles(mesh, curved),
        cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
        field_data={name: np.array([tag, dim]) for dim, tags in numbers.items() for name, tag in tags.items()},
    )
    meshio.write(path, content, file_format="gmsh22")


#: suffix -> what writes the file, and what that holds, as `Format.holds`
_WRITERS: Mapping[str, tuple[Writer, set[str]]] = {
    ".inp": (_write_abaqus, {"nodes", "faces", "cells"}),
    ".feb": (_write_febio, {"point_data", "nodes", "faces", "cells"}),
    ".vtu": (_write_by_meshio, {"point_data", "cell_data", "nodes", "cells"}),
    ".msh": (_write_gmsh, {"point_data"}),
    ".xdmf": (_write_by_meshio, {"point_data", "cell_data", "nodes", "cells"}),
}
