"""Elements in patches of 512 neighbours: a thread loads a patch once, works on it in its cache, and writes sums.

The elements of a patch number their own nodes from 0. A kernel copies the positions of these nodes, works on all
elements of the patch, and adds their contributions to the patch's own nodes, one element after another. It then writes
one sum for each of these nodes: a slot. A node then adds its slots, of two or three patches, in the order of the
patches. No two threads add to the same value, so the bits are the same for any number of threads. No force of an
element goes to main memory.

Within a patch all data are in rows of 512 values, one for each element, so that the compiler works on as many elements
at a time as a vector register holds.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.folding.body import Body
from cortet.meshes import FloatArray, IntArray

#: elements of a patch; copies of the last element fill the last patch, and their results are not used
SIZE = 512
#: first row of each quantity in `Patches.constants`, and the number of rows
GRADIENTS, NORMAL, VOLUME, DEPTH, THICKNESS, MASK, AMOUNT, STIFFNESS, ISOTROPIC = 0, 9, 12, 13, 14, 15, 16, 17, 18
ROWS = 19


class Patches(NamedTuple):
    """b patches of m elements on n nodes; s slots."""

    #: (b + 1,), slots of patch k: offsets[k] to offsets[k + 1]
    offsets: NDArray[np.int64]
    #: (s,) int32, node of each slot
    nodes: IntArray
    #: (b, 4 SIZE), rows of the four corners of each element, as slots of the patch numbered from 0
    corners: NDArray[np.uint16]
    #: (b, 19 SIZE), rows of constants: gradients of the shape functions 1, 2 and 3, normal n, reference
    #: volume, depth, thickness, mask, amount, stiffness, and 1 - n n
    constants: FloatArray
    #: (b, SIZE), the growth label of each element
    label: IntArray
    #: slots of node i: around[starts[i]:starts[i + 1]]
    starts: NDArray[np.int64]
    around: IntArray


def patches_of(body: Body) -> Patches:
    """The patches of a body, in the order of its elements; neighbours should be close in this order."""
    m, n = len(body.cells), len(body.held)
    count = -(-m // SIZE)
    filled = np.minimum(np.arange(count * SIZE), m - 1)
    corners = np.empty((count, 4, SIZE), np.uint16)
    own = []
    for patch, cells in enumerate(body.cells[filled].reshape(count, SIZE, 4)):
        nodes, local = np.unique(cells, return_inverse=True)
        corners[patch] = local.reshape(SIZE, 4).T
        own.append(nodes)
    nodes = np.concatenate(own).astype(np.int32)
    return Patches(
        offsets=np.append(0, np.cumsum([len(part) for part in own])),
        nodes=nodes,
        corners=corners.reshape(count, -1),
        constants=_rows(body, filled, count),
        label=body.label[filled].reshape(count, SIZE),
        starts=np.append(0, np.cumsum(np.bincount(nodes, minlength=n))),
        around=np.argsort(nodes, kind="stable").astype(np.int32),
    )


def renew(patches: Patches, body: Body) -> None:
    """Update `gradients`, `amount` and `volumes` of a body in its patches."""
    _renew(patches.constants, body.gradients, body.amount, body.volumes)


@numba.njit(cache=True, error_model="numpy")
def _renew(constants, gradients, amount, volumes):  # type: ignore[no-untyped-def]
    m = len(amount)
    for patch in range(len(constants)):
        for e in range(SIZE):
            own = min(patch * SIZE + e, m - 1)
            for k in range(9):
                constants[patch, (GRADIENTS + k) * SIZE + e] = gradients[own, k // 3, k % 3]
            constants[patch, AMOUNT * SIZE + e] = amount[own]
            constants[patch, VOLUME * SIZE + e] = volumes[own]


def _rows(body: Body, filled: NDArray[np.int64], count: int) -> FloatArray:
    isotropic = 1 - (body.normals**2).sum(axis=1)
    scalars = (body.volumes, body.depth, body.thickness, body.mask, body.amount, body.stiffness, isotropic)
    columns = [*body.gradients.reshape(-1, 9).T, *body.normals.T, *scalars]
    rows = np.empty((count, ROWS, SIZE))
    for row, values in enumerate(columns):
        rows[:, row] = values[filled].reshape(count, SIZE)
    return rows.reshape(count, -1)
