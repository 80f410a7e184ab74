"""A body-centred cubic lattice inside, joined to given boundary triangles by a constrained Delaunay tetrahedralisation.

The tetrahedra of the lattice have q = 0.0705, nearly the best that fills space. Between it and the boundary, Delaunay
tetrahedralisation leaves slivers, which reconnection removes. TetGen keeps every boundary triangle, so the boundary
keeps the topology of the given triangles.

References: Labelle and Shewchuk, Isosurface stuffing, SIGGRAPH 2007 (the lattice); Si, TetGen, ACM TOMS 41, 2015.
"""

from __future__ import annotations

import numba
import numpy as np
import tetgen
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cortet.geometry.closest_point import closer_than, tree_of
from cortet.meshers._remesh import GROWTH
from cortet.meshes import FloatArray, IntArray, TriSurface

#: side of the lattice's cubes over the cell size: circumradii are sqrt(5) / 4 of it, 0.86 of the cell size
CONSTANT = 1.54
#: distance of lattice nodes from the boundary, over the cell size: less gives flat elements, more gives fewer good ones
GAP = 0.5
#: ratio of the spacings of one lattice and the next finer one
_STEP = 2**0.5
#: spacings this close, as a share of a step, count as equal
_SAME_STEP = 0.05
#: offset of the lattice's origin in a cube; any that puts no node on a round coordinate will do
_ORIGIN = np.array([0.123, 0.347, 0.211])


def lattice_nodes(
    boundary: TriSurface, *, cell_size: float, core_ratio: float, core_depth: float, walls: TriSurface | None = None
) -> FloatArray:
    """Nodes of the lattice inside a closed surface, (n, 3) float64 mm.

    Parameters
    ----------
    cell_size : mm
    core_ratio : how many times coarser the lattice is in the core
    core_depth : mm, depth below the boundary at which the core begins; of no effect when `core_ratio` is 1
    walls : all triangles from which nodes keep their distance; None: those of the boundary
    """
    tree = tree_of(walls or boundary)
    nodes = _inside(boundary, CONSTANT * cell_size)
    nodes = nodes[~closer_than(tree, nodes, GAP * cell_size)]
    if core_ratio == 1:
        return nodes
    core = _inside(boundary, CONSTANT * cell_size * core_ratio)
    # the two lattices keep apart by the mean of their own gaps
    halfway = GAP * cell_size * (1 + core_ratio) / 2
    return np.concatenate(
        [
            nodes[closer_than(tree, nodes, core_depth)],
            core[~closer_than(tree, core, core_depth + halfway)],
        ]
    )


def graded_nodes(
    boundary: TriSurface,
    size: FloatArray,
    *,
    edge_length: float,
    cell_size: float,
    core_ratio: float,
    core_depth: float,
    walls: TriSurface | None = None,
    plateau: float = 0.0,
) -> FloatArray:
    """Nodes of the lattice, and of finer ones near smaller triangles, (n, 3) float64 mm.

    Parameters
    ----------
    size : (k,) mm, edge length at each vertex of the walls, graded by `GROWTH`
    edge_length : mm, of the walls where the lattice has its usual spacing
    cell_size, core_ratio, core_depth, walls : as in `lattice_nodes`
    plateau : distance from a wall where the lattice begins to grow, over the edge length there
    """
    nodes = lattice_nodes(boundary, cell_size=cell_size, core_ratio=core_ratio, core_depth=core_depth, walls=walls)
    walls = walls or boundary
    tree = tree_of(walls)
    kept = np.zeros((0, 3))
    ratio = _finest(size.min() / edge_length)
    while ratio < 1:
        reach = (edge_length * ratio * _STEP**0.5 - size) / GROWTH
        near = reach > 0
        reach = reach + plateau * size
        finer = _near_inside(boundary, CONSTANT * cell_size * ratio, walls.points[near], reach[near])
        finer = finer[~closer_than(tree, finer, GAP * cell_size * ratio)]
        kept = np.concatenate([kept, _apart(finer, kept, GAP * cell_size * ratio * (1 + 1 / _STEP))])
        ratio *= _STEP
    return np.concatenate([kept, _apart(nodes, kept, GAP * cell_size * (1 + 1 / _STEP))])


