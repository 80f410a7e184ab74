"""Values between vertices: weighted means of numbers, and of labels one of those there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

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


def applied(
    matrix: sparse.csr_array | sparse.csr_matrix, values: NDArray[Any], *, labels: bool | None = None
) -> NDArray[Any]:
    """Weighted means of numbers in each row of a matrix; of labels the one with the most weight.

    Parameters
    ----------
    matrix : (r, c); a row of it without weights is NaN, among labels as well, which are then float64
    values : (c,) or (c, k)
    labels : whether these are labels, of which NaN is another one; None: if they are integers

    Returns
    -------
    (r,) or (r, k)
    """
    if is_label(values) if labels is None else labels:
        columns = [_of_most_weight(matrix, column) for column in values.reshape(len(values), -1).T]
        made: NDArray[Any] = np.stack(columns, axis=-1).reshape(-1, *values.shape[1:])
    else:
        made = np.asarray(matrix @ values.astype(np.float64))
    empty = np.diff(matrix.indptr) == 0
    if empty.any():
        made = made.astype(np.float64)
        made[empty] = np.nan
    return made


def _of_most_weight(matrix: sparse.csr_array | sparse.csr_matrix, labels: NDArray[Any]) -> NDArray[Any]:
    """The label (c,) with the most weight in each row of a matrix (r, c); the smallest label in a tie."""
    keys, number = np.unique(labels, return_inverse=True)
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    pairs, place = np.unique(rows * len(keys) + number[matrix.indices], return_inverse=True)
    weights = np.bincount(place, matrix.data)
    row, label = np.divmod(pairs, len(keys))
    order = np.lexsort((-label, weights, row))
    chosen = np.zeros(matrix.shape[0], np.int64)
    chosen[row[order]] = label[order]  # the last of a row stays
    most: NDArray[Any] = keys[chosen]
    return most
