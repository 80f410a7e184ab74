"""Layers of the cortex: its columns, depths and thickness on tetrahedra, and the volume of each layer.

The cortex is the region between the pial surface, outside, and the inner surface `white`. Depth is 0 at the pial and 1
at the white surface. Layers are bounded by equivolumetric depths, as the layers of a folded cortex are: thicker in the
crown of a gyrus and thinner in the fundus of a sulcus, or the reverse, so that each keeps its share of the volume.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.columns import Columns, columns
from cortet.geometry.topology import TET_FACES, compact, edges, neighbours
from cortet.measure.harmonic import harmonic
from cortet.measure.quality import signed_volumes
from cortet.meshes import REGION, FloatArray, IntArray, TetMesh, is_brain, region_names

#: name of the inner surface between cortex and white matter
WHITE = "white"
#: names of the fields
COLUMN, THICKNESS, DEPTH, EQUIVOLUMETRIC = "column", "thickness_mm", "depth", "depth_equivolumetric"
#: shortest column that is one, relative to the mean edge of the cortex
_SHORTEST = 0.5


@dataclass(frozen=True)
class LayerRecord:
    """One layer of the cortex; number 0 is the part of the cortex without layers."""

    number: int
    #: equivolumetric depths between which it lies
    depth: tuple[float, float]
    tetrahedra: int
    volume_ml: float
    #: share of its tetrahedra that a bound of the layer cuts, so that less than an element decides
    cut: float


class Cortex(NamedTuple):
    """The columns of the cortex of a mesh."""

    #: of the tetrahedra of the cortex alone
    columns: Columns
    #: (n,) number in the mesh of each of its nodes
    nodes: IntArray
    #: its tetrahedra in the mesh: (m,)
    cells: NDArray[np.bool_]
    #: whether a node of the cortex has a column from one surface to the other: (n,)
    known: NDArray[np.bool_]


class Layers(NamedTuple):
    """Fields and layers of a mesh. Outside the cortex depths are those of the nearer surface, and all else is 0."""

    #: name -> (n,) or (n, 3), at nodes
    of_nodes: dict[str, FloatArray]
    #: name -> (m,) or (m, 3), means over the corners
    of_cells: dict[str, FloatArray]
    #: layer of each tetrahedron, 1 for the outermost: (m,) int32; 0 outside the cortex and where it has no layers
    number: IntArray
    #: the tetrahedra of the cortex: (m,)
    cortex: NDArray[np.bool_]
    #: layers that a tetrahedron reaches into: (m,) int32
    reaches: IntArray


def require_layers(inner: Iterable[str]) -> tuple[int, int]:
    """The numbers of the cortex and of the region `white` within it; InputError if there is none of the two."""
    names = region_names(inner)
    cortex = next((number for number, name in enumerate(names, start=1) if is_brain(name)), None)
    if cortex is None or WHITE not in names:
        what = f"layers lie between a cortex and an inner surface {WHITE}, and the regions are {', '.join(names)}"
        raise InputError(what, remedy=f"name the white surface {WHITE}, or leave the layers out")
    return cortex, 1 + names.index(WHITE)


def can_have_layers(inner: Iterable[str]) -> bool:
    """Whether a mesh with these inner surfaces has a cortex around white matter."""
    return WHITE in inner


def bounds_of(layers: Sequence[float]) -> FloatArray:
    """Equivolumetric depths between layers, rising, without 0 and 1.

    Parameters
    ----------
    layers : the share of the volume of each, the outermost first; their sum may be any number
    """
    return np.cumsum(layers)[:-1] / np.sum(layers)


def cortical_columns(mesh: TetMesh, inner: Iterable[str]) -> Cortex:
    """The columns of the cortex of a mesh.

    There is none where a field line does not lead from one surface to the other, or is shorter than half the mean edge
    of the cortex: where both surfaces touch, as in the medial wall, the mesh keeps them apart by as little.

    Parameters
    ----------
    mesh : with the numbers of its regions as cell data
    inner : names of the regions from 2 on

    Raises
    ------
    InputError : there is no inner surface `white`, or no cortex around it
    """
    cortex, white = require_layers(inner)
    region = mesh.cell_data[REGION]
    mine = region == cortex
    points, cells, nodes = compact(mesh.points, mesh.cells[mine])
    wall = TetMesh(points, cells)
    cell, corner = np.nonzero(neighbours(wall) < 0)
    behind = neighbours(mesh)[np.flatnonzero(mine)[cell], corner]
    beyond = np.where(behind < 0, 0, region[behind])  # the region on the other side of each face of the wall
    faces = cells[cell[:, None], TET_FACES[corner]]
    pial, deep = faces[beyond < cortex], faces[beyond == white]
    phi = np.full((len(points), 1), 0.5)
    phi[pial] = 1.0
    phi[deep] = 0.0
    ends = np.unique(np.concatenate([pial, deep])).astype(np.int32)
    solved, _ = harmonic(wall, ends, phi[ends], phi)
    found = columns(wall, solved[:, 0])
    sides = points[edges(cells)]
    shortest = _SHORTEST * np.linalg.norm(sides[:, 0] - sides[:, 1], axis=1).mean()
    return Cortex(found, nodes, mine, found.whole & (found.thickness >= shortest))


def cortical_layers(mesh: TetMesh, inner: Iterable[str], bounds: FloatArray) -> Layers:
    """Fields and layers of the cortex of a mesh, by its `cortical_columns`.

    Parameters
    ----------
    mesh, inner : as `cortical_columns`
    bounds : equivolumetric depths between layers
    """
    names = list(inner)
    cortex = cortical_columns(mesh, names)
    found, known, cells = cortex.columns, cortex.known, cortex.columns.wall.cells
    fields = {
        COLUMN: np.where(known[:, None], found.direction, 0.0),
        THICKNESS: np.where(known, found.thickness, 0.0),
        DEPTH: np.where(known, found.depth, 1 - found.phi),
        EQUIVOLUMETRIC: np.where(known, found.depth_equivolumetric, 1 - found.phi),
    }
    of_nodes, of_cells = {}, {}
    within = mesh.cell_data[REGION] >= require_layers(names)[1]
    for name, values in fields.items():
        deepest = float(name in (DEPTH, EQUIVOLUMETRIC))
        at_nodes, at_cells = (np.zeros((len(every), *values.shape[1:])) for every in (mesh.points, mesh.cells))
        at_nodes[np.unique(mesh.cells[within])] = deepest
        at_cells[within] = deepest
        at_nodes[cortex.nodes], at_cells[cortex.cells] = values, values[cells].mean(axis=1)
        of_nodes[name], of_cells[name] = at_nodes, at_cells
    sizes = np.linalg.norm(of_cells[COLUMN], axis=1, keepdims=True)
    of_cells[COLUMN] = np.divide(of_cells[COLUMN], sizes, out=of_cells[COLUMN], where=sizes > 0)
    number, reaches = np.zeros(len(mesh.cells), np.int32), np.ones(len(mesh.cells), np.int32)
    layer = 1 + np.searchsorted(bounds, of_cells[EQUIVOLUMETRIC][cortex.cells], side="right")
    number[cortex.cells] = np.where(known[cells].all(axis=1), layer, 0)
    corners = fields[EQUIVOLUMETRIC][cells]
    first, last = (np.searchsorted(bounds, end, side="right") for end in (corners.min(axis=1), corners.max(axis=1)))
    reaches[cortex.cells] = 1 + last - first
    return Layers(of_nodes, of_cells, number, cortex.cells, reaches)


def layer_records(mesh: TetMesh, inner: Iterable[str], layers: Sequence[float] | None) -> tuple[LayerRecord, ...]:
    """The layers of the cortex, the outermost first, and the part without layers; none if the mesh can have none."""
    if layers is None or not can_have_layers(inner):
        return ()
    bounds = bounds_of(layers)
    found = cortical_layers(mesh, inner, bounds)
    volumes = signed_volumes(mesh.points, mesh.cells)
    depths = [(0.0, 1.0), *zip([0.0, *bounds.tolist()], [*bounds.tolist(), 1.0], strict=True)]
    records = []
    for number in (*range(1, len(depths)), 0):
        mine = found.cortex & (found.number == number)
        if number or mine.any():
            cut = float((found.reaches[mine] > 1).mean()) if mine.any() else 0.0
            records.append(LayerRecord(number, depths[number], int(mine.sum()), float(volumes[mine].sum()) / 1000, cut))
    return tuple(records)
