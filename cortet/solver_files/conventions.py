"""Checks of the conventions that a mesh must keep before it is written for a solver.

They are the five of the CORTET paper's discussion (arXiv:2607.12157): the sign of volumes, the order of a tetrahedron's
nodes, surface nodes first, boundary faces complete and outward, fields that belong to these nodes.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.errors import counted
from cortet.formats.surface_sets import surface_faces
from cortet.geometry.topology import boundary_faces, packed
from cortet.measure.layers import THICKNESS
from cortet.measure.quality import signed_volumes
from cortet.meshes import IntArray, TetMesh


def broken_conventions(mesh: TetMesh) -> list[str]:
    """Name every convention that a mesh breaks; if the list is empty, it may be written for a solver."""
    return [
        *_volumes(mesh),
        *_surface(mesh),
        *_fields(mesh.point_data, len(mesh.points), "nodes"),
        *_fields(mesh.cell_data, len(mesh.cells), "tetrahedra"),
    ]


def _volumes(mesh: TetMesh) -> Iterator[str]:
    wrong = np.flatnonzero(~(signed_volumes(mesh.points, mesh.cells) > 0))
    if len(wrong):
        first = wrong[0] + 1
        yield f"{len(wrong)} of {len(mesh.cells)} tetrahedra have no positive volume, the first is number {first}"
    unused = np.setdiff1d(np.arange(len(mesh.points)), mesh.cells)
    if len(unused):
        yield f"{counted(len(unused), 'node belongs', 'nodes belong')} to no tetrahedron, first node {unused[0] + 1}"


def _surface(mesh: TetMesh) -> Iterator[str]:
    """Surface nodes come first; each boundary face is listed once and outward."""
    boundary, listed = boundary_faces(mesh), surface_faces(mesh)
    nodes = np.unique(boundary)
    if nodes[-1] != len(nodes) - 1:
        yield f"the {len(nodes)} surface nodes are not the first nodes: they reach up to node {nodes[-1] + 1}"
    key = packed(np.concatenate([boundary, listed]))
    true, found = key[: len(boundary)], key[len(boundary) :]
    if repeated := len(found) - len(np.unique(found)):
        yield f"{counted(repeated, 'triangle is', 'triangles are')} listed more than once"
    if missing := len(np.setdiff1d(true, found)):
        yield f"{counted(missing, 'boundary face is', 'boundary faces are')} missing from the triangles"
    known = np.isin(found, true)
    if not known.all():
        inside = counted(np.count_nonzero(~known), "triangle is", "triangles are")
        yield f"{inside} not on the boundary, the first is number {np.argmin(known) + 1}"
    order = np.argsort(true)
    partners = boundary[order[np.searchsorted(true, found[known], sorter=order)]]
    inward = np.flatnonzero(known)[~_same_turn(listed[known], partners)]
    if len(inward):
        yield f"{counted(len(inward), 'triangle faces', 'triangles face')} inward, the first is number {inward[0] + 1}"


def _fields(fields: dict[str, NDArray[Any]], count: int, kind: str) -> Iterator[str]:
    """Every field has one finite value for each node or tetrahedron, but thickness only where there is a column."""
    for name, values in fields.items():
        if len(values) != count:
            yield f"field {name} has {len(values)} values for {count} {kind}: it belongs to another mesh"
        elif name != THICKNESS and (bad := np.count_nonzero(~np.isfinite(values))):
            yield f"field {name} has {counted(bad, 'value that is', 'values that are')} not finite"


def _same_turn(first: IntArray, second: IntArray) -> NDArray[np.bool_]:
    """Whether two triangles with the same three nodes have the same orientation."""
    turned = (np.roll(second, shift, axis=1) for shift in range(3))
    return functools.reduce(np.logical_or, ((first == other).all(axis=1) for other in turned))
