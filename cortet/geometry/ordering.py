"""Number nodes and tetrahedra so that neighbours in space are neighbours in memory.

Meshers number nodes in the order of insertion. Every later step walks from a node to the tetrahedra around it and to
their nodes. Numbered along a space-filling curve, these lie in the same cache lines.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cortet.meshes import FloatArray, IntArray

#: log2 of the cells of the curve along each axis; three axes fill 60 of the 63 bits of a key
_BITS = 20


def curve_order(points: FloatArray) -> NDArray[np.int64]:
    """Indices of `points` (n, 3) sorted along a Morton (Z-order) curve; equal cells keep their order."""
    extent = np.ptp(points, axis=0).max()
    place = ((points - points.min(axis=0)) / max(extent, np.finfo(float).tiny) * (2**_BITS - 1)).astype(np.int64)
    key = np.zeros(len(points), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            key |= (place[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(key, kind="stable")


def ordered_along_curve(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray, NDArray[np.int64]]:
    """The same mesh with nodes in `curve_order` and cells by their first node; orientation is kept.

    Returns points, cells, and the old index of each cell.
    """
    order = curve_order(points)
    number = np.empty(len(points), np.int32)
    number[order] = np.arange(len(points), dtype=np.int32)
    renumbered = number[cells]
    cell_order = np.argsort(renumbered.min(axis=1), kind="stable")
    return points[order], renumbered[cell_order], cell_order
