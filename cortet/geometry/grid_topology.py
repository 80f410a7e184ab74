"""Sets of grid points with the topology of a ball, and the surfaces around them.

Each cube of the grid is cut into six tetrahedra, all along the same diagonal (Freudenthal). A point may join a set of
grid points if its neighbours inside the set are connected, and so are its neighbours outside. They then split the
sphere of its 14 neighbours into two discs, and the set keeps its topology. On cubes, points inside and outside are
joined in different ways; there the same holds of those neighbours that touch the point (Bertrand and Malandain, Pattern
Recognition Letters 15, 1994). So a set that grows from one point by such points alone, the deepest first, stays a ball:
handles are cut where they are thinnest. If the outside grows instead, tunnels are closed where they are narrowest, and
cavities are filled. The idea is that of topology-preserving fast marching (Bazin and Pham, Medical Image Analysis 11,
2007).

Each handle should be mended in the way that changes fewer points. So cuts and fillings of few points are made first,
and larger ones only where they are still needed (after Han et al., IEEE Transactions on Medical Imaging 21, 2002). Of
several pieces, the largest is kept.
"""

from __future__ import annotations

import heapq
from itertools import permutations, product
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from cortet.meshes import FloatArray, IntArray

#: most points of the cuts and fillings of each early round; of the larger, the kind that changes fewer points is made
_SMALL = (4, 32, 256)
#: distance to the surface, in spacings, given to a point that changes sides to correct the topology
_CHANGED = 0.25
#: least distance, as a share of an edge of the grid, of the surface's cut from the ends; so no triangle is flat
_CLOSEST = 0.1

#: corners of a cube, x fastest, and its tetrahedra
_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
_TETS = np.array([[0, a, a | b, 7] for a, b, _ in permutations((1, 2, 4))])


class Grid(NamedTuple):
    """Which of the k neighbours of a grid point are joined to each other, as bits: 1 << j for neighbour j."""

    #: (k, 3), from the point to each
    steps: NDArray[np.int64]
    #: for points inside and for those outside: (k,), the neighbours that each is joined to; and those that touch the
    #: point itself
    joined: tuple[NDArray[np.int64], NDArray[np.int64]]
    near: tuple[int, int]


def _grid(steps: NDArray[np.int64], inside: NDArray[np.int64], outside: NDArray[np.int64]) -> Grid:
    """The grid in which points inside, and those outside, are joined by some of the steps."""
    joined, near = [], []
    for own in (inside.tolist(), outside.tolist()):
        bits = [[(b - a).tolist() in own for b in steps] for a in steps]
        joined.append(np.array([sum(1 << j for j, is_joined in enumerate(row) if is_joined) for row in bits], np.int64))
        near.append(sum(1 << j for j, step in enumerate(steps.tolist()) if step in own))
    return Grid(steps, (joined[0], joined[1]), (near[0], near[1]))


_AROUND = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step)])
_DISTANCE = np.abs(_AROUND).sum(axis=1)
#: cubes cut into the tetrahedra above, which `skin` contours
TETRAHEDRA = _grid(*[np.concatenate([_CORNERS[1:], -_CORNERS[1:]])] * 3)
#: cubes as VTK's flying edges split them: inside, points are joined along edges; outside, across faces as well
CUBES = _grid(_AROUND, _AROUND[_DISTANCE == 1], _AROUND[_DISTANCE <= 2])
#: edges of a tetrahedron that the surface cuts, in cyclic order, by the number of inside corners (numbered first)
_CUT = {1: ((0, 1), (0, 2), (0, 3)), 2: ((0, 2), (0, 3), (1, 3), (1, 2)), 3: ((0, 3), (1, 3), (2, 3))}


