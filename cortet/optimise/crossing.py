"""Optimise a mesh without letting its boundary pass through itself or leave the surface it slides on.

Nothing local can see the opposite bank of a narrow sulcus, nor the crest of a thin blade that vertices on both sides
slide away from. So the whole boundary is checked afterwards, and where it crosses itself, or has left a part of the
surface behind, the run is repeated from the start with the vertices around that place held.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from cortet.geometry import topology
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.intersection import self_intersections
from cortet.measure.lost import surface_samples
from cortet.mesh import IntArray, TetMesh, TriSurface

_ROUNDS = 5
#: how far a point of the surface may be left behind, over the mean edge of the boundary (1.3 times the cell size)
MOST_LEFT_BEHIND = 0.36
#: a point that was beyond that already may not be farther away than before, but for this factor
_SAME = 1.02

logger = logging.getLogger(__name__)
Report = TypeVar("Report")


def crossing_faces(mesh: TetMesh) -> IntArray:
    """Boundary faces that cross others: (k, 3) int32, node indices."""
    return topology.boundary_faces(mesh)[self_intersections(topology.boundary_surface(mesh)[0])]


def without_crossing(
    mesh: TetMesh,
    optimise: Callable[[TetMesh, IntArray], tuple[TetMesh, Report]],
    surface: TriSurface | None = None,
    *,
    held: IntArray | None = None,
) -> tuple[TetMesh, Report, IntArray]:
    """Call `optimise(mesh, held)` with ever more vertices held until the boundary is as sound as it was.

    It must not cross itself and, where a `surface` is given, not leave points of it farther behind than
    `MOST_LEFT_BEHIND`. What was so in `mesh` already is not the fault of `optimise`.

    Parameters
    ----------
    optimise : must keep vertex numbers
    held : (h,) vertices that are held from the first call on

    Returns
    -------
    The result and report of the last call, and the vertices held in it, (h,) int32. If something remains after a few
    rounds the result has it, for the certificate to judge.
    """
    before = len(crossing_faces(mesh))
    left_in = _nothing_left if surface is None else _left_behind(mesh, surface)
    held = np.zeros(0, np.int32) if held is None else held
    for remaining in reversed(range(_ROUNDS)):
        result, report = optimise(mesh, held)
        crossing = crossing_faces(result)
        crossed = crossing if len(crossing) > before else crossing[:0]
        left = left_in(result)
        if not (len(crossed) or len(left)):
            break
        if not remaining:
            _warn(result, crossed, left)
            break
        touched = np.isin(mesh.cells, crossed).any(axis=1)
        held = np.unique(np.concatenate([held, mesh.cells[touched].ravel(), left.ravel()]))
        what = f"{len(crossed)} boundary faces cross, {len(left)} leave the surface"
        logger.info("%s: again, with %d vertices held in place", what, len(held))
    return result, report, held


def _warn(mesh: TetMesh, crossed: IntArray, left: IntArray) -> None:
    """Say what remains after all rounds, and where."""
    for faces, what in ((crossed, "boundary faces cross"), (left, "boundary faces leave a part of the surface behind")):
        if len(faces):
            x, y, z = mesh.points[faces[0]].mean(axis=0)
            logger.warning("%d %s, the first at (%.1f, %.1f, %.1f) mm", len(faces), what, x, y, z)


def _nothing_left(_: TetMesh) -> IntArray:
    return np.zeros((0, 3), np.int32)


def _left_behind(mesh: TetMesh, surface: TriSurface) -> Callable[[TetMesh], IntArray]:
    """What finds the boundary faces, (k, 3) node indices, that leave points of the surface behind.

    Each point may be as far from the boundary as a share of the edges of `mesh`, or as it is from that of `mesh`. The
    points of inner surfaces are held against their interfaces in the same way.
    """
    numbered = enumerate((surface, *surface.inner.values()))
    finders = [_left_behind_sheet(mesh, one, number) for number, one in numbered]
    return lambda result: np.concatenate([find(result) for find in finders])


def _left_behind_sheet(mesh: TetMesh, surface: TriSurface, number: int) -> Callable[[TetMesh], IntArray]:
    samples = surface_samples(surface)
    boundary, _ = topology.sheet(mesh, number)
    start, end = topology.edges(boundary.faces).T
    edge = np.linalg.norm(boundary.points[start] - boundary.points[end], axis=1).mean()
    before = closest_points(surface_tree(boundary.points, boundary.faces), samples).distances
    limits = np.maximum(MOST_LEFT_BEHIND * edge, _SAME * before)

    def leaving_faces(result: TetMesh) -> IntArray:
        boundary, nodes = topology.sheet(result, number)
        found = closest_points(surface_tree(boundary.points, boundary.faces), samples)
        faces = np.unique(found.faces[found.distances > limits])
        return nodes[boundary.faces[faces]].astype(np.int32)

    return leaving_faces
