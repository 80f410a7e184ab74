"""Layers of the cortex: its columns, depths and thickness on tetrahedra, and the volume of each layer.

The cortex is the region between the pial surface, outside, and the inner surface `white`. Depth is 0 at the pial and 1
at the white surface. Layers are bounded by equivolumetric depths, as the layers of a folded cortex are: thicker in the
crown of a gyrus and thinner in the fundus of a sulcus, or the reverse, so that each keeps its share of the volume.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.columns import Columns, columns
from cortet.geometry.nesting import parents
from cortet.geometry.remembering import OncePerRegions
from cortet.geometry.topology import TET_FACES, compact, edges, neighbours, unit_vectors
from cortet.measure.harmonic import harmonic
from cortet.measure.quality import signed_volumes
from cortet.meshes import REGION, FloatArray, IntArray, TetMesh, TriSurface, is_brain, region_names

#: name of the inner surface between cortex and white matter
WHITE = "white"
#: names of the fields
COLUMN, THICKNESS, DEPTH, EQUIVOLUMETRIC = "column", "thickness_mm", "depth", "depth_equivolumetric"
#: field of tetrahedra: number of the layer, 0 in none. Formats without sets of tetrahedra have it
NUMBER = "layer"
#: units of the others
UNITS = {COLUMN: "1", THICKNESS: "mm", DEPTH: "1", EQUIVOLUMETRIC: "1"}
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
    #: number of the region `white`
    white: int


class Layers(NamedTuple):
    """Fields and layers of a mesh. Outside the cortex depths are those of the nearer surface, and directions are 0.

    Thickness is NaN wherever there is no column: a 0 would count in means.
    """

    #: name -> (n,) or (n, 3), at nodes
    of_nodes: dict[str, FloatArray]
    #: name -> (m,) or (m, 3), at the centroids
    of_cells: dict[str, FloatArray]
    #: layer of each tetrahedron, 1 for the outermost: (m,) int32; 0 outside the cortex and where it has no layers
    number: IntArray
    #: the tetrahedra of the cortex, and those that lie in several layers: (m,)
    cortex: NDArray[np.bool_]
    cut: NDArray[np.bool_]


def require_layers(surface: TriSurface) -> None:
    """Raise InputError unless an inner surface `white` lies in the cortex, with no other surface between.

    A field that layers would replace is refused, too.
    """
    if taken := sorted({*surface.point_data} & {*UNITS, NUMBER}):
        what = f"the surface has a field {taken[0]}, which layers would replace"
        raise InputError(what, remedy="give the field another name, or omit the layers")
    names = region_names(surface.inner)
    where = names[parents(surface)[names.index(WHITE)]] if WHITE in names else None
    if where is None or not is_brain(where):
        found = f"{WHITE} is in {where}" if where else f"the regions are {', '.join(names)}"
        remedy = f"name the white surface {WHITE}, with no other surface between it and the cortex, or omit the layers"
        raise InputError(f"layers need an inner surface {WHITE} directly inside the cortex, but {found}", remedy=remedy)


def cortex_and_white(mesh: TetMesh, inner: Iterable[str]) -> tuple[int, int] | None:
    """The numbers of the cortex and of the region `white` in it; None if the mesh has no cortex around white matter."""
    names, region = region_names(inner), mesh.cell_data.get(REGION)
    if WHITE not in names or region is None:
        return None
    white = 1 + names.index(WHITE)
    behind = neighbours(mesh)[region == white]
    around = region[behind[behind >= 0]]
    around = around[around < white]  # what lies around a region has a lower number
    if not len(around):
        return None
    cortex = int(np.bincount(around).argmax())
    return (cortex, white) if is_brain(names[cortex - 1]) else None


def bounds_of(layers: Sequence[float]) -> FloatArray:
    """Equivolumetric depths between which layers lie, from 0 to 1.

    Parameters
    ----------
    layers : the share of the volume of each, the outermost first; their sum may be any number
    """
    return np.concatenate([[0.0], np.cumsum(layers)[:-1] / np.sum(layers), [1.0]])


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
    names = list(inner)
    numbers = cortex_and_white(mesh, names)
    if numbers is None:
        what = f"the mesh has no cortex around {WHITE}, but the regions {', '.join(region_names(names))}"
        remedy = f"mesh with an inner surface {WHITE} directly inside the cortex"
        raise InputError(what, remedy=remedy)
    return _columns_between(mesh, *numbers)


@OncePerRegions
def _columns_between(mesh: TetMesh, cortex: int, white: int) -> Cortex:
    """The columns of the region `cortex` around the region `white`."""
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
    found = columns(wall, harmonic(wall, ends, phi[ends], phi)[:, 0])
    sides = points[edges(cells)]
    shortest = _SHORTEST * np.linalg.norm(sides[:, 0] - sides[:, 1], axis=1).mean()
    return Cortex(found, nodes, mine, found.whole & (found.thickness >= shortest), white)


def cortical_layers(mesh: TetMesh, inner: Iterable[str], bounds: FloatArray) -> Layers:
    """Fields and layers of the cortex of a mesh, by its `cortical_columns`.

    Parameters
    ----------
    mesh, inner : as `cortical_columns`
    bounds : of the layers, as `bounds_of` gives them
    """
    cortex = cortical_columns(mesh, inner)
    of_nodes, of_cells = _fields(cortex)
    cells, between = cortex.columns.wall.cells, bounds[1:-1]
    layer = 1 + np.searchsorted(between, of_cells[EQUIVOLUMETRIC], side="right")
    corners = of_nodes[EQUIVOLUMETRIC][cells]
    first, last = (np.searchsorted(between, end, side="right") for end in (corners.min(axis=1), corners.max(axis=1)))
    number, cut = np.zeros(len(mesh.cells), np.int32), np.zeros(len(mesh.cells), bool)
    number[cortex.cells] = np.where(cortex.known[cells].all(axis=1), layer, 0)
    cut[cortex.cells] = first < last
    within = mesh.cell_data[REGION] >= cortex.white
    deep = np.unique(mesh.cells[within])
    return Layers(
        {name: _everywhere(name, values, cortex.nodes, deep, len(mesh.points)) for name, values in of_nodes.items()},
        {name: _everywhere(name, values, cortex.cells, within, len(mesh.cells)) for name, values in of_cells.items()},
        number,
        cortex.cells,
        cut,
    )


def _fields(cortex: Cortex) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """The fields at the nodes of the cortex, and at the centroids of its tetrahedra."""
    found, known, cells = cortex.columns, cortex.known, cortex.columns.wall.cells
    of_nodes = {
        COLUMN: np.where(known[:, None], found.direction, 0.0),
        THICKNESS: np.where(known, found.thickness, np.nan),
    }
    of_cells = {name: values[cells].mean(axis=1) for name, values in of_nodes.items()}
    of_cells[COLUMN] = unit_vectors(of_cells[COLUMN])
    for name in (DEPTH, EQUIVOLUMETRIC):
        depth, slopes = found.depth(equivolumetric=name == EQUIVOLUMETRIC)
        of_nodes[name] = np.where(known, depth, 1 - found.potential.phi)
        slopes = np.where(known[:, None], slopes, 0.0)
        of_cells[name] = _at_centroids(found.wall, of_nodes[name], slopes).clip(0.0, 1.0)
    return of_nodes, of_cells


def _everywhere(name: str, values: FloatArray, where: Any, within: Any, count: int) -> FloatArray:
    """A field of the cortex on the entire mesh; a depth is 1 inside the white surface."""
    every = np.full((count, *values.shape[1:]), np.nan if name == THICKNESS else 0.0)
    if name in (DEPTH, EQUIVOLUMETRIC):
        every[within] = 1.0
    every[where] = values
    return every


def _at_centroids(mesh: TetMesh, values: FloatArray, gradient: FloatArray) -> FloatArray:
    """Values (n,) of nodes at the centroids of tetrahedra: (m,), exact for polynomials of second degree.

    The mean of the corners is too large where the function is convex, and the mean of the tangents at the corners too
    small by as much, so the truth is half-way.
    """
    corners = mesh.points[mesh.cells]
    way = corners.mean(axis=1, keepdims=True) - corners
    ahead = np.einsum("mkc,mkc->mk", gradient[mesh.cells], way)
    at_corners: FloatArray = values[mesh.cells]
    return (at_corners + ahead / 2).mean(axis=1)


def layer_records(mesh: TetMesh, inner: Iterable[str], layers: Sequence[float] | None) -> tuple[LayerRecord, ...]:
    """The layers of the cortex, the outermost first, and the part without layers; none if the mesh can have none."""
    names = list(inner)
    if layers is None or cortex_and_white(mesh, names) is None:
        return ()
    bounds = bounds_of(layers).tolist()
    found = cortical_layers(mesh, names, np.array(bounds))
    volumes = signed_volumes(mesh.points, mesh.cells)
    records = []
    for number, depth in (*enumerate(pairwise(bounds), start=1), (0, (0.0, 1.0))):
        mine = found.cortex & (found.number == number)
        if number or mine.any():
            cut = float(found.cut[mine].mean()) if mine.any() else 0.0
            records.append(LayerRecord(number, depth, int(mine.sum()), float(volumes[mine].sum()) / 1000, cut))
    return tuple(records)
