"""Swaps, insertions and moves around the worst tetrahedra, in rounds; the stage `reconnect` chooses among them."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.config.section import Boundary
from cortet.geometry.closest_point import SurfaceTree, forest
from cortet.geometry.topology import neighbours
from cortet.measure.quality import quality
from cortet.meshes import IntArray, TetMesh, TriSurface
from cortet.optimise.crossing import Flaws, flaws_since, without_crossing
from cortet.optimise.insertion import MIN_GAIN, insert_vertices
from cortet.optimise.pockets import (
    Part,
    bad_in_each,
    better_of_each,
    cut_out,
    mixed,
    nodes_near,
    numbers_in,
    only,
    pockets_at,
    promising,
    put_back,
    rim_of,
)
from cortet.optimise.star import mu2_of
from cortet.optimise.swaps import NO_SWAPS, SwapCount, improve, live_cells, swappable
from cortet.optimise.vertices import Pass, interface_triangles, move_vertices

_ROUNDS = 4
#: a round with fewer swaps per tetrahedron than this is the last one
_FEW = 2e-4
#: the first round swaps above this q: it is lower than in later rounds, which improves the mean, too
_FIRST_SWAPS = 0.18
#: powers of the first round, in which vertices move far; later rounds must not lose what it reached
_FIRST_POWERS = (8, 16, 32)
#: searches around the worst tetrahedra
_MOST_SEARCHES = 8
#: a threshold is reached if q exceeds it by at most this factor
_REACHED = 1.001
#: rounds of insertions after everything else
_LAST_ROUNDS = 4
_SWEEPS, _MEAN_SWEEPS = 12, 4
#: stages of a search around what is left: by how much an insertion may make a pocket worse at first, and rounds
_GAINS = ((MIN_GAIN, 2), (1.25, 4), (1.6, 4))
#: a search is around so many of the worst tetrahedra, or this share of those above the threshold if that is more, and
#: around those that the last one left: with more, pockets join, and one that is too large is given up
_SOUGHT, _SOUGHT_SHARE = 30, 0.025
#: a pocket with more bad tetrahedra than this is given up for this series of powers
_MOST_HOPE = 100
#: two series of powers, from pockets that were relaxed first and from those that were not; neither is always better: at
#: 64, the good tetrahedra of a tight pocket hold the worst back, and what one way leaves, it would leave again
_SEARCH_POWERS, _SEARCH_SWEEPS = ((8, 16, 32, 64), (8, 32, 128, 256)), 25
#: aim of a pocket that both series leave, over its worst q
_OWN_AIM = 0.99
#: vertices move from this share of the threshold on: the worst improve only if those around them give way
_GIVING_WAY = 0.85
#: tries: one for all pockets, the rest for the pockets whose boundary a try spoilt
_SEARCHES = 6

logger = logging.getLogger(__name__)


class Reconnected(NamedTuple):
    """The result of a reconnection."""

    mesh: TetMesh
    #: vertices inserted before and after the rounds, less those of the boundary that were removed
    inserted: int
    #: sums over all rounds
    swaps: SwapCount
    #: (h,) vertices held in place because the boundary would have crossed itself
    held: IntArray


def reconnected(
    mesh: TetMesh,
    surface: TriSurface,
    *,
    threshold: float = 0.3,
    boundary: Boundary = "slide",
    insert: bool = True,
    mean: bool = True,
    cell_size: float | None = None,
) -> Reconnected:
    """Swap edges and faces around tetrahedra with q above `threshold`, insert vertices, and move the vertices there.

    Parameters are those of `cortet.stages.reconnect.reconnect`; the mesh must be sound (`optimise.soundness`). Without
    `mean`, no vertices move that are far from these tetrahedra.
    """
    tree = forest(surface)

    def optimise(start: TetMesh, held: IntArray) -> tuple[TetMesh, list[SwapCount]]:
        return _improved(start, tree, threshold, boundary, held, mean=mean)

    if insert:
        start, inserted, swaps = _with_insertions(mesh, tree, threshold)
    else:
        # this leaves little to do for the rounds that move the boundary, and their changes can be undone locally
        inside = np.ones(len(mesh.points), np.bool_)
        start, count = _swapped(mesh, tree, min(threshold, _FIRST_SWAPS), inside)
        inserted, swaps = 0, [count]
    followed = surface if boundary == "slide" else None
    result, counts, held = without_crossing(start, optimise, followed, cell_size=cell_size)
    if insert:
        result, found, last = _mended_inside(result, tree, threshold)
        inserted, counts = inserted + found, counts + last
        result, found = _searched_repeatedly(result, surface, followed, threshold, boundary, cell_size)
        inserted += found
    total = [sum(values) for values in zip(*counts, *swaps, strict=True)]
    attempts, edges, faces, flips, peeled = map(int, total[:-1])
    count = SwapCount(attempts, edges, faces, flips, peeled, float(total[-1]))
    return Reconnected(result, inserted, count, held)


def _with_insertions(mesh: TetMesh, tree: SurfaceTree, threshold: float) -> tuple[TetMesh, int, list[SwapCount]]:
    """Swap inside the mesh where that helps, else insert vertices; also return their number, and the swaps."""
    mesh, swaps = _swapped(mesh, tree, threshold, np.ones(len(mesh.points), np.bool_))
    mu2 = np.asarray(mu2_of(quality(mesh.points, mesh.cells)))
    mesh, count = insert_vertices(mesh, mu2, _regions(mesh), float(mu2_of(threshold)))
    return mesh, count, [swaps]


def _mended_inside(mesh: TetMesh, tree: SurfaceTree, threshold: float) -> tuple[TetMesh, int, list[SwapCount]]:
    """Insert vertices and move interior ones again, as long as that helps; the sound boundary stays unchanged."""
    inserted = 0
    counts: list[SwapCount] = []
    for _ in range(_LAST_ROUNDS):
        mesh, count, swaps = _with_insertions(mesh, tree, threshold)
        inserted, counts = inserted + count, counts + swaps
        if not count:
            break
        aims = [Pass(threshold, power, _SWEEPS) for power in _FIRST_POWERS[1:]]
        mesh, _ = move_vertices(mesh, tree, aims, boundary="fixed")
    return mesh, inserted, counts


def _searched_repeatedly(
    mesh: TetMesh,
    surface: TriSurface,
    followed: TriSurface | None,
    threshold: float,
    boundary: Boundary,
    cell_size: float | None,
) -> tuple[TetMesh, int]:
    """Search until no tetrahedron is above `threshold`, or often enough; also return the number of vertices inserted.

    What a search leaves is sought again with others around it, but does not keep the next search from going on.
    """
    inserted, left, q = 0, 0, quality(mesh.points, mesh.cells)
    for _ in range(_MOST_SEARCHES):
        if q.max() <= _REACHED * threshold:
            break
        worst = np.sort(q[q > threshold])
        sought = left + max(_SOUGHT, int(_SOUGHT_SHARE * len(worst)))
        aim = float(worst[-sought - 1]) if len(worst) > sought else threshold
        flaws_of = flaws_since(mesh, followed, cell_size)
        mesh, found = searched(mesh, flaws_of, surface, aim, threshold, boundary)
        q = quality(mesh.points, mesh.cells)
        inserted, left = inserted + found, int(np.count_nonzero(q > aim))
        if aim == threshold and left >= len(worst):
            break
    return mesh, inserted


def searched(
    mesh: TetMesh,
    flaws_of: Callable[[TetMesh], Flaws],
    surface: TriSurface,
    aim: float,
    threshold: float,
    boundary: Boundary,
) -> tuple[TetMesh, int]:
    """Search around the tetrahedra with q above the `aim`, in pockets cut out of the mesh.

    Also returns the number of vertices inserted. An insertion may make a pocket worse before it makes it better. If the
    boundary may slide, its vertices may be removed, too. A pocket whose boundary is spoilt goes back to its earlier
    state, and is tried again with vertices held.
    """
    bad = quality(mesh.points, mesh.cells) > aim
    logger.info("%d tetrahedra above q = %g: searching around them", np.count_nonzero(bad), aim)
    part = cut_out(mesh, bad)
    best, held = part.mesh, np.zeros(0, np.int32)
    again = np.ones(len(best.cells), np.bool_)
    for _ in range(_SEARCHES):
        stiffer = part._replace(rim=np.union1d(part.rim, numbers_in(part, held)).astype(np.int32))
        found = _best_tries(only(best, again), stiffer, surface, aim, boundary, allowed=threshold)
        tried = better_of_each(best, found, threshold)
        if tried is best:
            break
        result = put_back(mesh, part, tried)
        flaws = flaws_of(result)
        crossing = result.points[flaws.met.ravel()]
        spoilt = pockets_at(tried, np.concatenate([crossing, mesh.points[flaws.left[:, 0]]]))
        best = mixed(tried, best, spoilt)
        held = np.union1d(held, np.concatenate([flaws.to_hold(held), nodes_near(part, crossing)])).astype(np.int32)
        if not spoilt.any():
            return result, len(result.points) - len(mesh.points)
        again = spoilt
    result = put_back(mesh, part, best)
    return result, len(result.points) - len(mesh.points)


def _best_tries(
    start: TetMesh,
    part: Part,
    surface: TriSurface,
    threshold: float,
    boundary: Boundary,
    *,
    allowed: float,
) -> TetMesh:
    """The best state of each pocket of a `part`: at the `start`, or after the search with one of the two series.

    Only what the first series leaves above `threshold` gets the second, and each pocket that this leaves gets the first
    again, with an aim just below its own worst. A state is better if less is above `allowed`.
    """
    best = start
    for relax, powers in zip((True, False), _SEARCH_POWERS, strict=True):
        found = _best_of_series(start, part, surface, threshold, powers, boundary, relax=relax, allowed=allowed)
        best = better_of_each(best, found, allowed)
        start = only(start, bad_in_each(best, threshold) > 0)
    left = bad_in_each(start, threshold)
    for pocket in np.flatnonzero(left):
        alone = only(start, np.arange(len(left)) == pocket)
        own = _OWN_AIM * float(quality(alone.points, alone.cells).max())
        if own > threshold:
            found = _best_of_series(
                alone, part, surface, own, _SEARCH_POWERS[0], boundary, relax=False, allowed=allowed
            )
            best = better_of_each(best, found, allowed)
    mean = _mean_moves(allowed)
    return move_vertices(best, forest(surface), mean, boundary=boundary, held=rim_of(part, best))[0]


def _best_of_series(
    start: TetMesh,
    part: Part,
    surface: TriSurface,
    threshold: float,
    powers: Sequence[int],
    boundary: Boundary,
    *,
    relax: bool,
    allowed: float,
) -> TetMesh:
    best = start
    aims = [Pass(_GIVING_WAY * threshold, power, _SEARCH_SWEEPS, crests=True) for power in powers]
    for gain, rounds in _GAINS:
        trial = best
        for number in range(rounds):
            trial = promising(trial, threshold, _MOST_HOPE)
            if not len(trial.cells):
                break
            if relax and not number:
                trial = _relaxed(trial, part, surface, threshold, boundary)
            trial = _tried(trial, part, surface, threshold, aims, gain, boundary)
            best = better_of_each(best, trial, allowed)
    return best


def _relaxed(mesh: TetMesh, part: Part, surface: TriSurface, threshold: float, boundary: Boundary) -> TetMesh:
    """A `part` after swaps and moves that improve its mean, from which a search finds other ways than from before."""
    tree, rim = forest(surface), rim_of(part, mesh)
    rigid = np.full(len(mesh.points), boundary != "slide")
    rigid[rim] = True
    mesh, _ = move_vertices(mesh, tree, _mean_moves(1.0), boundary=boundary, held=rim)
    mesh, _ = _swapped(mesh, tree, min(threshold, _FIRST_SWAPS), rigid)
    return move_vertices(mesh, tree, _mean_moves(1.0), boundary=boundary, held=rim_of(part, mesh))[0]


def _tried(
    mesh: TetMesh,
    part: Part,
    surface: TriSurface,
    threshold: float,
    aims: list[Pass],
    gain: float,
    boundary: Boundary,
) -> TetMesh:
    """One round of swaps, insertions and moves in a `part`; its rim stays where it is."""
    tree = forest(surface)

    def rigid() -> NDArray[np.bool_]:
        vertices = np.full(len(mesh.points), boundary != "slide")
        vertices[rim_of(part, mesh)] = True
        return vertices

    mesh, _ = _swapped(mesh, tree, threshold, rigid())
    mu2 = np.asarray(mu2_of(quality(mesh.points, mesh.cells)))
    removing = tree if boundary == "slide" else None
    mesh, _ = insert_vertices(
        mesh, mu2, _regions(mesh), float(mu2_of(threshold)), gain=gain, tree=removing, held=rigid()
    )
    return move_vertices(mesh, tree, aims, boundary=boundary, held=rim_of(part, mesh))[0]


def _improved(
    mesh: TetMesh, tree: SurfaceTree, threshold: float, boundary: Boundary, held: IntArray, *, mean: bool
) -> tuple[TetMesh, list[SwapCount]]:
    """Alternate between swaps and moves until no swap helps, then improve the `mean`; also return the swaps."""
    rigid = np.full(len(mesh.points), boundary == "fixed")
    rigid[held] = True
    counts = []
    for number in range(1, _ROUNDS + 1):
        mesh, count = _swapped(mesh, tree, min(threshold, _FIRST_SWAPS) if mean and number == 1 else threshold, rigid)
        counts.append(count)
        made = count.edge_removals + count.face_removals + count.boundary_flips + count.peeled
        logger.info("round %d: %d swaps of %d tried", number, made, count.attempts)
        if number > 1 and made < _FEW * len(mesh.cells):
            break
        powers = _FIRST_POWERS if number == 1 else _FIRST_POWERS[-1:]
        share = _GIVING_WAY if mean else 1.0  # it costs mean
        aims = [Pass(share * threshold, power, _SWEEPS) for power in powers]
        mesh, _ = move_vertices(mesh, tree, aims, boundary=boundary, held=held)
    if mean:
        mesh, _ = move_vertices(mesh, tree, _mean_moves(threshold), boundary=boundary, held=held)
    return mesh, counts


def _mean_moves(keep: float) -> list[Pass]:
    """Moves of all vertices that improve the mean, and take no tetrahedron above `keep`."""
    return [Pass(threshold=0, power=2, sweeps=_MEAN_SWEEPS, keep=keep)]


def _swapped(mesh: TetMesh, tree: SurfaceTree, threshold: float, rigid: NDArray[np.bool_]) -> tuple[TetMesh, SwapCount]:
    """Swap edges and faces around tetrahedra above `threshold`; boundary edges of `rigid` vertices (n,) stay."""
    mu2 = np.asarray(mu2_of(quality(mesh.points, mesh.cells)))
    if not (mu2 > mu2_of(threshold)).any():
        return mesh, NO_SWAPS
    work = swappable(mesh, mu2, _regions(mesh), rigid, on_triangle=interface_triangles(mesh, tree))
    count = improve(work, tree, float(mu2_of(threshold)))
    live = live_cells(work)
    cell_data = {name: values[live.origin] for name, values in mesh.cell_data.items()}
    made = replace(mesh, cells=live.cells, cell_data=cell_data)
    neighbours.remember(made, live.neighbours)
    return made, count


def _regions(mesh: TetMesh) -> IntArray:
    """One number for each combination of the integer values of a tetrahedron."""
    labels = [values.reshape(len(mesh.cells), -1) for values in mesh.cell_data.values() if values.dtype.kind in "iu"]
    if not labels:
        return np.zeros(len(mesh.cells), np.int32)
    if len(labels) == 1 and labels[0].shape[1] == 1:
        return np.unique(labels[0], return_inverse=True)[1].ravel().astype(np.int32)
    return np.unique(np.hstack(labels), axis=0, return_inverse=True)[1].ravel().astype(np.int32)
