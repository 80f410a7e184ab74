"""How much of the inside of a surface the labels or numbers of a volume cover."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.voxels import in_voxels
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FloatArray, TriSurface

#: most voxels along an axis of the coarse grid on which labels and surface are compared
_FINEST = 80


def coverage(surface: TriSurface, labelled: NDArray[np.bool_], affine: FloatArray) -> tuple[float, float]:
    """The share of the inside of a closed surface that labelled voxels cover, and the most that they could cover.

    Parameters
    ----------
    labelled : (i, j, k), voxels that have a label, or a number other than 0
    affine : (4, 4) from voxels to mm
    """
    step = max(1, -(-max(labelled.shape) // _FINEST))
    has = _averaged(labelled, step)
    inside = _inside(surface, affine, has.shape, step)
    total = max(float(inside.sum()), 1.0)
    return float((has * inside).sum()) / total, min(1.0, float(has.sum()) / total)


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
