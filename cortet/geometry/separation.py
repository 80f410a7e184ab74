"""Move a surface inward, smoothly and no farther than needed, until it keeps its distance to the surface around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.closest_point import SurfaceTree
from cortet.geometry.nesting import depths
from cortet.geometry.thickness import thickness
from cortet.geometry.topology import edges, linked_means, mean_edge, neighbour_means, vertex_normals
from cortet.geometry.uncrossing import moved_apart
from cortet.meshes import FloatArray, IntArray, TriSurface, single_precision

#: largest share of the thickness of a blade that the gap may take on each of its sides
SHARE_OF_BLADE = 0.25
#: how far a point may fall short of the gap, as a share of the gap; most steps towards it
TOLERANCE, _STEPS = 0.02, 40
#: weight of the mean of the neighbours' steps in each step, and how often that mean is taken
_SMOOTH, _SMOOTHINGS = 0.3, 2
#: rounds of smoothing where triangles still cross; how far each round pushes vertices there, as a share of the gap
_ROUNDS, _NUDGE = 15, 0.2


def gaps_to_keep(container: TriSurface, tree: SurfaceTree, gap: float) -> FloatArray:
    """Distance (n,), mm, to keep from each vertex of a container: `gap`, or less in blades that are too thin for it."""
    normals = vertex_normals(container.points, container.faces)
    blades = thickness(tree, container.points, normals, 4 * gap / SHARE_OF_BLADE, inside=True)
    return np.minimum(gap, SHARE_OF_BLADE * blades)


def kept_apart(
    surface: TriSurface, container: TriSurface, tree: SurfaceTree, gaps: FloatArray, gap: float
) -> tuple[TriSurface, IntArray]:
    """The surface after it is moved inward along the container's normals, and the triangles that still cross, (k,).

    Parameters
    ----------
    surface : mm; its coordinates come back as float32 values
    container, tree : the surface around it, and its tree
    gaps : (n,) mm, `gaps_to_keep` of the container
    gap : mm, the largest of the `gaps`
    """
    pushed = single_precision(replace(surface, points=_pushed(surface, container, tree, gaps)))
    moved, remaining = _smoothed_apart(pushed, container, tree, gap)
    return taken_back(pushed, surface, container) if len(remaining) else (moved, remaining)


def _pushed(surface: TriSurface, container: TriSurface, tree: SurfaceTree, gaps: FloatArray) -> FloatArray:
    """Positions of the vertices of `surface`, moved until it keeps the `gaps` of the container's vertices."""
    links = edges(surface.faces)
    points = surface.points.copy()
    corners, weights = _samples(surface, spacing=float(gaps.max()))
    active = np.arange(len(corners))
    for step in range(_STEPS):
        places = np.einsum("kc,kcj->kj", weights[active], points[corners[active]])
        depth, normal, found = depths(tree, container, places)
        wanted = np.einsum("kc,kc->k", found.barycentric, gaps[container.faces[found.faces]])
        short = np.where(wanted - depth > TOLERANCE * wanted, wanted - depth, 0)
        if not short.any():
            break
        if step == 0:  # samples that are far away now never come near
            active = active[depth < 3 * gaps.max()]
            short, normal = (values[depth < 3 * gaps.max()] for values in (short, normal))
        step_of = _largest(corners[active], short, -normal, len(points))
        points += _smoothed(links, step_of)
    return points


def _samples(surface: TriSurface, *, spacing: float) -> tuple[IntArray, FloatArray]:
    """Vertices, then points in the faces: the corners (k, 3) of a triangle and their weights (k, 3).

    A face is sampled at its centre; if an edge is longer than twice the spacing (mm), on a grid of that spacing.
    """
    number = np.arange(len(surface.points), dtype=np.int32)
    corners, weights = [np.column_stack([number] * 3)], [np.tile([1.0, 0, 0], (len(number), 1))]
    parts = int(np.ceil(mean_edge(surface.points, surface.faces) / (2 * spacing)))
    grid = [(i / parts, j / parts) for i in range(parts + 1) for j in range(parts + 1 - i)] if parts > 1 else []
    for u, v in [(1 / 3, 1 / 3), *grid]:
        if max(u, v, 1 - u - v) < 1:
            corners.append(surface.faces)
            weights.append(np.tile([u, v, 1 - u - v], (len(surface.faces), 1)))
    return np.concatenate(corners), np.concatenate(weights)


def _smoothed_apart(
    surface: TriSurface, container: TriSurface, tree: SurfaceTree, gap: float
) -> tuple[TriSurface, IntArray]:
    """Smooth and push inward the vertices of triangles that still cross, and ever more vertices around them."""

    def smoothed(surface: TriSurface, chosen: NDArray[np.bool_], _: int) -> FloatArray:
        depth, normal, _found = depths(tree, container, surface.points[chosen])
        points = surface.points.copy()
        middle = (points[chosen] + neighbour_means(points, surface.faces)[chosen]) / 2
        # pushed only where the other surface is near: a surface may also cross itself deep inside
        points[chosen] = middle - np.where(depth < 2 * gap, _NUDGE * gap, 0)[:, None] * normal
        return points

    return moved_apart(surface, smoothed, rounds=_ROUNDS, beside=container)


def taken_back(pushed: TriSurface, given: TriSurface, container: TriSurface) -> tuple[TriSurface, IntArray]:
    """Move the vertices of crossing triangles, and ever more around them, back to their given positions.

    Where an inner surface is too thin to give way on both sides, the gap stays smaller than requested. Returns also
    the triangles that still cross.
    """

    def halfway_back(surface: TriSurface, chosen: NDArray[np.bool_], _: int) -> FloatArray:
        return np.where(chosen[:, None], (surface.points + given.points) / 2, surface.points)

    return moved_apart(single_precision(pushed), halfway_back, rounds=_ROUNDS, beside=container)


def _largest(corners: IntArray, lengths: FloatArray, directions: FloatArray, count: int) -> FloatArray:
    """The longest step that the samples of each vertex ask for: (count, 3)."""
    rows, vertex = np.repeat(np.arange(len(corners)), 3), corners.ravel()
    rows, vertex = rows[lengths[rows] > 0], vertex[lengths[rows] > 0]
    order = np.lexsort((rows, -lengths[rows], vertex))
    vertex, rows = vertex[order], rows[order]
    first = np.r_[True, vertex[1:] != vertex[:-1]][: len(vertex)]
    steps = np.zeros((count, 3))
    steps[vertex[first]] = lengths[rows[first], None] * directions[rows[first]]
    return steps


def _smoothed(links: IntArray, steps: FloatArray) -> FloatArray:
    """Steps (n, 3) mixed with the mean of the steps around them, so that moved and unmoved vertices join smoothly."""
    asked = (steps != 0).any(axis=1)
    smooth = steps
    for _ in range(_SMOOTHINGS):
        smooth = (smooth + linked_means(smooth, links)) / 2
    return np.where(asked[:, None], (1 - _SMOOTH) * steps + _SMOOTH * smooth, smooth)
