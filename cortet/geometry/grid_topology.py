"""Sets of grid points with the topology of a ball.

The surface around the points is that of VTK's flying edges: points inside are joined along the edges of the grid,
points outside along edges and across faces as well. A point may join a set if its neighbours inside the set that touch
it are connected, and so are those outside (Bertrand and Malandain, Pattern Recognition Letters 15, 1994). The set then
keeps its topology. So a set that grows from one point by such points alone, the deepest first, stays a ball: handles
are cut where they are thinnest. If the outside grows instead, tunnels are closed where they are narrowest, and cavities
are filled. The idea is that of topology-preserving fast marching (Bazin and Pham, Medical Image Analysis 11, 2007).

Each handle should be mended in the way that changes fewer points. So cuts and fillings of few points are made first,
and larger ones only where they are still needed (after Han et al., IEEE Transactions on Medical Imaging 21, 2002). Of
several pieces, the largest is kept.
"""

from __future__ import annotations

import heapq
from itertools import product

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import generate_binary_structure, label

from cortet.meshes import FloatArray

#: most points of the cuts and fillings of each early round; of the larger, the kind that changes fewer points is made
_SMALL = (4, 32, 256)
#: from a point to its 26 neighbours
STEPS = np.array([step for step in product((-1, 0, 1), repeat=3) if any(step)])
#: along how many axes two points may differ, inside and outside, and still be joined
_INSIDE, _OUTSIDE = 1, 2


def _links(most: int) -> tuple[NDArray[np.int64], int]:
    """Which neighbours each neighbour is joined to, (26,), and which the point itself, as bits: 1 << j for the j-th."""
    apart = np.abs(STEPS[:, None] - STEPS)
    joined = (apart.max(axis=2) == 1) & (apart.sum(axis=2) <= most)
    bits = 1 << np.arange(len(STEPS))
    return (joined * bits).sum(axis=1), int(bits[np.abs(STEPS).sum(axis=1) <= most].sum())


#: for points inside, and for those outside
LINKS = (_links(_INSIDE), _links(_OUTSIDE))


def as_ball(depth: FloatArray) -> NDArray[np.bool_]:
    """The points of positive depth, after changes that make them a ball.

    Parameters
    ----------
    depth : (a, b, c), never 0; negative on the border of the grid. Points of larger magnitude change sides later
    """
    inside = _largest(depth > 0)
    steps = np.array([np.ravel_multi_index(tuple(1 + step), depth.shape) for step in STEPS])
    steps -= np.ravel_multi_index((1, 1, 1), depth.shape)
    border = np.ones(depth.shape, np.bool_)
    border[1:-1, 1:-1, 1:-1] = False
    own, other = LINKS

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
        inside = inside & ~_pieces(inside & ~ball, size, _INSIDE)
        if np.array_equal(ball, inside):
            return ball
        inside = inside | _pieces(filled(inside) & ~inside, size, _OUTSIDE)
        ball = cut(inside)
    return min(ball, filled(inside), key=lambda one: np.count_nonzero(one != inside))


def _pieces(points: NDArray[np.bool_], size: int, most: int) -> NDArray[np.bool_]:
    """The connected pieces of at most `size` points of a set; `most` is that of `_links`."""
    piece, _ = label(points, generate_binary_structure(3, most))
    few = np.bincount(piece.ravel()) <= size
    few[0] = False
    return np.asarray(few[piece])


def _largest(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected piece."""
    piece, count = label(inside)
    return piece == 1 + np.bincount(piece.ravel(), minlength=count + 1)[1:].argmax()


@numba.njit(cache=True, error_model="numpy")
def _grown(start, value, border, steps, own, other):  # type: ignore[no-untyped-def]
    """A set grown from one point: points of positive value join, the highest first, if the topology stays.

    `own` and `other` are the `LINKS` of this set, and of what is left.
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
