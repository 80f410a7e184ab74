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
    mesh: TetMesh, optimise: Callable[[TetMesh, IntArray], tuple[TetMesh, Report]]
) -> tuple[TetMesh, Report, IntArray]:
    """Call `optimise(mesh, held)` with ever more vertices held until the boundary does not cross itself.

    `optimise` must keep vertex numbers. Faces that cross in `mesh` already are not its fault. If crossings remain
    after a few rounds the last result is returned, for the certificate to refuse. Returns also the vertices held,
    (h,) int32.
    """
    before = len(crossing_faces(mesh))
    held = np.zeros(0, np.int32)
    for _ in range(_ROUNDS):
        result, report = optimise(mesh, held)
        crossing = crossing_faces(result)
        if len(crossing) <= before:
            break
        touched = np.isin(mesh.cells, crossing).any(axis=1)
        held = np.union1d(held, mesh.cells[touched])
        logger.warning("%d boundary faces cross: again, with %d vertices held in place", len(crossing), len(held))
    return result, report, held
