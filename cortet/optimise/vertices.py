"""Move vertices so that the worst tetrahedron improves; connectivity stays.

For one vertex v at a time, minimise E(x) = sum of mu^p over its tetrahedra, mu = 1 / (1 - q) = l_rms^3 / (sqrt(2) 6V).
This takes a Newton step with the positive-definite part of the Hessian and backtracking. A move is kept only if E
falls and every volume stays positive. Large p approaches min-max. A boundary vertex that slides takes its step in the
tangent plane of the input surface and is projected back onto that surface before E is compared.

Vertices are visited in runs of consecutive indices. Runs that share no tetrahedron have one colour and are visited at
the same time. None reads what another writes, so the bits of a result are the same for any number of threads.
"""
# Numba's parallel loops take no named tuples: these are passed as plain tuples and get their names back inside.

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.config.section import Boundary
from cortet.geometry import topology
from cortet.geometry.closest_point import SurfaceTree, closest_point, first_triangles, triangle_normal
from cortet.measure.quality import quality
from cortet.meshes import FloatArray, IntArray, TetMesh
from cortet.optimise.star import (
    MU2,
    WIDE,
    derivatives,
    empty_star,
    energy,
    mu2_of,
    newton_step,
    q_of,
    set_column,
    tangent_step,
)

#: while the mean improves, q may rise to this, or to the worst around the vertex if higher; a lower value costs mean
KEPT = 0.34
#: how a vertex may move
FIXED, FREE, SLIDING = 0, 1, 2

_BACKTRACKS, _SHRINK = 6, 0.4
#: a move must lower E by this fraction, or it is not worth the visits to the neighbours that follow
_MIN_GAIN = 1e-5
#: nor is a vertex of a lattice worth a visit: the worst mu^2 around it is at most this multiple of the least
_EQUAL = 1 + 1e-6
#: a sliding move keeps each boundary face within acos(this) of the surface below its vertex, or no farther than before
_MIN_FACE_COSINE = 0.3
#: vertices in a run: many, so that their data stay in the cache; few, so that a colour has many runs
_RUN = 512

logger = logging.getLogger(__name__)


class Patches(NamedTuple):
    """The neighbourhood of each of the n vertices of a mesh with m tetrahedra and k boundary faces."""

    #: (m, 4) int32
    cells: IntArray
    #: tetrahedra around v: around[offsets[v]:offsets[v + 1]]; v is corner corners[...] of each
    offsets: np.ndarray
    around: IntArray
    corners: np.ndarray
    #: boundary (and interface) faces around v: (v, *rims[i]) is outward for i in rim_offsets[v]:rim_offsets[v + 1]
    rim_offsets: np.ndarray
    rims: IntArray
    #: (n,) int8, FIXED, FREE or SLIDING
    freedom: np.ndarray


class State(NamedTuple):
    """What the kernels change in place."""

    #: (n, 3) float64 mm
    points: FloatArray
    #: (m,) float64, mu^2 of each tetrahedron
    mu2: FloatArray
    #: (n,) int32, triangle of the surface tree that each sliding vertex lies on
    on_triangle: IntArray
    #: (n,) bool, whether something around the vertex has changed since it was last tried
    stale: np.ndarray


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _locate(points, tree, freedom, on_triangle):  # type: ignore[no-untyped-def]
    """Find the surface triangle under every sliding vertex; `on_triangle` is one of its surface, -1 the first."""
    for v in numba.prange(len(points)):
        if freedom[v] == SLIDING:
            on_triangle[v] = closest_point(
                SurfaceTree(*tree), points[v, 0], points[v, 1], points[v, 2], on_triangle[v]
            )[3]


