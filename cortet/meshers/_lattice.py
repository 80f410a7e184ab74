"""A body-centred cubic lattice inside, joined to given boundary triangles by a constrained Delaunay tetrahedralisation.

The tetrahedra of the lattice have q = 0.0705, nearly the best that fills space. Between it and the boundary, Delaunay
tetrahedralisation leaves slivers, which reconnection removes. Deep inside, it would only find the lattice again, so
TetGen fills the shell around that part. It keeps every boundary triangle, so the boundary keeps the topology of the
given triangles.

References: Labelle and Shewchuk, Isosurface stuffing, SIGGRAPH 2007 (the lattice); Si, TetGen, ACM TOMS 41, 2015.
"""

from __future__ import annotations

import numba
import numpy as np
import tetgen
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cortet.geometry.closest_point import closer_than, closest_points, tree_of
from cortet.geometry.thickness import thickness
from cortet.geometry.topology import TET_FACES, edges, enclosed_volume, linked, numbers, packed, vertex_normals
from cortet.meshers._remesh import GROWTH
from cortet.meshes import FloatArray, IntArray, TriSurface

#: side of the lattice's cubes over the cell size: circumradii are sqrt(5) / 4 of it, 0.86 of the cell size
CONSTANT = 1.54
#: distance of lattice nodes from the boundary, over the cell size: less gives flat elements, more gives fewer good ones
GAP = 0.5
#: least distance between the nodes of two lattices, over the mean of their cell sizes
APART = 0.75
#: spacing of the lattices in the core grows by this share of the depth, and below two or more elements across a layer
CORE_GROWTH = 0.2
#: ratio of the spacings of one lattice and the next finer one
_STEP = 2**0.5
#: thickness, over the edge length, of the blades that get nodes half-way between their banks: in thinner ones a single
#: layer of tetrahedra is better, thicker ones have room for the lattice
THINNEST, THICKEST = 1.0, 1.4
#: they get them where edges are longer than this share of the longest: where blades shorten edges, the lattice fits
_FULL = 0.95
#: and farther than this many edge lengths from blades that are too thin: two layers beside a single one are worse
_CLEAR_OF_THINNER = 4.0
#: least distance between these nodes, and of lattice nodes from them, over the edge length
MEDIAL_APART, MEDIAL_CLEAR = 0.95, 0.75
#: as the two pairs above, in a layer between two surfaces, whatever its edges
LAYER_THINNEST, LAYER_THICKEST, LAYER_APART = 1.1, 2.0, 0.7
#: a node half-way keeps this share of the thickness from both banks
_HALF_WAY = 0.45
#: tetrahedra around a node of the lattice; diameter of their circumspheres over the side of the cubes
_AROUND, _CLEAR = 24, 5**0.5 / 2
#: those at the edges from a node along x, y and z, in halves of a cube: (12, 4, 3)
_CELLS = np.array(
    [
        np.roll([[0, 0, 0], [2, 0, 0], [1, b, c], [1, -c, b]], axis, axis=1)
        for axis in range(3)
        for b, c in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
)
#: offset of the lattice's origin in a cube; any that puts no node on a round coordinate will do
_ORIGIN = np.array([0.123, 0.347, 0.211])


def graded_nodes(
    boundary: TriSurface,
    size: FloatArray,
    *,
    edge_length: float,
    cell_size: float,
    core_ratio: float = 1.0,
    core_depth: float = 0.0,
    growth: float = GROWTH,
    plateau: float = 0.0,
    layer: bool = False,
    balls: FloatArray | None = None,
) -> FloatArray:
    """Nodes of lattices inside closed surfaces, finer near smaller triangles and coarser in the core, (n, 3) mm.

    The spacing grows from one lattice to the next by at most `_STEP`: between two lattices that differ more,
    tetrahedra would be bad.

    Parameters
    ----------
    boundary : all triangles that bound a region, from which nodes keep their distance
    size : (k,) mm, edge length at each of its vertices, graded by `GROWTH`
    edge_length : mm, of the boundary where the lattice has its usual spacing
    cell_size : mm
    core_ratio : how many times coarser the lattice is in the core
    core_depth : mm, depth below the boundary at which cells begin to grow; of no effect when `core_ratio` is 1
    growth : share of the distance from the boundary by which finer lattices grow
    plateau : distance from the boundary where finer lattices begin to grow, over the edge length there
    layer : whether all of it is a layer between surfaces, which gets nodes half-way where two tetrahedra fit, not only
        where blades are too thin for the lattice
    balls : (k, 5) mm, centre and radius of each ball with smaller cells, and the edge length in it, as `size`
    """
    tree = tree_of(boundary)
    kept, before = np.zeros((0, 3)), 0.0
    around = np.zeros((0, 5)) if balls is None else balls
    centres, sizes = np.concatenate([boundary.points, around[:, :3]]), np.concatenate([size, around[:, 4]])
    flat = np.concatenate([plateau * size, around[:, 3]])
    ratios = _ratios(sizes.min() / edge_length, core_ratio)
    for ratio in ratios:
        spacing = cell_size * ratio
        if ratio == ratios[-1]:
            nodes = _inside(boundary, CONSTANT * spacing)
        else:
            if ratio < 1:
                reach = (edge_length * ratio * _STEP**0.5 - sizes) / growth
                near = reach > 0
                reach = reach + flat
            else:
                reach = np.full(len(sizes), core_depth + edge_length * (ratio - 1) / CORE_GROWTH)
                near = (reach > 0) & (np.arange(len(sizes)) < len(size))
            nodes = _near_inside(boundary, CONSTANT * spacing, centres[near], reach[near])
        nodes = nodes[~closer_than(tree, nodes, GAP * spacing)]
        kept = np.concatenate([kept, nodes[_is_apart(nodes, kept, APART * cell_size * (ratio + before) / 2)]])
        before = ratio
    medial, own = _medial_nodes(boundary, size, layer)
    if not len(medial):
        return kept
    distance, nearest = KDTree(medial).query(kept)
    return np.concatenate([medial, kept[distance > MEDIAL_CLEAR * own[nearest]]])


def _medial_nodes(boundary: TriSurface, size: FloatArray, layer: bool) -> tuple[FloatArray, FloatArray]:
    """Nodes half-way between banks too near for the lattice, (k, 3) mm, and the edge length there, (k,).

    Without them, tetrahedra would reach from bank to bank. They are centres of the shrinking balls of the vertices; in
    a `layer`, of the middles of edges: tetrahedra between triangles shifted by half an edge are like the lattice's.
    """
    outward = enclosed_volume(boundary.points, boundary.faces) > 0
    tree, points, normals = tree_of(boundary), boundary.points, vertex_normals(boundary.points, boundary.faces)
    thinnest, thickest, apart = THINNEST, THICKEST, MEDIAL_APART
    if layer:
        thinnest, thickest, apart = LAYER_THINNEST, LAYER_THICKEST, LAYER_APART
        ends = edges(boundary.faces)
        points, size, normals = points[ends].mean(axis=1), size[ends].mean(axis=1), normals[ends].mean(axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    between = thickness(tree, points, normals, 1.1 * thickest * size.max(), inside=outward)
    thin = (between > thinnest * size) & (between < thickest * size)
    if not layer:
        thinner = KDTree(points[between <= thinnest * size])
        thin &= (size > _FULL * size.max()) & (thinner.query(points)[0] > _CLEAR_OF_THINNER * size)
    inward = -normals[thin] if outward else normals[thin]
    nodes, between, size = points[thin] + inward * between[thin, None] / 2, between[thin], size[thin]
    clear = closest_points(tree, nodes).distances > _HALF_WAY * between
    nodes, size = nodes[clear], size[clear]
    kept = _thinned(nodes, apart * size)
    return nodes[kept], size[kept]


def _thinned(nodes: FloatArray, distance: FloatArray) -> NDArray[np.bool_]:
    """Which nodes (n, 3) stay if each drops the later ones that are nearer to it than its `distance` (n,): (n,)."""
    kept = np.ones(len(nodes), np.bool_)
    for number, near in enumerate(KDTree(nodes).query_ball_point(nodes, distance) if len(nodes) else ()):
        if kept[number]:
            later = np.asarray(near)
            kept[later[later > number]] = False
    return kept


def _ratios(finest: float, coarsest: float) -> list[float]:
    """Spacings of the lattices over the usual one, ascending by about `_STEP`: from near the `finest` to `coarsest`."""
    finer = max(0, round(-np.log(finest) / np.log(_STEP)))
    coarser = max(round(np.log(coarsest) / np.log(_STEP)), 1 if coarsest > 1 else 0)
    core = [coarsest ** (step / coarser) for step in range(1, coarser + 1)]
    return [*(_STEP**-step for step in range(finer, 0, -1)), 1.0, *core]


def _is_apart(nodes: FloatArray, others: FloatArray, distance: float) -> NDArray[np.bool_]:
    """Whether each of the `nodes` (n, 3) is farther than `distance` mm from all `others`."""
    if not len(others):
        return np.ones(len(nodes), np.bool_)
    return np.isinf(KDTree(others).query(nodes, distance_upper_bound=distance)[0])


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


def lattice_cells(boundary: TriSurface, nodes: FloatArray, constant: float) -> IntArray:
    """Tetrahedra of the lattice of the last node that a Delaunay tetrahedralisation is sure to have: (k, 4) int32.

    They are those around the nodes (n, 3) that have all their neighbours in the lattice, and nothing else of the
    boundary or of the other nodes within the circumspheres.
    """
    steps = np.rint(2 * (nodes - nodes[-1:]) / constant).astype(np.int64)
    off = np.abs(nodes - nodes[-1:] - steps * constant / 2).max(axis=1) > 1e-6 * constant
    off |= (steps % 2 != steps[:, :1] % 2).any(axis=1)
    alone = ~off & ~closer_than(tree_of(boundary), nodes, _CLEAR * constant)
    alone[alone] = _is_apart(nodes[alone], nodes[off], _CLEAR * constant)
    steps -= steps.min(axis=0, initial=0) - 1
    size = steps.max(axis=0, initial=0) + 3
    strides = np.array([size[1] * size[2], size[2], 1])
    at = steps @ strides
    number = np.full(size.prod(), -1, np.int32)
    number[at[~off]] = np.flatnonzero(~off)
    cells = number[at[~off & (steps[:, 0] % 2 == 1), None, None] + _CELLS @ strides].reshape(-1, 4)
    cells = cells[cells.min(axis=1) >= 0]
    alone &= np.bincount(cells.ravel(), minlength=len(nodes)) == _AROUND
    return cells[alone[cells].any(axis=1)]


def tetrahedralised(boundary: TriSurface, nodes: FloatArray, known: IntArray) -> tuple[FloatArray, IntArray]:
    """Tetrahedra of the boundary's vertices and the `nodes` (n, 3) inside; they keep the boundary's triangles.

    Parameters
    ----------
    boundary : closed; no two triangles cross or touch, or TetGen ends the process
    known : (k, 4) `nodes` of tetrahedra that it is sure to have, as `lattice_cells` finds them: TetGen fills the rest

    Returns
    -------
    points (k, 3) float64, the boundary's vertices first; cells (m, 4) int32, of either orientation
    """
    first, enclosed = len(boundary.points), np.bincount(known.ravel(), minlength=len(nodes)) == _AROUND
    shell, within = np.flatnonzero(~enclosed), enclosed[known]
    cell, corner = np.nonzero(within & (within.sum(axis=1, keepdims=True) == 1))
    faces = known[cell[:, None], TET_FACES[corner]]
    _, once, count = np.unique(packed(faces), return_index=True, return_counts=True)
    hole = first + numbers(shell, len(nodes))[faces[once[count == 1]]]
    points = np.concatenate([boundary.points, nodes[shell]])
    filled = tetgen.TetGen(points, np.concatenate([boundary.faces, hole]))
    one, other = known[within[:, 0] & within[:, 2]][:, [0, 2]].T
    part = linked(one, other, len(nodes))
    for inside in np.unique(part[enclosed], return_index=True)[1]:
        filled.add_hole(nodes[enclosed][inside])
    # unless it is to write no faces, TetGen leaves files in the working folder if triangles cross
    made, cells, *_ = filled.tetrahedralize(
        plc=True, quality=False, nobisect=True, nomergefacet=True, quiet=True, nofacewritten=True
    )
    number = np.concatenate([np.arange(first), first + shell, first + len(nodes) + np.arange(len(made) - len(points))])
    cells = np.concatenate([number[cells], first + known]).astype(np.int32)
    return np.concatenate([boundary.points, nodes, made[len(points) :]]), cells


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
