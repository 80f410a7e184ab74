"""Values between vertices: weighted means of numbers, the nearest vertex's label."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.meshes import FloatArray, IntArray


def is_label(values: NDArray[Any]) -> bool:
    """Whether a field holds labels, between which there are no values: its numbers are integers."""
    return bool(np.issubdtype(values.dtype, np.integer))


def at_triangles(values: NDArray[Any], corners: IntArray, weights: FloatArray) -> NDArray[Any]:
    """Values of one field at points in triangles.

    Parameters
    ----------
    values : (n,) or (n, j), at vertices
    corners, weights : (k, 3) vertices of the triangles that the points lie in, and barycentric coordinates there

    Returns
    -------
    (k,) or (k, j); a label is that of the corner with the largest weight
    """
    if is_label(values):
        labels: NDArray[Any] = values[corners[np.arange(len(corners)), weights.argmax(axis=1)]]
        return labels
    means: NDArray[Any] = np.einsum("kc,kc...->k...", weights, values[corners])
    return means
