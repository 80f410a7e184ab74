"""Removal of handles and tunnels of a closed surface, which is cut open along short loops around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from cortet.errors import InputError, counted, place_mm
from cortet.geometry.holes import replaced, rim_length
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import Triangles, as_surface, compacted, faces_at, within
from cortet.geometry.topology import TRI_EDGES, Sides, enclosed_volume, fans, sides_of, surface_topology
from cortet.meshes import FloatArray, IntArray

#: a handle ends where the rim of what is cut away is this many times the loop, at the latest after this many rings
_FLARE, _MOST_RINGS = 1.5, 200
#: rings of triangles to remove beyond a handle or a tunnel, tried in turn
_WIDER = (1, 0, 2, 4)
#: search for shorter loops: number of loops to start from, vertices of each, and rounds
_TRIED, _ROOTS, _ROUNDS = 3, 8, 4


class Cuts(NamedTuple):
    """Triangles without their handles."""

    work: Triangles
    #: (k, 3) mm, the middle of the shortest loop of each handle
    centres: FloatArray
    #: mm, the longest of these loops
    longest: float


def without_handles(work: Triangles, *, keep: int, max_loop: float, max_piece: float) -> Cuts:
    """The triangles after handles are cut or tunnels closed one by one; each change is the one of least volume.

    Parameters
    ----------
    work : one closed, oriented manifold
    keep : number of handles that may stay
    max_loop : mm, length of the longest loop along which the surface may be cut
    max_piece : as in `holes.replaced`

    Raises
    ------
    InputError
        the shortest loop is longer, or no cut along a loop ends in a sound surface
    """
    centres, longest = [], 0.0
    while (genus := int(surface_topology(work.faces).genus)) > keep:
        loops = short_loops(work.points, work.faces)
        lengths = [rim_length(work.points, loop) for loop in loops]
        middle = work.points[loops[0]].mean(axis=0)
        where = place_mm(middle)
        if lengths[0] > max_loop:
            raise InputError(
                f"the surface has {counted(genus, 'handle')}; the shortest loop, around {where}, is "
                f"{lengths[0]:.0f} mm long, above the limit of {max_loop:g} mm",
                remedy="correct the topology of the segmentation, raise repair.max_loop, or set gate.allow_genus if "
                "the handles are real",
            )
        short = [loop for loop, length in zip(loops, lengths, strict=True) if length <= max_loop]
        crossing = len(self_intersections(as_surface(work)))
        tried = [_cut(work, loop, max_piece, genus, crossing) for loop in short]
        possible = [made for made in tried if made is not None]
        if not possible:
            raise InputError(f"cannot cut or close the handle at {where}")
        volume = enclosed_volume(work.points, work.faces)
        changes = [abs(enclosed_volume(made.points, made.faces) - volume) for made in possible]
        work = compacted(possible[int(np.argmin(changes))])
        centres.append(middle)
        longest = max(longest, lengths[0])
    return Cuts(work, np.array(centres).reshape(-1, 3), longest)


def _cut(work: Triangles, loop: IntArray, max_piece: float, genus: int, crossing: int) -> Triangles | None:
    """The triangles cut along a loop and closed on both sides; None if the result is not a sound surface.

    A sound one has one handle less than `genus`, and no more crossing triangles than `crossing`.
    """
    faces, copies = cut_open(work.faces, loop, len(work.points))
    opened = work._replace(
        points=np.concatenate([work.points, work.points[loop]]),
        faces=faces,
        origin=np.concatenate([work.origin, work.origin[loop]]),
    )
    handle = back_to_the_feet(opened.points, opened.faces, (loop, copies))
    for wider in _WIDER:
        try:
            made = replaced(opened, within(opened, handle, wider), max_piece, "handles")
        except InputError:
            continue
        topology = surface_topology(made.faces)
        sound = topology.is_closed_manifold and topology.genus == genus - 1
        if sound and len(self_intersections(as_surface(made))) <= crossing:
            return made
    return None


def short_loops(points: FloatArray, faces: IntArray) -> list[IntArray]:
    """Nearly the shortest loop around a handle or a tunnel, and others through its vertices.

    A tree of shortest paths from a vertex, and a tree of faces that does not cross it, give a basis of the homology:
    loops through that vertex (Erickson and Whittlesey, Greedy optimal homotopy and homology generators, SODA 2005).
    From vertices along the shortest of these loops, still shorter loops are looked for. The other loops through the
    vertices of the best loop lead the other way around its handle, or along it.

    Parameters
    ----------
    points : (n, 3) mm
    faces : (m, 3), of one closed, oriented manifold

    Returns
    -------
    the vertices of each loop, in order; the shortest loop first; none for a sphere
    """
    links = _Links(points, faces)
    if not links.genus:
        return []
    found = links.loops_through(int(faces[0, 0]))[:_TRIED]
    for _ in range(_ROUNDS):
        shorter = [_shortest_near(links, loop) for loop in found]
        if sum(map(links.length, shorter)) >= sum(map(links.length, found)):
            break
        found = shorter
    best = min(found, key=links.length)
    every = [best, *links.loops_through(int(best[0]))[:_TRIED]]
    distinct = {frozenset(loop.tolist()): loop for loop in every}
    return sorted(distinct.values(), key=lambda loop: (links.length(loop), loop.tolist()))


def _shortest_near(links: _Links, loop: IntArray) -> IntArray:
    """The shortest loop through some vertices of a loop, or that loop itself."""
    best = loop
    for root in loop[:: max(len(loop) // _ROOTS, 1)].tolist():
        found = links.loops_through(root)
        if found and links.length(found[0]) < links.length(best):
            best = found[0]
    return best


class _Links:
    """Edges of a closed surface, and the faces that they join."""

    def __init__(self, points: FloatArray, faces: IntArray) -> None:
        sides = sides_of(faces)
        self.ends = np.sort(faces[:, TRI_EDGES].reshape(-1, 2)[sides.first], axis=1)
        self.behind = np.stack([sides.first // 3, sides.second // 3], axis=1)
        self.lengths = np.linalg.norm(points[self.ends[:, 0]] - points[self.ends[:, 1]], axis=1)
        self.points, self.count, self.faces = points, len(points), len(faces)
        used = len(np.unique(faces))
        self.genus = (2 - (used - len(self.ends) + len(faces))) // 2
        both = np.concatenate([self.ends, self.ends[:, ::-1]])
        self.graph: csr_matrix = coo_matrix(
            (np.tile(self.lengths, 2), (both[:, 0], both[:, 1])), shape=(self.count,) * 2
        ).tocsr()

    def length(self, loop: IntArray) -> float:
        """Length of a loop, mm."""
        return rim_length(self.points, loop)

    def loops_through(self, root: int) -> list[IntArray]:
        """A basis of loops, the shortest first: each leads from the root to an edge, along the edge, and back."""
        distance, before = dijkstra(self.graph, indices=root, return_predecessors=True)
        start, end = self.ends.T
        in_tree = (before[start] == end) | (before[end] == start)
        through = distance[start] + distance[end] + self.lengths
        left = self._not_in_cotree(np.flatnonzero(~in_tree), through)
        loops = [self._loop(int(edge), before) for edge in left[np.argsort(through[left], kind="stable")]]
        return sorted(loops, key=self.length)

    def _not_in_cotree(self, edges: NDArray[np.int64], through: FloatArray) -> NDArray[np.int64]:
        """The given edges except those crossed by the tree that joins all faces; the tree prefers the longest edges."""
        first, second = self.behind[edges].T
        # ranks that all differ, so that the tree is the same on every machine
        rank = np.empty(len(edges))
        rank[np.lexsort((edges, -through[edges]))] = np.arange(1, len(edges) + 1)
        low, high = np.minimum(first, second), np.maximum(first, second)
        pair = low.astype(np.int64) * self.faces + high
        best = np.lexsort((rank, pair))
        best = best[np.r_[True, pair[best][1:] != pair[best][:-1]]]
        tree = minimum_spanning_tree(coo_matrix((rank[best], (low[best], high[best])), shape=(self.faces,) * 2).tocsr())
        taken = np.zeros(len(edges) + 1, np.bool_)
        taken[tree.data.astype(np.int64)] = True
        return edges[~taken[rank.astype(np.int64)]]

    def _loop(self, edge: int, before: IntArray) -> IntArray:
        """The vertices of the loop of an edge, without the path that both of its ends share."""
        ways = []
        for vertex in self.ends[edge].tolist():
            way = [vertex]
            while before[way[-1]] >= 0:
                way.append(int(before[way[-1]]))
            ways.append(way)
        one, other = ways
        while len(one) > 1 and len(other) > 1 and one[-2] == other[-2]:
            one.pop()
            other.pop()
        return np.array([*one, *other[-2::-1]], np.int32)


def cut_open(faces: IntArray, loop: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Faces cut open along a loop, with copies of its vertices on its left; and their numbers, which begin at `count`.

    Parameters
    ----------
    loop : vertices of a closed path of edges, each once
    """
    following, copy = np.full(count, -1, np.int32), np.arange(count, dtype=np.int32)
    following[loop], copy[loop] = np.roll(loop, -1), count + np.arange(len(loop), dtype=np.int32)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    along = following[start] == end  # of the sides whose faces are on the left of the loop
    sides = sides_of(faces)
    kept = ~(along[sides.first] | along[sides.second])
    fan, _ = fans(faces, Sides(sides.counts, sides.first[kept], sides.second[kept], sides.same[kept]))
    left = np.isin(fan, fan[along])  # the loop parts the fan of each of its vertices
    return np.where(left, copy[start], start).reshape(-1, 3), copy[loop]


