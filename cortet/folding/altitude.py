"""The smallest altitude of a tetrahedron of a body."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.geometry.topology import TET_FACES, face_areas
from cortet.measure.quality import signed_volumes
from cortet.meshes import FloatArray, IntArray

#: altitudes this close to the smallest one are computed again, with the bits that NumPy gives
_CLOSE = 1e-9


def smallest_altitude(points: FloatArray, cells: IntArray) -> float:
    """The smallest height of a node over the opposite face, over all tetrahedra; in the unit of `points`.

    Parameters
    ----------
    points : (n, 3)
    cells : (m, 4), positive or not
    """
    squared = _squared(points, cells)
    least = np.nanmin(squared, initial=np.inf)
    among = cells[~(squared > least + _CLOSE * abs(least))]  # includes those without an altitude
    areas = np.stack([face_areas(points, among[:, face]) for face in TET_FACES], axis=1).max(axis=1)
    return float((3 * signed_volumes(points, among) / areas).min())


@numba.njit(cache=True, error_model="numpy")
def _squared(points, cells) -> NDArray[np.float64]:  # type: ignore[no-untyped-def]
    """The square of the smallest altitude of each tetrahedron, negative if its volume is, NaN without area: (m,)."""
    found = np.empty(len(cells))
    edges = np.empty((5, 3))
    for e in range(len(cells)):
        a, b, c, d = cells[e]
        for k in range(3):
            edges[0, k], edges[1, k] = points[b, k] - points[a, k], points[c, k] - points[a, k]
            edges[2, k], edges[3, k] = points[d, k] - points[a, k], points[c, k] - points[b, k]
            edges[4, k] = points[d, k] - points[b, k]
        largest = 0.0
        for i, j in ((0, 1), (0, 2), (1, 2), (3, 4)):
            x = edges[i, 1] * edges[j, 2] - edges[i, 2] * edges[j, 1]
            y = edges[i, 2] * edges[j, 0] - edges[i, 0] * edges[j, 2]
            z = edges[i, 0] * edges[j, 1] - edges[i, 1] * edges[j, 0]
            largest = max(largest, x * x + y * y + z * z)
            if i == 0 and j == 1:
                volume = x * edges[2, 0] + y * edges[2, 1] + z * edges[2, 2]
        found[e] = volume * abs(volume) / largest if largest > 0 else np.nan
    return found
