"""Move nodes towards given positions, but only as far as the tetrahedra around them allow."""

from __future__ import annotations

import numpy as np

from cortet.errors import StageError, counted
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import FloatArray, IntArray

#: after this many halvings a node goes back to its start
HALVINGS = 8


def back_off(
    start: FloatArray, target: FloatArray, cells: IntArray, *, q_max: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Move nodes from `start` towards `target`; halve the step of the nodes of an unacceptable element.

    An element is acceptable when its volume is positive and its q is below `q_max`, or no higher than at the start.

    Parameters
    ----------
    start, target : (n, 3) mm; every element has positive volume at `start`
    cells : (m, 4) int32
    q_max : 1 requires positive volumes only

    Returns
    -------
    The (n, 3) positions, exactly `target` where the step is whole, and the share of the step made, (n,) in [0, 1].

    Raises
    ------
    StageError : an element is flat or inverted at `start`
    """
    allowed = np.maximum(np.nextafter(q_max, 0), quality(start, cells))
    share = np.ones(len(start))
    while True:
        points = np.where(share[:, None] < 1, start + share[:, None] * (target - start), target)
        bad = ~(signed_volumes(points, cells) > 0) | (quality(points, cells) > allowed)
        if not bad.any():
            return points, share
        offending = np.unique(cells[bad])
        if not share[offending].any():
            what = f"{counted(bad.sum(), 'tetrahedron is', 'tetrahedra are')} flat or inverted before any node moves"
            raise StageError(what, remedy="use `cortet improve`, which turns inverted tetrahedra")
        share[offending] /= 2
        share[share < 0.5**HALVINGS] = 0
