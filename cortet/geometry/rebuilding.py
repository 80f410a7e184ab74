"""A surface made anew on a grid: it encloses what triangles wind around, and has the topology of a sphere.

The grid is cut into tetrahedra, six for each of its cubes, all along the same diagonal (Freudenthal). A point may join
a set of grid points if its neighbours inside the set hang together, and its neighbours outside the set, too. They then
part the sphere of its 14 neighbours into two discs, and the set keeps its topology. So a set that grows from one point
by such points alone, the deepest first, stays a ball; handles are cut where they are thinnest. If the outside grows
instead, tunnels are closed where they are narrowest, and cavities are filled. Of both ways, the one that changes fewer
points is taken; of several pieces, the largest. The idea is that of topology-preserving fast marching (Bazin and Pham,
Medical Image Analysis 11, 2007).
"""

from __future__ import annotations

import heapq
from itertools import permutations

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from cortet.errors import InputError
from cortet.geometry.closest_point import closer_than, closest_points, tree_of
from cortet.geometry.mending import measurable
from cortet.geometry.topology import enclosed_volume
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FloatArray, IntArray, TriSurface

#: most points that a grid may have
MOST_POINTS = 60_000_000
#: in spacings: margin of the grid around the triangles, and the distance up to which distances are exact
_MARGIN, _FARTHEST = 3, 2.0
#: distance to the surface, in spacings, of a point that changes sides for the topology's sake
_CHANGED = 0.25
#: the surface cuts an edge of the grid no closer to its ends, so that no triangle is flat
_CLOSEST = 0.1

#: corners of a cube, x fastest, and its tetrahedra
_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
_TETS = np.array([[0, a, a | b, 7] for a, b, _ in permutations((1, 2, 4))])
#: steps from a point to its neighbours along edges of these tetrahedra; bits say which neighbours are joined
_STEPS = np.concatenate([_CORNERS[1:], -_CORNERS[1:]])
_JOINED = np.array(
    [sum(1 << j for j, b in enumerate(_STEPS) if (b - a).tolist() in _STEPS.tolist()) for a in _STEPS], np.int64
)
#: edges of a tetrahedron that the surface cuts, in cyclic order, by the number of corners inside, which come first
_CUT = {1: ((0, 1), (0, 2), (0, 3)), 2: ((0, 2), (0, 3), (1, 3), (1, 2)), 3: ((0, 3), (1, 3), (2, 3))}


def rebuilt(surface: TriSurface, spacing: float) -> tuple[TriSurface, float]:
    """A sphere around all points that triangles wind around more than half a time, and the volume of these points.

    Parameters
    ----------
    surface : triangles that agree in their orientation nearly everywhere; they need not be closed
    spacing : mm, spacing of the grid

    Returns
    -------
    the surface; and the volume inside before the topology is set right, mm3

    Raises
    ------
    InputError
        the grid would have too many points, or nothing is inside
    """
    file = measurable(surface)
    corners = file.points[file.faces].reshape(-1, 3)
    low = corners.min(axis=0) - _MARGIN * spacing
    shape = np.ceil((corners.max(axis=0) + _MARGIN * spacing - low) / spacing).astype(np.int64) + 1
    if shape.prod() > MOST_POINTS:
        raise InputError(
            f"a grid of {spacing:g} mm would have {shape.prod():,} points, more than {MOST_POINTS:,}",
            remedy="set a larger repair.spacing",
        )
    depth = depths_on_grid(file, low, shape, spacing)
    if not (depth > 0).any():
        raise InputError("the triangles enclose nothing", remedy="set a smaller repair.spacing, or export it again")
    wound, ball = skin(depth), as_ball(depth, spacing)
    points, faces = wound if np.array_equal(ball, depth) else skin(ball)
    return TriSurface(low + spacing * points, faces), enclosed_volume(*wound) * spacing**3


