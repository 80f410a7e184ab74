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
#: sides of a tube, and rings along it
_SIDES, _RINGS = 12, 24


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


def handle(surface: TriSurface, diameter: float) -> TriSurface:
    """An arch of so many mm in diameter between two places of the crown that lies highest."""
    top = outermost(surface, (0, 0, 1))
    distance = along(surface, top)
    apart = np.abs(distance - 3 * diameter - 4)
    far = np.flatnonzero(apart < 1.5)[surface.points[apart < 1.5, 2].argmax()]
    opened = [np.flatnonzero(along(surface, int(v)) <= diameter / 2) for v in (top, far)]
    up = np.array([0, 0, 1.0])
    ends = [(surface.points[v], up) for v in (top, int(far))]
    return _with_tube(surface, opened, ends, radius=diameter / 2, height=1.5 * diameter)


def bridge(surface: TriSurface) -> TriSurface:
    """Two banks of a sulcus joined by a tube through what is between them."""
    one, other = _facing_banks(surface)
    distance = [along(surface, v) for v in (one, other)]
    start, end = edges(surface.faces).T
    edge = np.linalg.norm(surface.points[start] - surface.points[end], axis=1).mean()
    opened = [np.flatnonzero(d <= edge) for d in distance]
    across = surface.points[other] - surface.points[one]
    ends = [(surface.points[one], across), (surface.points[other], -across)]
    return _with_tube(surface, opened, ends, radius=edge, height=0.0)


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


def _with_tube(
    surface: TriSurface,
    opened: list[IntArray],
    ends: list[tuple[FloatArray, FloatArray]],
    *,
    radius: float,
    height: float,
) -> TriSurface:
    """Two holes in a surface joined by a tube on an arc between them.

    Parameters
    ----------
    opened : vertices that are cut out at each end
    ends : place and direction of the tube at each end
    """
    cut = without(surface, np.concatenate(opened))
    one, other = sorted(rims(cut.faces), key=lambda rim: np.linalg.norm(cut.points[rim].mean(axis=0) - ends[0][0]))[:2]
    t = np.linspace(0, 1, _RINGS + 2)[1:-1, None]
    (a, up_a), (b, up_b) = ends
    bow = height * 4 * t * (1 - t)
    line = (1 - t) * a + t * b + bow * ((1 - t) * up_a + t * up_b)
    ahead = np.gradient(line, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.cross(ahead, _perpendicular(b - a, up_a))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, ahead)
    angle = np.arange(_SIDES) * 2 * np.pi / _SIDES
    rings = line[:, None] + 0.7 * radius * (
        np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * up[:, None]
    )
    number = len(cut.points) + np.arange(_RINGS * _SIDES).reshape(_RINGS, _SIDES)
    points = np.concatenate([cut.points, rings.reshape(-1, 3)])
    walls = [_strip(points, *loops) for loops in zip([one, *number], [*number, other], strict=True)]
    return TriSurface(points, outward(points, np.concatenate([cut.faces, *walls])))


def _perpendicular(vector: FloatArray, near: FloatArray) -> FloatArray:
    """Of the directions across a vector, the one nearest to another."""
    across = near - vector * (near @ vector) / (vector @ vector)
    if np.linalg.norm(across) < 1e-6:
        across = np.cross(vector, np.eye(3)[np.abs(vector).argmin()])
    return across / np.linalg.norm(across)


def _strip(points: FloatArray, one: IntArray, other: IntArray) -> IntArray:
    """Triangles between two closed rings of vertices, by the shorter of the two edges that may come next."""
    centre = points[np.r_[one, other]].mean(axis=0)
    axis = points[other].mean(axis=0) - points[one].mean(axis=0)

    def turns(ring: IntArray) -> float:
        offset = points[ring] - centre
        return float(np.cross(offset, np.roll(offset, -1, axis=0)).sum(axis=0) @ axis)

    one, other = (ring if turns(ring) > 0 else ring[::-1] for ring in (one, other))
    first = int(np.linalg.norm(points[other] - points[one[0]], axis=1).argmin())
    other = np.roll(other, -first)
    faces, i, j = [], 0, 0
    while i < len(one) or j < len(other):
        a, b = one[i % len(one)], other[j % len(other)]
        c, d = one[(i + 1) % len(one)], other[(j + 1) % len(other)]
        first_is_shorter = np.linalg.norm(points[c] - points[b]) < np.linalg.norm(points[d] - points[a])
        if j == len(other) or (i < len(one) and first_is_shorter):
            faces.append((a, c, b))
            i += 1
        else:
            faces.append((a, d, b))
            j += 1
    return np.array(faces, np.int32)


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
    "handle of 2 mm": lambda surface: handle(surface, 2.0),
    "handle of 8 mm": lambda surface: handle(surface, 8.0),
    "bridge between banks": bridge,
    "50 crossing triangles": crossing,
    "doubled faces": doubled,
    "isolated component": isolated,
    "flipped patch": flipped,
    "duplicated vertices": apart,
    "spike of 8 mm": spike,
    "NaN vertex": unknown,
    "voxel staircase of 1.5 mm": staircase,
}
