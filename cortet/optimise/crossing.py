"""Optimise a mesh so that its boundary neither crosses itself, closes a gap nor leaves the surface it slides on.

A local check cannot see the opposite bank of a narrow sulcus, nor a thin crest that vertices on both sides slide away
from. So the whole boundary is checked afterwards. Where it crosses itself, has nearly closed a gap of the surface or
has left a part of the surface behind, the changes around that spot are undone, and the optimisation is repeated there
with the vertices of the spot held.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cortet.geometry import topology
from cortet.geometry.banks import slits
from cortet.geometry.closest_point import closer_than, closest_points, tree_of
from cortet.geometry.intersection import self_intersections
from cortet.geometry.limits import LEAST_BANK_GAP
from cortet.measure.lost import surface_samples
from cortet.meshes import IntArray, TetMesh, TriSurface
from cortet.optimise.backing_off import back_off
from cortet.optimise.pockets import cut_out, numbers_in, put_back
from cortet.optimise.undoing import undone

#: rounds of undo and retry, then rounds of undo only
_ROUNDS, _LAST_ROUNDS = 4, 3
#: largest q that a tetrahedron may rise to when vertices go half-way back
_HALF_WAY_WORST = 0.9
#: how far the boundary may leave a point of the surface behind: over the cell size or, if that is unknown, over the
#: mean edge of the boundary (without smaller cells anywhere, the mean edge is 1.3 cell sizes)
MOST_LEFT_BEHIND, MOST_OF_EDGE = 0.47, 0.36
#: points farther from the boundary than this multiple of that limit do not belong to the mesh
_REACH = 3
#: a point beyond the limit before may be at most this factor farther away after
_SAME = 1.02

logger = logging.getLogger(__name__)
Report = TypeVar("Report")


def crossing_faces(mesh: TetMesh) -> IntArray:
    """Boundary faces that cross others: (k, 3) int32, node indices."""
    return topology.boundary_faces(mesh)[self_intersections(topology.boundary_surface(mesh)[0])]


def _closing_faces(surface: TriSurface, mesh: TetMesh) -> IntArray:
    """Boundary faces in front of which less than `LEAST_BANK_GAP` is left of a gap of the surface."""
    return topology.boundary_faces(mesh)[slits(topology.boundary_surface(mesh)[0], surface, LEAST_BANK_GAP)]


class Flaws(NamedTuple):
    """What became worse in the boundary of a mesh since an earlier one, (k, 3) int32 node indices each."""

    #: faces that cross other faces or close a gap of the surface
    met: IntArray
    #: corners of the faces of the earlier boundary, nearest first, whose points of the surface are now left behind
    left: IntArray

    def __bool__(self) -> bool:
        """Whether there are any flaws."""
        return len(self.met) > 0 or len(self.left) > 0

    def to_hold(self, held: IntArray) -> IntArray:
        """For each spot left behind, its nearest vertex that is not `held` yet: (k,) int32."""
        fresh = ~np.isin(self.left, held)
        return np.unique(self.left[np.arange(len(self.left)), fresh.argmax(axis=1)])


def flaws_since(
    mesh: TetMesh, surface: TriSurface | None, cell_size: float | None = None
) -> Callable[[TetMesh], Flaws]:
    """A function that finds the flaws of a mesh made from `mesh`, apart from those that `mesh` has already."""
    left_in = _nothing_left if surface is None else _left_behind(mesh, surface, cell_size)
    finders: list[Callable[[TetMesh], IntArray]] = [crossing_faces]
    if surface is not None:
        finders.append(partial(_closing_faces, surface))

    @cache
    def before(number: int) -> int:
        return len(finders[number](mesh))

    def new(number: int, result: TetMesh) -> IntArray:
        """What is found, if it is more than before; otherwise nothing."""
        found = finders[number](result)
        return found if len(found) and len(found) > before(number) else found[:0]

    def flaws(result: TetMesh) -> Flaws:
        met = np.unique(np.concatenate([new(number, result) for number in range(len(finders))]), axis=0)
        return Flaws(met, left_in(result))

    return flaws


def without_crossing(
    mesh: TetMesh,
    optimise: Callable[[TetMesh, IntArray], tuple[TetMesh, Report]],
    surface: TriSurface | None = None,
    *,
    cell_size: float | None = None,
    held: IntArray | None = None,
) -> tuple[TetMesh, Report, IntArray]:
    """Call `optimise(mesh, held)`, then repeat it around spots of the boundary that it spoils, until none are left.

    The boundary must not cross itself. If a `surface` is given, the boundary must not close its gaps to less than
    `LEAST_BANK_GAP`, nor leave its points farther behind than `MOST_LEFT_BEHIND`. Flaws that `mesh` has already do not
    count.

    Parameters
    ----------
    optimise : must keep vertex numbers, the `held` vertices, and the boundary between them. It is called with the whole
        mesh, then with parts of it, whose vertices have other numbers
    cell_size : mm, None if unknown
    held : (h,) vertices that are held from the first call on

    Returns
    -------
    The result, the report of the first call, and the vertices held in the end, (h,) int32. Flaws that remain after a
    few rounds stay in the result; the certificate checks them.
    """
    flaws_of = flaws_since(mesh, surface, cell_size)
    held = np.zeros(0, np.int32) if held is None else held
    result, report = optimise(mesh, held)
    flaws = flaws_of(result)
    for number in range(_ROUNDS + _LAST_ROUNDS):
        if not flaws:
            break
        touched = np.isin(mesh.cells, flaws.met).any(axis=1)
        sliding = flaws.to_hold(held) if number < _ROUNDS else flaws.left
        spoilt = np.union1d(mesh.cells[touched], sliding)
        what = f"{len(flaws.met)} boundary faces cross or close a gap, {len(flaws.left)} spots are left behind"
        logger.info("%s: undone there, %d vertices held in place", what, len(np.union1d(held, spoilt)))
        # a vertex that slid away first goes half-way back: at its start, its tetrahedra were bad
        earlier = mesh if number else _half_way(mesh, result, sliding, surface)
        held = np.union1d(held, spoilt).astype(np.int32)
        result, around = undone(earlier, result, spoilt)
        if number < _ROUNDS:
            part = cut_out(result, around)
            again, _ = optimise(part.mesh, np.union1d(part.rim, numbers_in(part, held)).astype(np.int32))
            result = put_back(result, part, again)
        flaws = flaws_of(result)
    if flaws:
        _warn(result, flaws)
    return result, report, held


def _half_way(before: TetMesh, after: TetMesh, vertices: NDArray[np.integer], surface: TriSurface | None) -> TetMesh:
    """The mesh `before`, with some boundary vertices moved half-way to their positions `after`, on their surface.

    A vertex stays as it was where a tetrahedron would become bad.
    """
    if surface is None or not len(vertices):
        return before
    target = before.points.copy()
    for number, one in enumerate((surface, *surface.inner.values())):
        moved = np.intersect1d(vertices, topology.sheet(before, number)[1])
        if len(moved):
            middle = (before.points[moved] + after.points[moved]) / 2
            target[moved] = closest_points(tree_of(one), middle).points
    around = np.isin(before.cells, vertices).any(axis=1)
    points, share = back_off(before.points, target, before.cells[around], q_max=_HALF_WAY_WORST)
    return replace(before, points=np.where(share[:, None] == 1, points, before.points))


def _warn(mesh: TetMesh, flaws: Flaws) -> None:
    """Log the flaws that remain after all rounds, and where."""
    words = "boundary faces that intersect or close a gap", "locations where the boundary no longer follows the surface"
    for faces, what in zip(flaws, words, strict=True):
        if len(faces):
            x, y, z = mesh.points[faces[0]].mean(axis=0)
            logger.warning("%s: %d, the first at (%.1f, %.1f, %.1f) mm", what, len(faces), x, y, z)


def _nothing_left(_: TetMesh) -> IntArray:
    return np.zeros((0, 3), np.int32)


def _left_behind(mesh: TetMesh, surface: TriSurface, cell_size: float | None) -> Callable[[TetMesh], IntArray]:
    """A function that finds the faces of `mesh`, (k, 3) node indices, whose surface points a later mesh leaves behind.

    A point may be as far from the later boundary as the limit allows, or as far as it is from that of `mesh`. Points of
    inner surfaces are compared with their interfaces in the same way.
    """
    numbered = enumerate((surface, *surface.inner.values()))
    finders = [_left_behind_sheet(mesh, one, number, cell_size) for number, one in numbered]
    return lambda result: np.concatenate([find(result) for find in finders])


def _left_behind_sheet(
    mesh: TetMesh, surface: TriSurface, number: int, cell_size: float | None
) -> Callable[[TetMesh], IntArray]:
    began, nodes = topology.sheet(mesh, number)
    if cell_size is None:
        limit = MOST_OF_EDGE * topology.mean_edge(began.points, began.faces)
    else:
        limit = MOST_LEFT_BEHIND * cell_size
    samples = surface_samples(surface)

    def left(result: TetMesh) -> IntArray:
        boundary, _ = topology.sheet(result, number)
        far = samples[~closer_than(tree_of(boundary), samples, limit)]
        # a part of a mesh does not represent the surface far from it
        far = far[closer_than(tree_of(began), far, _REACH * limit)]
        before = closest_points(tree_of(began), far)
        beyond = closest_points(tree_of(boundary), far).distances > _SAME * before.distances
        order = np.argsort(-before.barycentric[beyond], axis=1, kind="stable")
        corners = np.take_along_axis(began.faces[before.faces[beyond]], order, axis=1)
        return np.unique(nodes[corners], axis=0)

    return left