def depths_on_grid(file: TriSurface, low: FloatArray, shape: NDArray[np.int64], spacing: float) -> FloatArray:
    """Distance of grid points to triangles, mm, negative outside: (*shape). Beyond two spacings it is rough."""
    tree, depth = tree_of(file), np.empty(shape)
    y, z = (low[axis] + spacing * np.arange(shape[axis]) for axis in (1, 2))
    plane = np.stack([np.zeros(shape[1:]), *np.meshgrid(y, z, indexing="ij")], axis=-1).reshape(-1, 3)
    for i in range(shape[0]):
        plane[:, 0] = low[0] + spacing * i
        near = closer_than(tree, plane, _FARTHEST * spacing)
        away = np.full(len(plane), _FARTHEST * spacing)
        away[near] = closest_points(tree, plane[near]).distances
        inside = winding_numbers(file, plane) > 0.5
        depth[i] = np.where(inside, away, -away).reshape(shape[1:])
    inside = depth > 0
    for side, sign in ((inside, 1), (~inside, -1)):
        far = np.abs(depth) == _FARTHEST * spacing
        steps = distance_transform_edt(side)
        depth[side & far] = sign * spacing * np.maximum(steps[side & far], _FARTHEST)
    return depth


def as_ball(depth: FloatArray, spacing: float) -> FloatArray:
    """Depths (a, b, c) after changes that make the inside a ball; the border of the grid must be outside."""
    inside = _largest(depth > 0)
    steps = np.array([np.ravel_multi_index(tuple(1 + step), depth.shape) for step in _STEPS])
    steps -= np.ravel_multi_index((1, 1, 1), depth.shape)
    value = np.where(inside, depth, -np.abs(depth))
    start = np.zeros(depth.shape, np.bool_)
    start.flat[value.argmax()] = True
    border = np.ones(depth.shape, np.bool_)
    border[1:-1, 1:-1, 1:-1] = False
    grown = _grown(start.ravel(), value.ravel(), border.ravel(), steps, _JOINED).reshape(depth.shape)
    shrunk = ~_grown(border.ravel(), -value.ravel(), border.ravel(), steps, _JOINED).reshape(depth.shape)
    ball = min(grown, shrunk, key=lambda one: np.count_nonzero(one != inside))
    return np.where(ball == (depth > 0), depth, np.where(ball, _CHANGED, -_CHANGED) * spacing)


def _largest(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest connected piece."""
    together = np.zeros((3, 3, 3), np.bool_)
    together[tuple((1 + _STEPS).T)] = True
    piece, count = label(inside, together)
    return piece == 1 + np.bincount(piece.ravel(), minlength=count + 1)[1:].argmax()


@numba.njit(cache=True)
def _grown(start, value, border, steps, joined):  # type: ignore[no-untyped-def]
    """A set grown from one point: points of positive value join, the highest first, if its topology does not change."""
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
        if not (_hangs_together(around, joined) and _hangs_together(everything & ~around, joined)):
            continue  # the point is tried again once a neighbour has joined
        inside[v] = True
        for step in steps:
            n = v + step
            if not border[n] and not inside[n] and not queued[n] and value[n] > 0:
                queued[n] = True
                heapq.heappush(heap, (-value[n], n))
    return inside


@numba.njit(cache=True)
def _hangs_together(members, joined):  # type: ignore[no-untyped-def]
    """Whether the given neighbours of a point, as bits, are at least one and hang together."""
    reached = members & -members
    while True:
        more = reached
        for k in range(len(joined)):
            if reached >> k & 1:
                more |= joined[k] & members
        if more == reached:
            return members != 0 and reached == members
        reached = more


def skin(depth: FloatArray) -> tuple[FloatArray, IntArray]:
    """The zero level of depths (a, b, c), linear in the tetrahedra of a grid: points, in spacings, and faces.

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
    """Turn triangles, given by edges of the grid (k, 3, 2) from inside to outside, so that they face outside."""
    places = np.stack(np.unravel_index(ends, shape), axis=-1).astype(np.float64)
    middle, out = places.mean(axis=2), (places[:, :, 1] - places[:, :, 0]).sum(axis=1)
    normal = np.cross(middle[:, 1] - middle[:, 0], middle[:, 2] - middle[:, 0])
    turned = np.einsum("ka,ka->k", normal, out) < 0
    return np.where(turned[:, None, None], ends[:, ::-1], ends)
