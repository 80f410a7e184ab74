"""A hemisphere with its inner structures: cortex, white matter, two ventricles, a thalamus, and volumes of these.

The ventricles and the thalamus are ellipsoids in the deepest spots of the white matter, from front to back. A voxel has
the label at its centre. The long axis of the tensors turns from front to back, so that it differs from spot to spot.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.closest_point import tree_of
from cortet.geometry.icosphere import icosphere
from cortet.geometry.nesting import depths
from cortet.geometry.topology import enclosed_volume
from cortet.geometry.winding import winding_numbers
from cortet.meshes import FloatArray, TriSurface, single_precision
from cortet.phantoms import inset, phantom

#: labels of the volume, by their names
LABELS = {"cortex": 1, "white": 2, "ventricle1": 3, "ventricle2": 4, "thalamus": 5}
#: bodies from front to back
_BODIES = ("ventricle1", "thalamus", "ventricle2")
#: half axes of a body (lateral, anterior, superior), over the depth of its centre
_HALF_AXES = np.array([0.7, 0.9, 0.7])
#: largest depth used for a body, over the distance of its centre from the next third
_APART = 1.05
#: voxels searched for the deepest spot, along the longest side of the white surface
_SEARCHED = 30
#: voxels around the surface; eigenvalues of the tensors, mm2/s; turns of the long axis per mm
_MARGIN, _EIGENVALUES, _TURN = 4, (1.7e-3, 0.4e-3, 0.2e-3), 0.01
_MOST_VOXELS = 50_000_000


class Head(NamedTuple):
    """A phantom head."""

    #: surface of each label; for the cortex the outer one
    surfaces: dict[str, TriSurface]
    #: (i, j, k) labels, 0 outside
    labels: NDArray[np.int16]
    #: (i, j, k, 6) in mm2/s: xx, xy, xz, yy, yz, zz along the axes of the voxels, as FSL's dtifit writes; 0 outside
    tensors: NDArray[np.float32]
    #: (4, 4) from voxels to mm
    affine: FloatArray
    #: mm3 of each label: between its surface and the surfaces within
    volumes: dict[str, float]


def head(
    gestational_age: float, *, subdivisions: int = 5, seed: int = 0, thickness: float = 1.5, voxel: float = 0.5
) -> Head:
    """A left hemisphere with deep structures and volumes.

    Parameters
    ----------
    gestational_age, subdivisions, seed : as of `phantom`
    thickness : of the cortex, mm
    voxel : width of the voxels, mm
    """
    pial = phantom(gestational_age, subdivisions=subdivisions, seed=seed)
    white = inset(pial, thickness)
    surfaces = {"cortex": pial, "white": white, **_bodies(white)}
    low = pial.points.min(axis=0) - _MARGIN * voxel
    shape = np.ceil((pial.points.max(axis=0) + _MARGIN * voxel - low) / voxel).astype(int)
    if (count := int(np.prod(shape, dtype=object))) > _MOST_VOXELS:
        raise InputError(f"{count:,} voxels are too many", remedy="use larger voxels")
    affine = np.diag([-voxel, voxel, voxel, 1.0])  # the first axis points to the left, as most scanners write it
    affine[:3, 3] = low + np.array([(shape[0] - 1) * voxel, 0, 0])
    centres = np.indices(shape).reshape(3, -1).T @ affine[:3, :3].T + affine[:3, 3]
    labels = np.zeros(len(centres), np.int16)
    for name, surface in surfaces.items():
        near = ((centres > surface.points.min(axis=0)) & (centres < surface.points.max(axis=0))).all(axis=1)
        near = np.flatnonzero(near)
        labels[near[winding_numbers(surface, centres[near]) > 0.5]] = LABELS[name]
    whole = {name: enclosed_volume(one.points, one.faces) for name, one in surfaces.items()}
    whole["cortex"] -= whole["white"]
    whole["white"] -= sum(whole[name] for name in _BODIES)
    tensors = np.where(labels[:, None] > 0, _tensors(centres, affine), 0).astype(np.float32)
    return Head(surfaces, labels.reshape(shape), tensors.reshape(*shape, 6), affine, whole)


def direction(points: FloatArray) -> FloatArray:
    """Unit vectors along the longest axes of the phantom's tensors at points (n, 3) mm: (n, 3)."""
    angle = 2 * np.pi * _TURN * points[:, 1]
    return np.stack([np.sin(angle) / 2, np.cos(angle), np.full(len(points), 0.5)], axis=1) / np.sqrt(
        0.25 * np.sin(angle) ** 2 + np.cos(angle) ** 2 + 0.25
    ).reshape(-1, 1)


def _bodies(white: TriSurface) -> dict[str, TriSurface]:
    """Ellipsoids in the deepest spot of the front, middle and back third of the white matter."""
    low, high = white.points.min(axis=0), white.points.max(axis=0)
    step = (high - low).max() / _SEARCHED
    grid = np.stack(np.meshgrid(*(np.arange(a, b, step) for a, b in zip(low, high, strict=True))), axis=-1)
    grid = grid.reshape(-1, 3)
    depth = depths(tree_of(white), white, grid)[0]
    length = (high[1] - low[1]) / 3
    third = np.clip((high[1] - grid[:, 1]) / length, 0, 2.999).astype(int)
    borders = high[1] - length * np.array([1, 2])
    room = np.minimum(depth, _APART * np.abs(grid[:, 1, None] - borders).min(axis=1))  # bodies stay in their thirds
    ball = icosphere(4)
    made = {}
    for number, name in enumerate(_BODIES):
        best = int(np.where(third == number, room, -np.inf).argmax())
        made[name] = single_precision(TriSurface(grid[best] + room[best] * _HALF_AXES * ball.points, ball.faces))
    return made


def _tensors(points: FloatArray, affine: FloatArray) -> FloatArray:
    """Tensors at points, six numbers each, along the axes of voxels that are not rotated: (n, 6)."""
    first = direction(points)
    second = np.cross(first, [1.0, 0.0, 0.0])
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    axes = np.stack([first, second, np.cross(first, second)], axis=2)
    full = np.einsum("nij,j,nkj->nik", axes, _EIGENVALUES, axes)
    turn = np.sign(affine[:3, :3].diagonal())
    full *= np.outer(turn, turn)
    return np.asarray(full.reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]])
