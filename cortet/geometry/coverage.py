"""Whether the labels or numbers of a volume lie inside a surface, and which shift or flip would bring them there."""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.voxels import in_voxels
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FloatArray, TriSurface

#: most voxels along an axis of the coarse grid on which labels and surface are compared
_FINEST = 80
#: shifts whose coverage is this close to the best count as equally good
_AS_GOOD = 0.01

#: axes that may be reversed
_FLIPS = [axes for count in (1, 2, 3) for axes in combinations(range(3), count)]


class Coverage(NamedTuple):
    """Shares of the inside of a surface that have a label or a number."""

    #: with the volume as it lies
    here: float
    #: upper bound, from the volume of the labels
    possible: float
    #: the best after a shift, and the shortest shift of the labels that reaches it, (3,) mm
    shifted: float
    shift: FloatArray
    #: after reversing axes of the voxels: which of them -> the share, one axis first
    flipped: dict[tuple[int, ...], float]


def coverage(surface: TriSurface, labelled: NDArray[np.bool_], affine: FloatArray) -> Coverage:
    """The share of the inside of a closed surface that labelled voxels cover, as they lie and after moves.

    Parameters
    ----------
    labelled : (i, j, k), voxels that have a label, or a number other than 0
    affine : (4, 4) from voxels to mm
    """
    from scipy.signal import fftconvolve  # takes long to load, and few jobs have volumes

    step = max(1, -(-max(labelled.shape) // _FINEST))
    has = _averaged(labelled, step)
    inside = _inside(surface, affine, has.shape, step)
    total = max(float(inside.sum()), 1.0)
    together = fftconvolve(has, inside[::-1, ::-1, ::-1])
    good = np.argwhere(together >= together.max() - _AS_GOOD * total) - (np.array(inside.shape) - 1)
    shifts = -step * good @ affine[:3, :3].T
    return Coverage(
        float((has * inside).sum()) / total,
        min(1.0, float(has.sum()) / total),
        float(together.max()) / total,
        shifts[np.linalg.norm(shifts, axis=1).argmin()],
        {axes: float((_averaged(np.flip(labelled, axes), step) * inside).sum()) / total for axes in _FLIPS},
    )


def _averaged(labelled: NDArray[np.bool_], step: int) -> FloatArray:
    """Means over blocks of `step` voxels along each axis; blocks that overhang are padded with unlabelled voxels."""
    shape = [-(-count // step) for count in labelled.shape]
    padded = np.pad(labelled, [(0, step * n - count) for n, count in zip(shape, labelled.shape, strict=True)])
    return np.asarray(padded.reshape(shape[0], step, shape[1], step, shape[2], step).mean(axis=(1, 3, 5)))


def _inside(surface: TriSurface, affine: FloatArray, shape: tuple[int, ...], step: int) -> NDArray[Any]:
    """1.0 for blocks of voxels whose centre lies inside the surface, else 0.0."""
    where = in_voxels(affine, surface.points)
    low = np.clip(np.floor(where.min(axis=0) / step).astype(int) - 1, 0, shape)
    high = np.clip(np.ceil(where.max(axis=0) / step).astype(int) + 2, 0, shape)
    result = np.zeros(shape)
    block = np.stack(np.meshgrid(*map(np.arange, low, high), indexing="ij"), axis=-1)
    centres = (step * block.reshape(-1, 3) + (step - 1) / 2) @ affine[:3, :3].T + affine[:3, 3]
    within = winding_numbers(surface, centres) > 0.5
    result[tuple(slice(*ends) for ends in zip(low, high, strict=True))] = within.reshape(block.shape[:3])
    return result