def as_ball(depth: FloatArray, spacing: float, grid: Grid = TETRAHEDRA) -> FloatArray:
    """Depths after changes that make the inside a ball.

    Parameters
    ----------
    depth : (a, b, c), positive inside, never 0; outside on the border of the grid. Points of larger magnitude change
        sides later
    spacing : of the points, in the unit of the depths
    grid : which points are joined
    """
    joined, apart = _mask(grid, 0), _mask(grid, 1)
    inside = _largest(depth > 0, joined)
    steps = np.array([np.ravel_multi_index(tuple(1 + step), depth.shape) for step in grid.steps])
    steps -= np.ravel_multi_index((1, 1, 1), depth.shape)
    border = np.ones(depth.shape, np.bool_)
    border[1:-1, 1:-1, 1:-1] = False
    own, other = zip(grid.joined, grid.near, strict=True)

    def cut(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The set without the points that close its handles."""
        value = np.where(inside, np.abs(depth), -1.0)
        start = np.zeros(depth.shape, np.bool_)
        start.flat[value.argmax()] = True
        return np.asarray(_grown(start.ravel(), value.ravel(), border.ravel(), steps, own, other)).reshape(depth.shape)

    def filled(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The set with the points that close its tunnels and cavities."""
        value = np.where(inside, -1.0, np.abs(depth))
        outside = _grown(border.ravel(), value.ravel(), border.ravel(), steps, other, own)
        return ~np.asarray(outside).reshape(depth.shape)

    ball = cut(inside)
    for size in _SMALL:
        inside = inside & ~_pieces(inside & ~ball, size, joined)
        if np.array_equal(ball, inside):
            break
        inside = inside | _pieces(filled(inside) & ~inside, size, apart)
        ball = cut(inside)
    else:
        ball = min(ball, filled(inside), key=lambda one: np.count_nonzero(one != inside))
    return np.where(ball == (depth > 0), depth, np.where(ball, _CHANGED, -_CHANGED) * spacing)


def _mask(grid: Grid, side: int) -> NDArray[np.bool_]:
    """The neighbours that a point inside (0) or outside (1) is joined to: (3, 3, 3)."""
    mask = np.zeros((3, 3, 3), np.bool_)
    touching = [grid.near[side] >> k & 1 == 1 for k in range(len(grid.steps))]
    mask[tuple((1 + grid.steps[touching]).T)] = True
    return mask


def _pieces(points: NDArray[np.bool_], size: int, joined: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The connected pieces of at most `size` points of a set."""
    piece, _ = label(points, joined)
    few = np.bincount(piece.ravel()) <= size
    few[0] = False
    return np.asarray(few[piece])


def _largest(inside: NDArray[np.bool_], joined: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected piece."""
    piece, count = label(inside, joined)
    return piece == 1 + np.bincount(piece.ravel(), minlength=count + 1)[1:].argmax()


@numba.njit(cache=True, error_model="numpy")
def _grown(start, value, border, steps, own, other):  # type: ignore[no-untyped-def]
    """A set grown from one point: points of positive value join, the highest first, if the topology stays.

    `own` and `other` are a row of `Grid.joined` and an item of `Grid.near` each: of this set, and of what is left.
    """
    inside, queued = start.copy(), start.copy()
    heap = [(0.0, 0)]
    heap.pop()
    for v in range(len(start)):
        if start[v]:
            for step in steps:
                n = v + step
                if 0 <= n < len(value) and not border[n] and not queued[n] and value[n] > 0:
                    queued[n] = True
                    heap.append((-value[n], n))
    heapq.heapify(heap)
    while heap:
        v = heapq.heappop(heap)[1]
        queued[v] = False
        around = 0
        for k in range(len(steps)):
            if inside[v + steps[k]]:
                around |= 1 << k
        everything = (1 << len(steps)) - 1
        if not (_hangs_together(around, *own) and _hangs_together(everything & ~around, *other)):
            continue  # the point is tried again once a neighbour has joined
        inside[v] = True
        for step in steps:
            n = v + step
            if not border[n] and not inside[n] and not queued[n] and value[n] > 0:
                queued[n] = True
                heapq.heappush(heap, (-value[n], n))
    return inside


@numba.njit(cache=True, error_model="numpy")
def _hangs_together(members, joined, near):  # type: ignore[no-untyped-def]
    """Whether at least one of some neighbours (bits) touches the point, and all that touch it are connected.

    They may be connected through others at most two steps away from them. The limit matters where points inside are
    joined along edges alone: farther ones do not fill the loop that they close.
    """
    touching = members & near
    close = touching
    for _ in range(2):
        close = _joined_to(close, members, joined)
    reached = touching & -touching
    while True:
        more = _joined_to(reached, close, joined)
        if more == reached:
            return touching != 0 and touching & ~reached == 0
        reached = more


@numba.njit(cache=True, error_model="numpy")
def _joined_to(some, members, joined):  # type: ignore[no-untyped-def]
    """`some` of the members, and all members that they are joined to."""
    more = some
    for k in range(len(joined)):
        if some >> k & 1:
            more |= joined[k] & members
    return more


def skin(depth: FloatArray) -> tuple[FloatArray, IntArray]:
    """The zero level of depths (a, b, c) that are linear in each tetrahedron: points, in spacings, and faces.

    Faces are outward. Marching tetrahedra: Doi and Koide, IEICE Transactions E74, 1991.
    """
    inside = depth > 0
    corner = np.lib.stride_tricks.sliding_window_view(inside, (2, 2, 2))
    cubes = np.argwhere(corner.any(axis=(3, 4, 5)) & ~corner.all(axis=(3, 4, 5)))
    numbers = np.ravel_multi_index(tuple((cubes[:, None] + _CORNERS).transpose(2, 0, 1)), depth.shape)
    tets = numbers[:, _TETS].reshape(-1, 4)
    held = inside.ravel()[tets]
    cut: list[IntArray] = []
    for count, edges_of_tet in _CUT.items():
        chosen = held.sum(axis=1) == count
        order = np.argsort(~held[chosen], axis=1, kind="stable")
        ring = np.take_along_axis(tets[chosen], order, axis=1)[:, np.array(edges_of_tet)]
        cut += [ring[:, [0, k, k + 1]] for k in range(1, len(edges_of_tet) - 1)]
    ends = _outward(np.concatenate(cut), depth.shape)
    edges, faces = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    a, b = depth.ravel()[edges].T
    share = np.clip(a / (a - b), _CLOSEST, 1 - _CLOSEST)[:, None]
    start, end = (np.stack(np.unravel_index(edges[:, k], depth.shape), axis=1) for k in (0, 1))
    return start + share * (end - start), faces.reshape(-1, 3).astype(np.int32)


def _outward(ends: IntArray, shape: tuple[int, ...]) -> IntArray:
    """Turn triangles so that they face outside; edges of the grid (k, 3, 2), from inside to outside, give them."""
    places = np.stack(np.unravel_index(ends, shape), axis=-1).astype(np.float64)
    middle, out = places.mean(axis=2), (places[:, :, 1] - places[:, :, 0]).sum(axis=1)
    normal = np.cross(middle[:, 1] - middle[:, 0], middle[:, 2] - middle[:, 0])
    turned = np.einsum("ka,ka->k", normal, out) < 0
    return np.where(turned[:, None, None], ends[:, ::-1], ends)
