"""Good surfaces, broken in a known way: what tests repair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from cortet.geometry.closest_point import tree_of
from cortet.geometry.holes import rims
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import chosen_faces, compacted, pieces, split_fans, triangles
from cortet.geometry.nesting import depths, joined
from cortet.geometry.orientation import outward
from cortet.geometry.thickness import thickness
from cortet.geometry.topology import edges, face_areas, vertex_normals
from cortet.meshes import FloatArray, IntArray, TriSurface

#: mm, farthest apart that two banks are joined
_BETWEEN_BANKS = 6.0


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


def medial_wall_cut_out(surface: TriSurface, share: float = 0.08) -> TriSurface:
    """A share of the surface around the middle of its flatter side cut away, as a medial wall is."""
    middle = surface.points.mean(axis=0)
    side = np.sign(np.median(surface.points[:, 0] - middle[0]))
    seen = np.abs(surface.points[:, 1:] - middle[1:]).max(axis=1) < 3
    centre = np.flatnonzero(seen)[(side * surface.points[seen, 0]).argmax()]
    distance = along(surface, int(centre))
    area = np.bincount(surface.faces.ravel(), np.repeat(face_areas(surface.points, surface.faces) / 3, 3))
    order = np.argsort(distance, kind="stable")
    return without(surface, order[: int(np.searchsorted(np.cumsum(area[order]), share * area.sum()))])


def handle(surface: TriSurface, rings: int) -> TriSurface:
    """A tunnel between two places of the crown that lies highest, so many rings of triangles wide."""
    top = outermost(surface, (0, 0, 1))
    far = np.argsort(np.abs(along(surface, top) - 20 - 2 * rings), kind="stable")
    return _joined_by_a_tube(surface, top, far, rings)


def bridge(surface: TriSurface) -> TriSurface:
    """Two banks of a sulcus joined by a tube through what is between them."""
    one, other = _facing_banks(surface)
    return _joined_by_a_tube(surface, one, np.argsort(along(surface, other), kind="stable"), 1)


def _joined_by_a_tube(surface: TriSurface, one: int, others: IntArray, rings: int) -> TriSurface:
    """Rings of triangles around a vertex, and around the first other that has as long a rim, in place of a tube."""
    start, end = edges(surface.faces).T
    steps = coo_matrix((np.ones(len(start)), (start, end)), shape=(len(surface.points),) * 2)
    for other in others.tolist():
        near = dijkstra(steps, directed=False, unweighted=True, indices=[one, other], limit=rings - 0.5).min(axis=0)
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


def _facing_banks(surface: TriSurface) -> tuple[int, int]:
    """Two vertices that face each other across a sulcus, far from each other along the surface."""
    normals = vertex_normals(surface.points, surface.faces)
    width = thickness(tree_of(surface), surface.points, normals, _BETWEEN_BANKS, inside=False)
    start, end = edges(surface.faces).T
    edge = np.linalg.norm(surface.points[start] - surface.points[end], axis=1).mean()
    for one in np.argsort(np.abs(width - 3 * edge), kind="stable")[:200].tolist():
        place = surface.points[one] + width[one] * normals[one]
        other = int(np.linalg.norm(surface.points - place, axis=1).argmin())
        if normals[one] @ normals[other] < -0.7 and along(surface, one)[other] > 4 * width[one]:
            return one, other
    raise ValueError("the surface has no sulcus whose banks face each other")


def crossing(surface: TriSurface, count: int = 50) -> TriSurface:
    """One bank of a sulcus pushed through the other, until so many triangles cross."""
    one, other = _facing_banks(surface)
    across = surface.points[other] - surface.points[one]
    width = float(np.linalg.norm(across))
    reach = np.exp(-((along(surface, one) / (2 * width)) ** 2))[:, None]
    pushed = surface
    for length in np.arange(1.0, 2.0, 0.05):
        pushed = replace(surface, points=surface.points + length * reach * across)
        if len(self_intersections(pushed)) >= count:
            break
    return pushed


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


def staircase(surface: TriSurface, spacing: float = 1.5) -> TriSurface:
    """The faces of the voxels whose middles are inside."""
    low = surface.points.min(axis=0) - 1.5 * spacing
    shape = np.ceil((np.ptp(surface.points, axis=0) + 3 * spacing) / spacing).astype(int)
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    centres = low + (index + 0.5) * spacing
    inside = (depths(tree_of(surface), surface, centres.reshape(-1, 3))[0] > 0).reshape(shape)
    return voxels(inside, low, spacing)


def voxels(inside: NDArray[np.bool_], low: FloatArray, spacing: float) -> TriSurface:
    """The faces between voxels that are inside (i, j, k) and others; `low` is the lowest corner of the grid, mm."""
    quads = []
    for axis in range(3):
        step = np.diff(inside.astype(np.int8), axis=axis)
        for sign in (1, -1):
            place = np.argwhere(step == sign)
            place[:, axis] += 1
            u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
            square = np.stack([place, place + u, place + u + v, place + v], axis=1)
            quads.append(square[:, ::-1] if sign > 0 else square)
    corners = np.concatenate(quads)
    used, number = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    number = number.reshape(-1, 4)
    return TriSurface(low + used * spacing, np.concatenate([number[:, :3], number[:, [0, 2, 3]]]))


BREAKAGES: dict[str, Callable[[TriSurface], TriSurface]] = {
    "hole of 5 mm": lambda surface: hole(surface, 5.0),
    "hole of 30 mm": lambda surface: hole(surface, 30.0),
    "medial wall cut out": medial_wall_cut_out,
    "narrow handle": lambda surface: handle(surface, 1),
    "wide handle": lambda surface: handle(surface, 3),
    "bridge between banks": bridge,
    "50 crossing triangles": crossing,
    "doubled faces": doubled,
    "isolated component": isolated,
    "flipped patch": flipped,
    "duplicated vertices": apart,
    "spike of 8 mm": spike,
    "NaN vertex": unknown,
}