def finer_step(ratio: FloatArray) -> FloatArray:
    """The largest spacings of lattices that are at most `ratio` times the usual one, at most 1."""
    stepped: FloatArray = _STEP ** -np.maximum(0, np.ceil(-np.log(ratio) / np.log(_STEP) - _SAME_STEP))
    return stepped


def _finest(ratio: float) -> float:
    """The power of 1 / `_STEP` nearest to `ratio` on a logarithmic scale, at most 1."""
    return float(_STEP ** -max(0, round(-np.log(ratio) / np.log(_STEP))))


def _apart(nodes: FloatArray, others: FloatArray, distance: float) -> FloatArray:
    """The `nodes` farther than `distance` mm from all `others`."""
    if not len(others):
        return nodes
    found, _ = KDTree(others).query(nodes, distance_upper_bound=distance)
    return nodes[np.isinf(found)]


def _near_inside(surface: TriSurface, constant: float, centres: FloatArray, radius: FloatArray) -> FloatArray:
    """Nodes of the lattice inside a closed surface and within `radius` (k,) of `centres` (k, 3)."""
    corner = surface.points.min(axis=0) + (_ORIGIN - 1) * constant
    grids = []
    for shift in (0, constant / 2):
        cells = _cells_near((centres - corner - shift) / constant, radius / constant)
        nodes = corner + shift + constant * cells
        grids.append(nodes[_is_inside(surface, corner + shift, constant, cells)])
    return np.concatenate(grids)


def _cells_near(centres: FloatArray, radius: FloatArray) -> NDArray[np.int64]:
    """Integer points within `radius` (k,) of `centres` (k, 3), each once, in lexicographic order."""
    low = np.floor((centres - radius[:, None]).min(axis=0)).astype(np.int64)
    high = np.ceil((centres + radius[:, None]).max(axis=0)).astype(np.int64)
    found: NDArray[np.int64] = np.argwhere(_marked(centres - low, radius, high - low + 1)) + low
    return found


@numba.njit(cache=True, error_model="numpy")
def _marked(centres, radius, size):  # type: ignore[no-untyped-def]
    """Whether each integer point from 0 on is within `radius` (k,) of `centres` (k, 3): (size[0], size[1], size[2])."""
    near = np.zeros((size[0], size[1], size[2]), np.bool_)
    for c in range(len(centres)):
        x, y, z = centres[c]
        r = radius[c]
        for i in range(int(np.ceil(x - r)), int(np.floor(x + r)) + 1):
            for j in range(int(np.ceil(y - r)), int(np.floor(y + r)) + 1):
                left = r * r - (i - x) ** 2 - (j - y) ** 2
                for k in range(int(np.ceil(z - r)), int(np.floor(z + r)) + 1):
                    if (k - z) ** 2 <= left:
                        near[i, j, k] = True
    return near