def back_to_the_feet(points: FloatArray, faces: IntArray, sides: tuple[IntArray, IntArray]) -> IntArray:
    """Vertices, ascending, whose faces go on both sides of a cut: as far as the rest of the handle reaches.

    A cut through a handle leaves two stumps; a cut around a tunnel leaves two pits. Their girth is that of the loop as
    far as their feet, where it grows. If the two sides meet before that, as on a ring, only the loop is removed.

    Parameters
    ----------
    points, faces : cut open along a loop
    sides : the vertices of the loop on either side of the cut
    """
    most = _FLARE * rim_length(points, sides[0])
    gone = [np.isin(np.arange(len(points)), side) for side in sides]
    for this, other in ((0, 1), (1, 0)):
        for _ in range(_MOST_RINGS):
            grown = gone[this].copy()
            grown[faces[faces_at(faces, grown)]] = True
            if (grown & gone[other]).any():
                return np.sort(np.concatenate(sides))
            if _rim_of(points, faces, grown) > most:
                break
            gone[this] = grown
    return np.flatnonzero(gone[0] | gone[1]).astype(np.int32)


def _rim_of(points: FloatArray, faces: IntArray, gone: NDArray[np.bool_]) -> float:
    """Length, mm, of the rim that remains once the faces at the vertices `gone` (n,) are removed."""
    touched = faces[faces_at(faces, gone)]
    sides = touched[:, TRI_EDGES].reshape(-1, 2)
    rim = sides[~gone[sides].any(axis=1)]
    return float(np.linalg.norm(points[rim[:, 0]] - points[rim[:, 1]], axis=1).sum())
