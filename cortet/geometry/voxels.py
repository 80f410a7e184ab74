"""Values of a volume's voxels inside tetrahedra, sampled at points spread evenly in each tetrahedron.

Cutting the edges of a tetrahedron into k parts cuts it into k^3 parts of equal volume; the points are their centroids.
k grows with the longest edge in voxels, so that the points are about half a voxel apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.meshes import FloatArray, IntArray

#: parts of an edge: least (for a tetrahedron within one voxel) and most
_FEWEST, _MOST = 2, 8
#: distance of the points, voxels
_SPACING = 0.5
#: points that are looked up at a time
_BLOCK = 2**21


class Labelled(NamedTuple):
    """Labels of m tetrahedra."""

    #: (m,) the label with the largest share; the smaller one in a tie
    label: NDArray[np.int32]
    #: (m,) that share
    share: NDArray[np.float32]
    #: (m,) the label other than 0 with the largest share, 0 if there is none, and that share
    other: NDArray[np.int32]
    other_share: NDArray[np.float32]
    #: (m,) share of 0
    zero: NDArray[np.float32]


def distinct(values: NDArray[np.integer]) -> NDArray[np.integer]:
    """The distinct values of an array, ascending, without the copies that sorting it would make."""
    import pandas as pd  # here, as every export loads this module, and few have volumes

    return np.sort(pd.unique(values.ravel()))


def in_voxels(affine: FloatArray, points: FloatArray) -> FloatArray:
    """Points (n, 3) mm as voxel coordinates, which are whole numbers at voxel centres: (n, 3)."""
    inverse = np.linalg.inv(affine)
    return np.asarray(points @ inverse[:3, :3].T + inverse[:3, 3])


def labels_inside(points: FloatArray, cells: IntArray, labels: NDArray[np.int32], affine: FloatArray) -> Labelled:
    """The label of each tetrahedron: the one that fills most of it. Outside the volume it is 0.

    Parameters
    ----------
    points, cells : of a mesh, (n, 3) mm and (m, 4)
    labels : (i, j, k) whole numbers
    affine : (4, 4) from voxels to mm
    """
    keys = np.union1d(distinct(labels), [0])
    outside, values = int(np.searchsorted(keys, 0)), labels.ravel()
    label, other = np.zeros(len(cells), np.int32), np.zeros(len(cells), np.int32)
    share, other_share, zero = (np.zeros(len(cells), np.float32) for _ in range(3))
    for chosen, voxel in _samples(points, cells, affine, labels.shape):
        found = np.where(voxel < 0, outside, np.searchsorted(keys, values[voxel]))
        flat = np.arange(len(chosen))[:, None] * len(keys) + found
        count = np.bincount(flat.ravel(), minlength=len(chosen) * len(keys)).reshape(-1, len(keys))
        part = count / np.float32(voxel.shape[1])
        label[chosen], share[chosen], zero[chosen] = keys[part.argmax(axis=1)], part.max(axis=1), part[:, outside]
        part[:, outside] = 0
        other_share[chosen] = part.max(axis=1)
        other[chosen] = np.where(other_share[chosen] > 0, keys[part.argmax(axis=1)], 0)
    return Labelled(label, share, other, other_share, zero)


def means_inside(
    points: FloatArray, cells: IntArray, values: NDArray[Any], affine: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The mean of the voxels inside each tetrahedron, (m,) or (m, c), and which tetrahedra hold no value.

    A tetrahedron that holds none gets the value of the nearest voxel that has one.

    Parameters
    ----------
    values : (i, j, k) or (i, j, k, c); voxels with a number that is not finite have no value
    """
    held = np.isfinite(values).reshape(*values.shape[:3], -1).all(axis=-1)
    table = np.where(held.reshape(-1, 1), values.reshape(held.size, -1), 0)
    has = held.ravel()
    result, empty = np.zeros((len(cells), table.shape[1])), np.zeros(len(cells), np.bool_)
    for chosen, voxel in _samples(points, cells, affine, values.shape[:3]):
        valid = (voxel >= 0) & has[voxel]
        count = valid.sum(axis=1)
        total = (table[voxel].astype(float) * valid[:, :, None]).sum(axis=1)
        result[chosen] = total / np.maximum(count, 1)[:, None]
        empty[chosen] = count == 0
    if empty.any():
        from scipy import ndimage

        nearest = ndimage.distance_transform_edt(~held, np.linalg.norm(affine[:3, :3], axis=0), False, True)
        centre = np.rint(in_voxels(affine, points[cells[empty]].mean(axis=1))).astype(int)
        centre = np.clip(centre, 0, np.array(held.shape) - 1)
        result[empty] = table[np.ravel_multi_index(nearest[:, *centre.T], held.shape)]
    return result.reshape(len(cells), *values.shape[3:]), empty


def _samples(
    points: FloatArray, cells: IntArray, affine: FloatArray, shape: tuple[int, ...]
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Batches of tetrahedra (c,) and the voxel number at each of their points (c, s), -1 outside the volume."""
    where = in_voxels(affine, points)
    longest = np.zeros(len(cells))
    for one, other in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)):
        longest = np.maximum(longest, np.linalg.norm(where[cells[:, one]] - where[cells[:, other]], axis=1))
    parts = np.clip(np.ceil(longest / _SPACING), _FEWEST, _MOST).astype(int)
    for k in np.unique(parts).tolist():
        weights = _centroids(k)
        mine = np.flatnonzero(parts == k)
        step = max(1, _BLOCK // len(weights))
        for at in range(0, len(mine), step):
            chosen = mine[at : at + step]
            voxel = np.rint(np.einsum("sc,mcj->msj", weights, where[cells[chosen]])).astype(np.intp)
            within = ((voxel >= 0) & (voxel < shape[:3])).all(axis=2)
            number = (voxel[..., 0] * shape[1] + voxel[..., 1]) * shape[2] + voxel[..., 2]
            yield chosen, np.where(within, number, -1)


def _centroids(k: int) -> FloatArray:
    """Barycentric coordinates of the centroids of k^3 parts of a tetrahedron, all of equal volume: (k^3, 4).

    Edgewise subdivision (Edelsbrunner and Grayson, Discrete & Computational Geometry 24, 2000): in coordinates that
    rise along a path of edges it is a grid of cubes, each cut into six.
    """
    corner = np.indices((k, k, k)).reshape(3, -1).T
    within = np.array(list(permutations((0.25, 0.5, 0.75))))
    rising = (corner[:, None] + within).reshape(-1, 3) / k
    rising = rising[(np.diff(rising, axis=1) > 0).all(axis=1)]
    return np.diff(rising, axis=1, prepend=0, append=1)