@numba.njit(cache=True, error_model="numpy")
def _gather(points, p, v, star):  # type: ignore[no-untyped-def]
    """Describe the tetrahedra around v, with v at the origin: V' = d - n.x and 6 S = 3 x.x - 2 m.x + k.

    Fills a column n, d, m, k of `star` for each and returns their number.
    """
    ox, oy, oz = points[v]
    cells = p.cells
    size = 0
    for i in range(p.offsets[v], p.offsets[v + 1]):
        e, corner = p.around[i], p.corners[i]
        if corner == 0:
            a, b, c = cells[e, 1], cells[e, 2], cells[e, 3]
        elif corner == 1:
            a, b, c = cells[e, 0], cells[e, 3], cells[e, 2]
        elif corner == 2:
            a, b, c = cells[e, 0], cells[e, 1], cells[e, 3]
        else:
            a, b, c = cells[e, 0], cells[e, 2], cells[e, 1]
        ax, ay, az = points[a, 0] - ox, points[a, 1] - oy, points[a, 2] - oz
        bx, by, bz = points[b, 0] - ox, points[b, 1] - oy, points[b, 2] - oz
        cx, cy, cz = points[c, 0] - ox, points[c, 1] - oy, points[c, 2] - oz
        set_column(star, size, ax, ay, az, bx, by, bz, cx, cy, cz)
        size += 1
    return size


