"""Good surfaces, broken in a known way: what tests repair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from cortet.geometry.holes import rims
from cortet.geometry.mending import chosen_faces, compacted, pieces, split_fans, triangles
from cortet.geometry.nesting import joined
from cortet.geometry.orientation import outward
from cortet.geometry.topology import edges, vertex_normals
from cortet.meshes import FloatArray, IntArray, TriSurface


def along(surface: TriSurface, vertex: int) -> FloatArray:
    """Distance of every vertex from one, along edges: (n,) mm."""
    start, end = edges(surface.faces).T
    lengths = np.linalg.norm(surface.points[start] - surface.points[end], axis=1)
    graph = coo_matrix((lengths, (start, end)), shape=(len(surface.points),) * 2)
    return dijkstra(graph, directed=False, indices=vertex)


def outermost(surface: TriSurface, direction: tuple[float, float, float]) -> int:
    """The vertex farthest in a direction."""
    return int((surface.points @ np.array(direction)).argmax())


def without(surface: TriSurface, vertices: IntArray) -> TriSurface:
    """The surface without the faces at some vertices."""
    kept = ~np.isin(surface.faces, vertices).any(axis=1)
    work = triangles(surface.points, surface.faces[kept])
    piece, _ = pieces(work)
    work = compacted(split_fans(chosen_faces(work, piece == 0))[0])
    return TriSurface(work.points, work.faces)


def hole(surface: TriSurface, diameter: float) -> TriSurface:
    """A round hole in the crown that lies highest, so many mm wide."""
    top = outermost(surface, (0, 0, 1))
    return without(surface, np.flatnonzero(along(surface, top) <= diameter / 2))


def handle(surface: TriSurface, rings: int) -> TriSurface:
    """A tunnel between two places of the crown that lies highest, so many rings of triangles wide."""
    top = outermost(surface, (0, 0, 1))
    start, end = edges(surface.faces).T
    steps = coo_matrix((np.ones(len(start)), (start, end)), shape=(len(surface.points),) * 2)
    for other in np.argsort(np.abs(along(surface, top) - 20 - 2 * rings), kind="stable").tolist():
        near = dijkstra(steps, directed=False, unweighted=True, indices=[top, other], limit=rings - 0.5).min(axis=0)
        cut = without(surface, np.flatnonzero(np.isfinite(near)))
        found = rims(cut.faces)
        if len(found) == 2 and len(found[0]) == len(found[1]):
            rim, facing = found[0], found[1][::-1]
            turns = [np.roll(facing, turn) for turn in range(len(facing))]
            lengths = [np.linalg.norm(cut.points[rim] - cut.points[turned], axis=1).sum() for turned in turns]
            facing = turns[int(np.argmin(lengths))]
            ahead, beyond = np.roll(rim, -1), np.roll(facing, -1)
            walls = np.concatenate([np.column_stack([rim, ahead, facing]), np.column_stack([ahead, beyond, facing])])
            return TriSurface(cut.points, outward(cut.points, np.concatenate([cut.faces, walls])))
    raise ValueError("no two rims of the surface are of the same length")


def doubled(surface: TriSurface, share: float = 0.02) -> TriSurface:
    """A share of the triangles twice."""
    again = np.random.default_rng(0).choice(len(surface.faces), int(share * len(surface.faces)), replace=False)
    return replace(surface, faces=np.concatenate([surface.faces, surface.faces[np.sort(again)]]))


def isolated(surface: TriSurface) -> TriSurface:
    """With a ball of 2 mm beside it."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    place = surface.points[outermost(surface, (0, 0, 1))] + np.array([0, 0, 5.0])
    return joined([surface, TriSurface(ball.vertices + place, ball.faces)])


def flipped(surface: TriSurface, diameter: float = 10.0) -> TriSurface:
    """The triangles of a patch turned inward."""
    near = along(surface, outermost(surface, (0, 0, 1))) <= diameter / 2
    inward = near[surface.faces].all(axis=1)
    return replace(surface, faces=np.where(inward[:, None], surface.faces[:, ::-1], surface.faces))


def apart(surface: TriSurface, diameter: float = 10.0) -> TriSurface:
    """The triangles of a patch with vertices of their own."""
    near = along(surface, outermost(surface, (0, 0, 1))) <= diameter / 2
    chosen = near[surface.faces].all(axis=1)
    faces, corners = surface.faces.copy(), surface.faces[chosen].ravel()
    faces[chosen] = len(surface.points) + np.arange(len(corners)).reshape(-1, 3)
    return TriSurface(np.concatenate([surface.points, surface.points[corners]]), faces)


def spike(surface: TriSurface, height: float = 8.0) -> TriSurface:
    """One vertex pulled out."""
    top = outermost(surface, (0, 0, 1))
    points = surface.points.copy()
    points[top] += height * vertex_normals(points, surface.faces)[top]
    return replace(surface, points=points)


def unknown(surface: TriSurface) -> TriSurface:
    """One vertex without coordinates."""
    points = surface.points.copy()
    points[outermost(surface, (0, 0, 1))] = np.nan
    return replace(surface, points=points)


BREAKAGES: dict[str, Callable[[TriSurface], TriSurface]] = {
    "hole of 5 mm": lambda surface: hole(surface, 5.0),
    "hole of 30 mm": lambda surface: hole(surface, 30.0),
    "narrow handle": lambda surface: handle(surface, 1),
    "wide handle": lambda surface: handle(surface, 3),
    "doubled faces": doubled,
    "both sides": lambda surface: replace(surface, faces=np.concatenate([surface.faces, surface.faces[:, ::-1]])),
    "isolated component": isolated,
    "flipped patch": flipped,
    "duplicated vertices": apart,
    "spike of 8 mm": spike,
    "NaN vertex": unknown,
}