def _is_inside(surface: TriSurface, origin: FloatArray, spacing: float, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each point (n, 3) of a cubic grid, in integers, is inside a closed surface: odd crossings before it."""
    size = np.ceil((surface.points.max(axis=0) - origin) / spacing).astype(np.int64) + 1
    lines, x = _crossings(surface.points - origin, surface.faces, spacing, size[1], size[2])
    within = ((cells[:, 1:] >= 0) & (cells[:, 1:] < size[1:])).all(axis=1)
    line = np.where(within, cells[:, 1] * size[2] + cells[:, 2], -1)
    order = np.lexsort((np.r_[cells[:, 0] * spacing, x], np.r_[line, lines]))
    crossing = order >= len(cells)
    passed = np.cumsum(crossing)
    odd = np.empty(len(order), np.bool_)
    odd[order] = passed % 2 == 1
    return odd[: len(cells)]


def tetrahedralised(boundary: TriSurface, nodes: FloatArray) -> tuple[FloatArray, IntArray]:
    """Tetrahedra of the boundary's vertices and the `nodes` (n, 3) inside; they keep the boundary's triangles.

    Parameters
    ----------
    boundary : closed; no two triangles cross or touch, or TetGen ends the process

    Returns
    -------
    points (k, 3) float64, the boundary's vertices first; cells (m, 4) int32, of either orientation
    """
    filled = tetgen.TetGen(np.concatenate([boundary.points, nodes]), boundary.faces.copy())
    # unless it is to write no faces, TetGen leaves files in the working folder if triangles cross
    points, cells, *_ = filled.tetrahedralize(plc=True, quality=False, nobisect=True, quiet=True, nofacewritten=True)
    return points, cells


def _inside(surface: TriSurface, constant: float) -> FloatArray:
    """Nodes of the lattice inside a closed surface: those of its cubes' corners, then those of their centres."""
    corner = surface.points.min(axis=0) + (_ORIGIN - 1) * constant
    return np.concatenate([_grid_inside(surface, corner + shift, constant) for shift in (0, constant / 2)])


def _grid_inside(surface: TriSurface, origin: FloatArray, spacing: float) -> FloatArray:
    """Points of a cubic grid inside a closed surface, found where lines along x enter and leave it."""
    size = np.ceil((surface.points.max(axis=0) - origin) / spacing).astype(np.int64) + 1
    lines, x = _crossings(surface.points - origin, surface.faces, spacing, size[1], size[2])
    order = np.lexsort((x, lines))
    lines, x = lines[order], x[order]
    first = np.ceil(x[0::2] / spacing).astype(np.int64)
    count = np.floor(x[1::2] / spacing).astype(np.int64) - first + 1
    line = np.repeat(lines[0::2], count)
    number = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    return origin + spacing * np.column_stack([number, line // size[2], line % size[2]])


@numba.njit(cache=True, error_model="numpy")
def _crossings(points, faces, spacing, rows, columns):  # type: ignore[no-untyped-def]
    """Where the lines y = j spacing, z = k spacing meet the triangles: numbers j * columns + k, and x.

    A line that meets an edge or a vertex counts as running past it, at y + e, z + e^2 with an infinitesimal e. In
    coordinates relative to the line, two neighbours compute the same number for their edge, with opposite signs, so the
    line crosses exactly one of them (Woop, Benthin and Wald, Watertight ray/triangle intersection, JCGT 2013).
    """
    lines, x = [], []
    side = np.empty(3)
    for face in faces:
        corners = points[face]
        low_y, high_y = corners[:, 1].min(), corners[:, 1].max()
        low_z, high_z = corners[:, 2].min(), corners[:, 2].max()
        for j in range(max(0, int(np.ceil(low_y / spacing))), min(rows - 1, int(np.floor(high_y / spacing))) + 1):
            for k in range(
                max(0, int(np.ceil(low_z / spacing))), min(columns - 1, int(np.floor(high_z / spacing))) + 1
            ):
                positive = 0
                for corner in range(3):
                    a, b = (corner + 1) % 3, (corner + 2) % 3
                    ay, az = corners[a, 1] - j * spacing, corners[a, 2] - k * spacing
                    by, bz = corners[b, 1] - j * spacing, corners[b, 2] - k * spacing
                    side[corner] = ay * bz - az * by
                    past = az > bz or (az == bz and by > ay)
                    positive += side[corner] > 0 or (side[corner] == 0 and past)
                if positive % 3 == 0:
                    lines.append(j * columns + k)
                    x.append((side * corners[:, 0]).sum() / side.sum())
    return np.array(lines), np.array(x)
