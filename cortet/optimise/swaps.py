"""Local reconnection: replace the tetrahedra around an edge or a face by better ones with the same outer faces.

Two moves cover the classical swaps. *Edge removal* takes all n tetrahedra around an edge and refills their union by the
best triangulation of the ring of opposite vertices, found by dynamic programming (Klincsek 1980; Shewchuk 2002, "Two
discrete optimization algorithms for the topological improvement of tetrahedral meshes"): 3-2 and 4-4 swaps are its
cases n = 3 and 4. *Face removal* is the 2-3 swap. On the boundary, edge removal flips a boundary edge; if only a single
tetrahedron is at that edge, it peels this tetrahedron off. On the interface of two regions it flips an edge, too: both
regions are refilled up to the new edge. A move is made only if the worst quality of the cavity improves, so the mesh
can only get better and the process ends.

Tetrahedra are in arrays with spare rows; a dead row has -1 as its first vertex. Everything is local: the cost of a move
depends on its cavity, not on the size of the mesh.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from cortet.geometry.closest_point import SurfaceTree, closest_point
from cortet.geometry.topology import TET_FACES, neighbours
from cortet.measure.quality import signed_volume
from cortet.meshes import FloatArray, IntArray, TetMesh
from cortet.optimise.cavities import (
    EDGE_FRAMES,
    MAX_NEW,
    MAX_RING,
    best_filling,
    corner_of,
    filled_with,
    fourth,
    mu2_at,
    replace_cells,
    ring_around,
    ring_of_two,
    share_an_edge,
    unit_normal,
)

#: below this mu^2 (q = 0.29), a tetrahedron tries only the cavities of which it is the worst: in others, the worst has
#: tried already. Bad ones try all, since there may be another way once something around has changed
_ANY_CAVITY = (1 - 0.29) ** -2
#: the worst mu^2 of a cavity must fall by this factor
_MIN_GAIN = 0.999
#: a boundary move keeps new boundary faces within acos(this) of the ones they replace ...
_MIN_FACE_COSINE = 0.5
#: ... and the middle of the new boundary edge near the input surface: within the first fraction of the edge's length,
#: or within the second one if an element has mu^2 above _BAD (q = 0.45), since nothing else may mend it. The check of
#: the whole boundary tells whether a crest that was cut leaves too much behind
MAX_SAG, _MAX_SAG_OF_BAD, _BAD = 0.2, 0.35, (1 - 0.45) ** -2
#: largest mu^2 that a flip beside a lone vertex may leave (q = 0.9)
_WORST_FLIP = (1 - 0.9) ** -2


class Swappable(NamedTuple):
    """A mesh that can be reconnected in place; some of its m rows are dead or spare."""

    #: (n, 3) float64 mm
    points: FloatArray
    #: (m, 4) int32
    cells: IntArray
    #: (m, 4) int32, the tetrahedron behind the face opposite each corner, -1 outside the mesh
    neighbours: IntArray
    #: (m,) float64, mu^2 of each tetrahedron; 0 for a dead row
    mu2: FloatArray
    #: (m,) int32, the tetrahedron of the original mesh whose data a row carries
    origin: IntArray
    #: (m,) int32, tetrahedra of different regions are never joined in one cavity
    region: IntArray
    #: (n,) bool, vertices whose boundary edges stay; n as of points
    held: np.ndarray
    #: (n,) int32, for a vertex of an interface a triangle of the surface it lies on; -1 for the other vertices, whose
    #: edges between two regions stay
    on_triangle: IntArray
    #: (2,) int64: rows in use (dead ones included), dead rows kept for reuse
    counters: np.ndarray
    #: (m,) int32, stack of dead rows
    dead: IntArray


class SwapCount(NamedTuple):
    """The changes made by a run of `improve`."""

    attempts: int
    edge_removals: int
    face_removals: int
    boundary_flips: int
    peeled: int
    #: volume between the old and the new boundary, mm3, positive if it was cut off
    volume_cut: float


NO_SWAPS = SwapCount(0, 0, 0, 0, 0, 0.0)


def swappable(
    mesh: TetMesh,
    mu2: FloatArray,
    region: IntArray,
    held: np.ndarray,
    *,
    on_triangle: IntArray | None = None,
    vertices: int = 0,
) -> Swappable:
    """Copy a mesh into arrays with room for `vertices` in all.

    Boundary edges of `held` vertices (n,) are not flipped. Edges of an interface are flipped only between vertices with
    an `on_triangle` (n,): the triangle of the surface that they lie on.
    """
    count = len(mesh.cells)
    room = count + count // 4 + 1000

    def grown(array: np.ndarray, fill: float, size: int = room) -> np.ndarray:
        result = np.full((size, *array.shape[1:]), fill, array.dtype)
        result[: len(array)] = array
        return result

    return Swappable(
        points=grown(mesh.points, np.nan, max(vertices, len(mesh.points))),
        cells=grown(mesh.cells, -1),
        neighbours=grown(neighbours(mesh), -1),
        mu2=grown(mu2, 0),
        origin=grown(np.arange(count, dtype=np.int32), -1),
        region=grown(region.astype(np.int32), -1),
        held=grown(held, False, max(vertices, len(held))),
        on_triangle=grown(
            np.full(len(mesh.points), -1, np.int32) if on_triangle is None else on_triangle,
            -1,
            max(vertices, len(held)),
        ),
        counters=np.array([count, 0]),
        dead=np.empty(room, np.int32),
    )


class Live(NamedTuple):
    """The k live tetrahedra."""

    #: (k, 4) int32
    cells: IntArray
    #: (k, 4) int32, as of `Swappable`
    neighbours: IntArray
    #: (k,) int32, the original tetrahedron whose data each one carries
    origin: IntArray


def live_cells(mesh: Swappable) -> Live:
    """Leave out dead and spare rows."""
    return Live(*_live_rows(mesh.cells, mesh.neighbours, mesh.origin, mesh.counters[0]))


@numba.njit(cache=True, error_model="numpy")
def _live_rows(cells, neighbours, origin, used):  # type: ignore[no-untyped-def]
    """The arrays of `Live`, from the first `used` rows."""
    number = np.full(used, -1, np.int32)
    count = 0
    for e in range(used):
        if cells[e, 0] >= 0:
            number[e] = count
            count += 1
    live, behind, made_of = np.empty((count, 4), np.int32), np.empty((count, 4), np.int32), np.empty(count, np.int32)
    for e in range(used):
        row = number[e]
        if row >= 0:
            made_of[row] = origin[e]
            for k in range(4):
                f = neighbours[e, k]
                live[row, k], behind[row, k] = cells[e, k], number[f] if f >= 0 else -1
    return live, behind, made_of


@numba.njit(cache=True, error_model="numpy")
def _is_inside(mesh, e, first, last, a, b):  # type: ignore[no-untyped-def]
    """Whether edge (first, last) of tetrahedron e, whose other corners are a and b, lies inside one region."""
    ring, around = np.empty(MAX_RING + 1, np.int32), np.empty(MAX_RING, np.int32)
    frame = np.empty(4, np.int64)
    frame[0], frame[1] = corner_of(mesh.cells, e, first), corner_of(mesh.cells, e, last)
    frame[2], frame[3] = corner_of(mesh.cells, e, a), corner_of(mesh.cells, e, b)
    _, _, n, tets = ring_around(mesh, e, frame, ring, around)
    return n > 0 and n == tets


@numba.njit(cache=True, error_model="numpy")
def _flip_is_sound(mesh, tree, a, b, first, last, cavity, size, worst):  # type: ignore[no-untyped-def]
    """Whether (first, last) may replace boundary edge (a, b): still a manifold, and still near the input surface.

    `worst` is the largest mu^2 of the cavity.
    """
    points = mesh.points
    if size == 1:
        e = cavity[0]
        # a and b must keep a tetrahedron each
        for i in range(4):
            if (mesh.cells[e, i] == a or mesh.cells[e, i] == b) and mesh.neighbours[e, i] < 0:
                return False
        if not _is_inside(mesh, e, first, last, a, b):
            return False
    elif share_an_edge(mesh, cavity[0], first, last):
        return False
    return _stays_on_surface(points, tree, a, b, first, last, worst, -1)


@numba.njit(cache=True, error_model="numpy")
def _interface_flip_is_sound(mesh, tree, e, a, b, first, last, alone, worst):  # type: ignore[no-untyped-def]
    """Whether (first, last) may replace edge (a, b) of an interface, as `_flip_is_sound` for the boundary.

    `alone`: tetrahedron e is the only one of its region at the edge, so it goes over to the other region.
    """
    for v in (a, b, first, last):
        if mesh.on_triangle[v] < 0 or mesh.held[v]:
            return False
    if alone and not _is_inside(mesh, e, first, last, a, b):
        return False
    return _stays_on_surface(mesh.points, tree, a, b, first, last, worst, mesh.on_triangle[first])


@numba.njit(cache=True, error_model="numpy")
def _stays_on_surface(points, tree, a, b, first, last, worst, on_triangle):  # type: ignore[no-untyped-def]
    """Whether faces at (first, last) point like those at (a, b), and stay near the surface of `on_triangle`."""
    ox, oy, oz = unit_normal(points[a], points[first], points[b])
    px, py, pz = unit_normal(points[a], points[b], points[last])
    ox, oy, oz = ox + px, oy + py, oz + pz
    length = np.sqrt(ox * ox + oy * oy + oz * oz)
    ox, oy, oz = ox / length, oy / length, oz / length
    for start, end, third in ((first, b, last), (first, last, a)):
        nx, ny, nz = unit_normal(points[start], points[end], points[third])
        if not nx * ox + ny * oy + nz * oz >= _MIN_FACE_COSINE:
            return False
    fx, fy, fz = points[first]
    lx, ly, lz = points[last]
    mx, my, mz = (fx + lx) / 2, (fy + ly) / 2, (fz + lz) / 2
    sx, sy, sz = lx - fx, ly - fy, lz - fz
    px, py, pz, _, _, _, _ = closest_point(tree, mx, my, mz, on_triangle)
    sag2 = (px - mx) ** 2 + (py - my) ** 2 + (pz - mz) ** 2
    allowed = MAX_SAG if worst < _BAD else _MAX_SAG_OF_BAD
    return sag2 <= allowed**2 * (sx * sx + sy * sy + sz * sz)


@numba.njit(cache=True, error_model="numpy")
def _improve_cell(mesh, tree, e, tally, work):  # type: ignore[no-untyped-def]
    """Try every swap of one tetrahedron and make the best one; return the number of new tetrahedra, -1 for none.

    `tally` counts attempts, edge removals, face removals, flips, peels and the volume cut. `work` holds scratch arrays;
    the first one lists the new tetrahedra.
    """
    cavity, ring, cost, split, new, best_new = work
    points, cells = mesh.points, mesh.cells
    best_ratio, kind, best_size, best_old, best_other = _MIN_GAIN, 0, 0, 0, 0
    best_cavity = np.empty(MAX_RING, np.int32)
    cut = 0.0
    most = mesh.mu2[e] if mesh.mu2[e] < _ANY_CAVITY else np.inf
    for k in range(6):
        tally[0] += 1
        a, b, n, tets = ring_around(mesh, e, EDGE_FRAMES[k], ring, cavity)
        if n == 0:
            first, tets = ring_of_two(mesh, e, EDGE_FRAMES[k], ring, cavity)
            if tets == 0:
                continue
            worst = 0.0
            for i in range(tets):
                worst = max(worst, mesh.mu2[cavity[i]])
            if worst > most:
                continue
            achieved = best_filling(points, a, b, ring, first + 1, worst, cost, split)
            if not achieved < best_ratio * worst:
                continue
            achieved = max(achieved, best_filling(points, a, b, ring[first:], tets - first + 1, worst, cost, split))
            alone = first == 1 or tets - first == 1
            lone = cavity[0] if first == 1 else cavity[tets - 1]
            if achieved < best_ratio * worst and _interface_flip_is_sound(
                mesh, tree, lone, a, b, ring[0], ring[first], alone, worst
            ):
                best_ratio, best_old, kind, cut = achieved / worst, tets, 3, 0.0
                best_cavity[:tets] = cavity[:tets]
                best_size = filled_with(a, b, ring[first:], tets - first + 1, split, best_new)
                best_other = best_size
                best_filling(points, a, b, ring, first + 1, worst, cost, split)
                best_size += filled_with(a, b, ring, first + 1, split, best_new[best_size:])
            continue
        if n != tets and (mesh.held[a] or mesh.held[b] or mesh.held[ring[0]] or mesh.held[ring[n - 1]]):
            continue
        worst = 0.0
        for i in range(tets):
            worst = max(worst, mesh.mu2[cavity[i]])
        if worst > most:
            continue
        achieved = best_filling(points, a, b, ring, n, best_ratio * worst, cost, split) if n > 2 else 0.0
        # a peeled tetrahedron leaves nothing that could be worse, so any swap that keeps the boundary is preferred
        ratio = achieved / worst if n == tets else max(achieved / worst, 0.99 * _MIN_GAIN)
        if achieved < _MIN_GAIN * worst and ratio < best_ratio:
            if n != tets and not _flip_is_sound(mesh, tree, a, b, ring[0], ring[n - 1], cavity, tets, worst):
                continue
            best_ratio, best_old, best_other = ratio, tets, 0
            best_cavity[:tets] = cavity[:tets]
            best_size = filled_with(a, b, ring, n, split, best_new)
            kind = 1 if n == tets else (4 if n == 2 else 3)
            cut = 0.0 if n == tets else signed_volume(points, a, b, ring[0], ring[n - 1])
    for k in range(4):
        f = mesh.neighbours[e, k]
        if f < 0 or mesh.region[f] != mesh.region[e] or mesh.mu2[f] > most:
            continue
        tally[0] += 1
        a, b, c = cells[e, TET_FACES[k, 0]], cells[e, TET_FACES[k, 1]], cells[e, TET_FACES[k, 2]]
        top, bottom = fourth(cells, f, a, b, c), cells[e, k]
        worst = max(mesh.mu2[e], mesh.mu2[f])
        limit = best_ratio * worst
        # face (a, b, c) is outward for e: seen from top it is counter-clockwise
        if (
            mu2_at(points, a, b, bottom, top) < limit
            and mu2_at(points, b, c, bottom, top) < limit
            and mu2_at(points, c, a, bottom, top) < limit
        ):
            new[0, 0], new[0, 1], new[0, 2], new[0, 3] = a, b, bottom, top
            new[1, 0], new[1, 1], new[1, 2], new[1, 3] = b, c, bottom, top
            new[2, 0], new[2, 1], new[2, 2], new[2, 3] = c, a, bottom, top
            achieved = 0.0
            for i in range(3):
                achieved = max(achieved, mu2_at(points, new[i, 0], new[i, 1], new[i, 2], new[i, 3]))
            best_ratio, kind, best_size, best_old, best_other = achieved / worst, 2, 3, 2, 0
            best_cavity[0], best_cavity[1] = e, f
            best_new[:3] = new[:3]
    if kind == 0 or mesh.counters[0] + best_size > len(cells):
        return -1
    cavity[:best_old] = best_cavity[:best_old]
    behind = best_cavity[best_old - 1]
    origin, region = mesh.origin[behind], mesh.region[behind]
    replace_cells(mesh, cavity, best_old, best_new, best_size)
    for i in range(best_other):  # these are on the other side of an interface
        mesh.origin[cavity[i]], mesh.region[cavity[i]] = origin, region
    tally[kind] += 1
    if kind >= 3:
        tally[5] += cut
    return best_size


@numba.njit(cache=True, error_model="numpy")
def flip_beside_lone(mesh, tree, e, changed):  # type: ignore[no-untyped-def]
    """Flip a boundary edge of tetrahedron e if e alone is at one of its vertices, which then gets a second one.

    Three of its faces are on the boundary, so moving this vertex hardly helps. The flip may make the cavity worse,
    since its vertices move afterwards. Returns whether one was made, and then sets `changed` for the vertices around.
    """
    alone, walls = -1, 0
    for k in range(4):
        if mesh.neighbours[e, k] < 0:
            walls += 1
        else:
            alone = mesh.cells[e, k]
    if walls != 3:
        return False
    ring, cavity = np.empty(MAX_RING + 1, np.int32), np.empty(MAX_NEW + MAX_RING, np.int32)
    best_cavity, best_new, size = cavity.copy(), np.empty((MAX_NEW, 4), np.int32), 0
    cost, split = np.empty((MAX_RING + 1, MAX_RING + 1)), np.empty((MAX_RING + 1, MAX_RING + 1), np.int64)
    best = _WORST_FLIP
    for frame in EDGE_FRAMES:
        a, b, n, tets = ring_around(mesh, e, frame, ring, cavity)
        if n < 3 or n == tets or alone in (a, b):
            continue
        if mesh.held[a] or mesh.held[b] or mesh.held[ring[0]] or mesh.held[ring[n - 1]]:
            continue
        achieved = best_filling(mesh.points, a, b, ring, n, best, cost, split)
        if achieved < best and _flip_is_sound(mesh, tree, a, b, ring[0], ring[n - 1], cavity, tets, mesh.mu2[e]):
            best, old = achieved, tets
            best_cavity[:tets] = cavity[:tets]
            size = filled_with(a, b, ring, n, split, best_new)
    if size == 0 or mesh.counters[0] + size > len(mesh.cells):
        return False
    for f in best_cavity[:old]:
        changed[mesh.cells[f]] = True
    replace_cells(mesh, best_cavity, old, best_new, size)
    return True


@numba.njit(cache=True, error_model="numpy")
def _improve(mesh, tree, queue, threshold, tally):  # type: ignore[no-untyped-def]
    """Work through the rows in `queue`, and through new tetrahedra that are still above `threshold`."""
    work = (
        np.empty(MAX_NEW + MAX_RING, np.int32),
        np.empty(MAX_RING + 1, np.int32),
        np.empty((MAX_RING + 1, MAX_RING + 1)),
        np.empty((MAX_RING + 1, MAX_RING + 1), np.int64),
        np.empty((MAX_NEW, 4), np.int32),
        np.empty((MAX_NEW, 4), np.int32),
    )
    stack = np.empty(len(queue) + 64 * MAX_NEW, np.int32)
    for row in queue:
        stack[0], top = row, 1
        while top:
            top -= 1
            e = stack[top]
            if mesh.cells[e, 0] < 0 or mesh.mu2[e] <= threshold:
                continue
            size = _improve_cell(mesh, tree, e, tally, work)
            for i in range(size):
                if mesh.mu2[work[0][i]] > threshold and top < len(stack):
                    stack[top] = work[0][i]
                    top += 1


def improve(mesh: Swappable, tree: SurfaceTree, threshold: float) -> SwapCount:
    """Swap around tetrahedra with mu^2 above `threshold`, worst first, where that improves them. Changes `mesh`."""
    tally = np.zeros(6)
    bad = np.flatnonzero(mesh.mu2[: mesh.counters[0]] > threshold).astype(np.int32)
    _improve(mesh, tree, bad[np.argsort(-mesh.mu2[bad], kind="stable")], threshold, tally)
    return SwapCount._make([*map(int, tally[:5]), float(tally[5])])