@numba.njit(cache=True, error_model="numpy")
def _lowest_cosine(points, p, v, x, y, z, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Smallest cosine between n and the normals of the boundary faces around v, with v at (x, y, z)."""
    lowest = 1.0
    for i in range(p.rim_offsets[v], p.rim_offsets[v + 1]):
        b, c = p.rims[i]
        ux, uy, uz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
        vx, vy, vz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
        fx, fy, fz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(fx * fx + fy * fy + fz * fz)
        lowest = min(lowest, (fx * nx + fy * ny + fz * nz) / length if length > 0 else -1.0)
    return lowest


@numba.njit(cache=True, error_model="numpy")
def _move(state, p, tree, v, half_power, cap, crests, star):  # type: ignore[no-untyped-def]
    """Try to improve one vertex; True if it moved."""
    points = state.points
    size = _gather(points, p, v, star)
    before = energy(star, size, 0.0, 0.0, 0.0, half_power, np.inf)
    slopes = derivatives(star, size, half_power)
    ox, oy, oz = points[v]
    on_triangle = state.on_triangle[v]
    sliding = p.freedom[v] == SLIDING
    nx = ny = nz = lowest = 0.0
    if sliding:
        nx, ny, nz = triangle_normal(tree.corners[on_triangle])
        lowest = min(_MIN_FACE_COSINE, _lowest_cosine(points, p, v, ox, oy, oz, nx, ny, nz))
        if crests and lowest < 0:
            lowest = -1.0
        sx, sy, sz = tangent_step(slopes, nx, ny, nz)
    else:
        sx, sy, sz = newton_step(slopes)
    # E is convex: no part of the step lowers it by more than this
    if not -(slopes[0] * sx + slopes[1] * sy + slopes[2] * sz) > _MIN_GAIN * before:
        return False
    scale = 1.0
    for _ in range(_BACKTRACKS):
        x, y, z = scale * sx, scale * sy, scale * sz
        scale *= _SHRINK
        if sliding:
            px, py, pz, on_triangle, _, _, _ = closest_point(tree, ox + x, oy + y, oz + z, state.on_triangle[v])
            x, y, z = px - ox, py - oy, pz - oz
        if not energy(star, size, x, y, z, half_power, cap) < before * (1 - _MIN_GAIN):
            continue
        if sliding:
            mx, my, mz = triangle_normal(tree.corners[on_triangle])
            across = nx * mx + ny * my + nz * mz <= 0  # the step ended on the opposite bank of a sulcus or blade
            if across or _lowest_cosine(points, p, v, ox + x, oy + y, oz + z, mx, my, mz) < lowest:
                continue
            state.on_triangle[v] = on_triangle
            points[v, 0], points[v, 1], points[v, 2] = px, py, pz
        else:
            points[v, 0], points[v, 1], points[v, 2] = ox + x, oy + y, oz + z
        first = p.offsets[v]
        for i in range(size):
            state.mu2[p.around[first + i]] = star[MU2 + i]
        return True
    return False


@numba.njit(cache=True, error_model="numpy")
def _choose(wanted, state, p, threshold):  # type: ignore[no-untyped-def]
    """Set `wanted` for the stale vertices of the tetrahedra with mu^2 above `threshold`."""
    wanted[:] = False
    for e in range(len(state.mu2)):
        if state.mu2[e] > threshold:
            for k in range(4):
                v = p.cells[e, k]
                wanted[v] = state.stale[v] and p.freedom[v] != FIXED


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _sweep(state, patches, tree, runs, starts, half_power, threshold, cap, crests, most):  # type: ignore[no-untyped-def]
    """Visit the stale vertices of tetrahedra with mu^2 above `threshold`, `most` times or until none moves.

    Runs of one colour, which share no tetrahedron, are visited at the same time. Returns the number of sweeps.
    """
    wanted = np.empty(len(state[0]), np.bool_)
    for sweep in range(most):
        _choose(wanted, State(*state), Patches(*patches), threshold)
        moved = 0
        for colour in range(len(starts) - 1):
            for i in numba.prange(starts[colour], starts[colour + 1]):
                moved += _visit_run(
                    runs[i], wanted, State(*state), Patches(*patches), SurfaceTree(*tree), half_power, cap, crests
                )
        if moved == 0:
            return sweep + 1
    return most


@numba.njit(cache=True, error_model="numpy")
def _visit_run(run, wanted, state, p, tree, half_power, cap, crests):  # type: ignore[no-untyped-def]
    """Visit the vertices of one run in index order.

    No tetrahedron rises above `cap`, or above the worst around its vertex if higher. Returns the number of moves.
    """
    star = empty_star()
    moved = 0
    for v in range(run * _RUN, min(len(wanted), (run + 1) * _RUN)):
        if not (wanted[v] and state.stale[v]):
            continue
        state.stale[v] = False
        worst, least = 0.0, np.inf
        for i in range(p.offsets[v], p.offsets[v + 1]):
            worst, least = max(worst, state.mu2[p.around[i]]), min(least, state.mu2[p.around[i]])
        if worst <= _EQUAL * least:
            continue
        if _move(state, p, tree, v, half_power, max(cap, worst), crests, star):
            moved += 1
            for i in range(p.offsets[v], p.offsets[v + 1]):
                for j in range(4):
                    state.stale[p.cells[p.around[i], j]] = True
    return moved


def _colours(patches: Patches) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Runs by colour: no tetrahedron has vertices in two runs of one colour; and where each colour begins."""
    colour = _coloured(patches.cells, patches.offsets, patches.around)
    return np.argsort(colour, kind="stable"), np.r_[0, np.cumsum(np.bincount(colour))]


@numba.njit(cache=True, error_model="numpy")
def _coloured(cells, offsets, around):  # type: ignore[no-untyped-def]
    """The lowest colour for each run that no earlier run beside it has."""
    vertices = len(offsets) - 1
    count = -(-vertices // _RUN)
    colour, taken = np.full(count, -1), np.full(count + 1, -1)
    for run in range(count):
        for v in range(run * _RUN, min(vertices, (run + 1) * _RUN)):
            for i in range(offsets[v], offsets[v + 1]):
                for k in range(4):
                    taken[colour[cells[around[i], k] // _RUN]] = run  # -1 (no colour yet) is the last entry
        colour[run] = 0
        while taken[colour[run]] == run:
            colour[run] += 1
    return colour


class Pass(NamedTuple):
    """A series of sweeps towards one aim."""

    #: only vertices of tetrahedra with q above this are moved
    threshold: float
    #: p of the energy, even
    power: int
    #: at most this many sweeps
    sweeps: int
    #: no tetrahedron may rise above this q, or above the worst one around the vertex that moves if that is higher. The
    #: worst of the whole mesh is not the limit: then one bad spot would let all others become as bad
    keep: float = 1.0
    #: whether a vertex with a face that looks away from the surface below it, as beside a sharp crest, may turn it
    #: further: else it could hardly move along the crest
    crests: bool = False


@dataclass(frozen=True)
class PassReport:
    """The result of one pass."""

    threshold: float
    power: int
    sweeps: int
    q_mean: float
    q_max: float


def move_vertices(
    mesh: TetMesh,
    tree: SurfaceTree,
    passes: Sequence[Pass],
    *,
    boundary: Boundary,
    held: IntArray | Sequence[int] = (),
) -> tuple[TetMesh, tuple[PassReport, ...]]:
    """Run passes over a mesh whose volumes are all positive.

    Parameters
    ----------
    tree : of the surface that boundary vertices slide on. If it is a forest, the vertices of each interface are treated
        like those of the boundary, on the surface of that interface
    boundary : `slide` along the surface, stay `fixed`, or move `free` like interior vertices
    held : vertices that stay where they are
    """
    count = len(mesh.points)
    freedom = np.full(count, FREE, np.int8)
    freedom[topology.boundary_nodes(mesh)] = {"slide": SLIDING, "fixed": FIXED, "free": FREE}[boundary]
    on_triangle = interface_triangles(mesh, tree)
    freedom[on_triangle >= 0] = {"slide": SLIDING, "fixed": FIXED, "free": FREE}[boundary]
    sheets = topology.boundary_faces(mesh)
    if (on_triangle >= 0).any():
        sheets = np.concatenate([sheets, topology.interfaces(mesh).faces])
    freedom[np.asarray(held, np.int32)] = FIXED
    patches = _patches(mesh, freedom, sheets)
    points = mesh.points.copy()
    mu2 = np.asarray(mu2_of(quality(points, mesh.cells)))
    state = State(points, mu2, on_triangle, np.empty(count, np.bool_))
    _locate(points, tuple(tree), freedom, state.on_triangle)
    runs, starts = _colours(patches)
    done = tuple(_run(aim, state, patches, tree, runs, starts) for aim in passes)
    return replace(mesh, points=state.points), done


def interface_triangles(mesh: TetMesh, tree: SurfaceTree) -> IntArray:
    """If `tree` is a forest: for each vertex of an interface, a triangle of the surface it lies on; else -1: (n,)."""
    on_triangle = np.full(len(mesh.points), -1, np.int32)
    first = first_triangles(tree)
    if len(first) > 1:
        found = topology.interfaces(mesh)
        on_triangle[found.faces] = first[found.region - 1][:, None]
    return on_triangle


def _patches(mesh: TetMesh, freedom: np.ndarray, faces: IntArray) -> Patches:
    """The neighbourhood of each vertex; `faces` (k, 3) are those that lie on surfaces."""
    tets = topology.incidence(mesh.cells, len(mesh.points))
    # a mesh of another program may have a vertex with more tetrahedra than a star has room for
    freedom = np.where(np.diff(tets.offsets) > WIDE, FIXED, freedom).astype(np.int8)
    fans = topology.incidence(faces, len(mesh.points))
    turn = (fans.corners[:, None] + np.array([1, 2])) % 3
    rims = np.ascontiguousarray(faces[fans.cells[:, None], turn])
    return Patches(mesh.cells, tets.offsets, tets.cells, tets.corners, fans.offsets, rims, freedom)


def _run(
    aim: Pass,
    state: State,
    patches: Patches,
    tree: SurfaceTree,
    runs: NDArray[np.int64],
    starts: NDArray[np.int64],
) -> PassReport:
    """Sweep until nothing moves any more or `aim.sweeps` are done. Changes `state`."""
    state.stale[:] = True
    threshold = float(mu2_of(aim.threshold)) if aim.threshold > 0 else 0.0
    cap = float(mu2_of(aim.keep)) if aim.keep < 1 else np.inf
    powers = aim.power // 2, threshold, cap, aim.crests
    sweeps = _sweep(tuple(state), tuple(patches), tuple(tree), runs, starts, *powers, aim.sweeps)
    q = q_of(state.mu2)
    logger.info("vertices with q > %g, p = %d: %d sweeps, q mean %.4f, max %.4f", *aim[:2], sweeps, q.mean(), q.max())
    return PassReport(aim.threshold, aim.power, sweeps, float(q.mean()), float(q.max()))
