"""Optimise a mesh without letting its boundary pass through itself.

Nothing local can see the opposite bank of a narrow sulcus. So the whole boundary is checked afterwards, and where it
crosses itself the run is repeated from the start with the vertices around that place held.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from cortet.geometry import topology
from cortet.geometry.intersection import self_intersections
from cortet.mesh import IntArray, TetMesh

_ROUNDS = 5

logger = logging.getLogger(__name__)
Report = TypeVar("Report")


def crossing_faces(mesh: TetMesh) -> IntArray:
    """Boundary faces that cross others: (k, 3) int32, node indices."""
    return topology.boundary_faces(mesh)[self_intersections(topology.boundary_surface(mesh)[0])]


def without_crossing(
    mesh: TetMesh, optimise: Callable[[TetMesh, IntArray], tuple[TetMesh, Report]], *, held: IntArray | None = None
) -> tuple[TetMesh, Report, IntArray]:
    """Call `optimise(mesh, held)` with ever more vertices held until the boundary does not cross itself.

    Parameters
    ----------
    optimise : must keep vertex numbers; faces that cross in `mesh` already are not its fault
    held : (h,) vertices that are held from the first call on

    Returns
    -------
    The result and report of the last call, and the vertices held in it, (h,) int32. If crossings remain after a few
    rounds the result has them, for the certificate to refuse.
    """
    before = len(crossing_faces(mesh))
    held = np.zeros(0, np.int32) if held is None else held
    for remaining in reversed(range(_ROUNDS)):
        result, report = optimise(mesh, held)
        crossing = crossing_faces(result)
        if len(crossing) <= before or not remaining:
            break
        touched = np.isin(mesh.cells, crossing).any(axis=1)
        held = np.union1d(held, mesh.cells[touched])
        logger.warning("%d boundary faces cross: again, with %d vertices held in place", len(crossing), len(held))
    return result, report, held
