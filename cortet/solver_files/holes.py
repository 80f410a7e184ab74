"""Regions of a mesh that its files leave out, such as a ventricle as a hole."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.surface_sets import CORE, INTERFACE, among, surface_faces
from cortet.geometry.topology import boundary_faces, component_labels, numbers, used_vertices
from cortet.meshes import HOLE_SURFACE, IntArray, MeshSets, TetMesh
from cortet.stages.solver_ready import surface_nodes_first


def require_regions(holes: Collection[str], inner: Collection[str]) -> None:
    """Raise InputError for a hole that names neither an inner surface nor a label whose pieces are inner surfaces."""
    for hole in holes:
        if not regions_of(hole, inner):
            raise InputError(
                f"the hole {hole} is not a region inside an inner surface",
                remedy=f"name one of {', '.join(inner)}" if inner else "give the surface around it: --inner NAME=FILE",
            )


def regions_of(hole: str, inner: Collection[str]) -> list[str]:
    """The inner surfaces that a hole names: the one of its name, else the pieces NAME1, NAME2 of a label."""
    if hole in inner or f"{hole}1" not in inner:
        return [name for name in inner if name == hole]
    return [name for name in inner if re.fullmatch(rf"{re.escape(hole)}\d+", name)]


def hollow(mesh: TetMesh, holes: Collection[str]) -> TetMesh:
    """The mesh without the tetrahedra of some regions, surface nodes first; faces around holes are `hole_surface`.

    A name that is not a region of the mesh changes nothing: in a cohort not every case has each region.

    Parameters
    ----------
    mesh : with its sets (`sets.named_sets`)
    """
    inner = [name.removesuffix(INTERFACE) for name in mesh.sets.faces if name.endswith(INTERFACE)]
    removed = [name for hole in holes for name in regions_of(hole, inner)]
    if not removed:
        return mesh
    keep = np.ones(len(mesh.cells), bool)
    for name in removed:  # a single inner region is the core
        keep[mesh.sets.cells.get(name, mesh.sets.cells.get(CORE, []))] = False
    rest = part(mesh, keep)
    if len(np.unique(component_labels(rest.cells)[rest.cells[:, 0]])) != 1:
        raise InputError(
            f"the mesh falls into several pieces without {', '.join(removed)}",
            remedy="also leave out the regions inside a hole",
        )
    nodes, faces = (
        {name: some for name, some in sets.items() if name.removesuffix(INTERFACE) not in removed}
        for sets in (rest.sets.nodes, rest.sets.faces)
    )
    wall = _walls(rest)
    walled = MeshSets({**nodes, HOLE_SURFACE: np.unique(wall)}, {**faces, HOLE_SURFACE: wall}, rest.sets.cells)
    return surface_nodes_first(replace(rest, sets=walled))[0]


def part(mesh: TetMesh, keep: NDArray[np.bool_]) -> TetMesh:
    """The mesh of the tetrahedra that `keep` (m,) marks, with their nodes, their fields and the rest of each set."""
    cells = mesh.cells[keep]
    nodes = used_vertices(cells, len(mesh.points))
    new, number = numbers(nodes, len(mesh.points)), np.cumsum(keep, dtype=np.int32) - 1
    of_nodes = {name: new[some] for name, some in mesh.sets.nodes.items()}
    of_faces = {name: new[some] for name, some in mesh.sets.faces.items()}
    of_cells = {name: number[some[keep[some]]] for name, some in mesh.sets.cells.items()}
    return TetMesh(
        mesh.points[nodes],
        new[cells],
        {name: values[nodes] for name, values in mesh.point_data.items()},
        {name: values[keep] for name, values in mesh.cell_data.items()},
        MeshSets(
            {name: left for name, some in of_nodes.items() if len(left := some[some >= 0])},
            {name: left for name, some in of_faces.items() if len(left := some[(some >= 0).all(axis=1)])},
            {name: left for name, left in of_cells.items() if len(left)},
        ),
    )


def _walls(mesh: TetMesh) -> IntArray:
    """The boundary faces in no part of the surface: (k, 3), counter-clockwise seen from inside the holes."""
    every = boundary_faces(mesh)
    return every[~among(every, surface_faces(mesh))]
