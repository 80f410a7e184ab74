"""Move inner surfaces inward where they touch, cross or nearly touch the surface around them.

Where the cortex ends, at the medial wall, white and pial surface are the same, and each is drawn with its own error: in
every real pair thousands of triangles cross there. A region between them needs room for a cell, so the inner surface
gives way, along the outer one's normals, smoothly, and no farther than it takes. In blades too thin for two gaps and
something between them it gives way less.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats.gifti import single_precision
from cortet.geometry.closest_point import SurfaceTree, tree_of
from cortet.geometry.intersection import self_intersections
from cortet.geometry.mending import rings
from cortet.geometry.nesting import depths, joined, parents, region_boundary, region_names, sheets
from cortet.geometry.topology import edges, enclosed_volume, neighbour_means, vertex_normals
from cortet.mesh import FloatArray, IntArray, TriSurface
from cortet.meshers.thickness import thickness

VERSION: int = 2

#: share of the thickness of a blade that the gap takes at most, on each of its sides
SHARE_OF_BLADE = 0.25
#: steps towards the gap; how far a point may stay from it, as a share
_STEPS, _TOLERANCE = 40, 0.02
#: share of each step that is the mean of the steps of the neighbours, and how often that mean is taken
_SMOOTH, _SMOOTHINGS = 0.3, 2
#: rounds of smoothing where triangles cross after that; share of the gap that vertices there are pushed in each
_ROUNDS, _NUDGE = 15, 0.2

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Separated:
    """What was done to one inner surface."""

    #: of the region inside it
    name: str
    min_gap_mm: float
    #: triangles of the two surfaces that crossed, before
    crossing_faces_before: int
    #: farthest that a vertex was outside the surface around it
    outside_max_mm: float
    vertices: int
    vertices_moved: int
    #: of all vertices
    moved_mean_mm: float
    moved_max_mm: float
    #: where that was
    moved_most_at_mm: tuple[float, float, float]
    #: smallest distance of a vertex to the surface around it, afterwards
    gap_least_mm: float
    #: vertices in blades where that is less than the gap asked for
    vertices_in_thin_blades: int
    #: enclosed by this surface, before and after
    volume_before_ml: float
    volume_ml: float
    #: of the region between it and the surface around it
    around_before_ml: float
    around_ml: float


@dataclass(frozen=True)
class SeparateReport:
    """One entry for each inner surface."""

    surfaces: tuple[Separated, ...]


def separate(
    surface: TriSurface, *, cell_size: float, min_gap: float = 0.5, max_outside: float = 0.5
) -> tuple[TriSurface, SeparateReport]:
    """Move inner surfaces inward until they keep a distance from the surfaces around them.

    Coordinates of the result are float32 values, so GIfTI files hold them exactly.

    Parameters
    ----------
    surface : with its inner surfaces, none of which crosses itself
    cell_size : mm
    min_gap : distance to keep, a fraction of `cell_size`
    max_outside : mm, farthest that an inner surface may lie outside the one around it

    Raises
    ------
    InputError
        a surface is not inside the one around it, or cannot be moved there; says where
    """
    around = parents(surface)
    names = region_names(surface)
    _check_volumes(surface)
    reports = []
    for number in range(1, len(names)):
        one = sheets(surface)[number]
        alone = replace(surface, inner={k: v for k, v in surface.inner.items() if k != names[number]})
        place = around[number] - (around[number] > number)
        container = region_boundary(alone, place)
        moved, report = _moved_inside(
            one, container, name=names[number], gap=min_gap * cell_size, max_outside=max_outside
        )
        surface = replace(surface, inner={**surface.inner, names[number]: moved})
        reports.append(report)
    return surface, SeparateReport(tuple(reports))


def _check_volumes(surface: TriSurface) -> None:
    outer = enclosed_volume(surface.points, surface.faces)
    for name, one in surface.inner.items():
        volume = enclosed_volume(one.points, one.faces)
        if volume > outer:
            raise InputError(
                f"the inner surface {name} encloses {volume / 1000:.1f} mL, the outer one {outer / 1000:.1f} mL",
                remedy="exchange them: the outer surface (pial) comes first",
            )


def _moved_inside(
    surface: TriSurface, container: TriSurface, *, name: str, gap: float, max_outside: float
) -> tuple[TriSurface, Separated]:
    tree = tree_of(container)
    normals = vertex_normals(container.points, container.faces)
    gaps = np.minimum(
        gap, SHARE_OF_BLADE * thickness(tree, container.points, normals, 4 * gap / SHARE_OF_BLADE, inside=True)
    )
    depth, _, _ = depths(tree, container, surface.points)
    worst = int(depth.argmin())
    if depth[worst] < -max_outside:
        raise InputError(
            f"the inner surface {name} lies up to {-depth[worst]:.2f} mm outside the one around it, at "
            f"{_place(surface.points[worst])}, {(depth < -max_outside).mean():.1%} of its vertices by more than "
            f"{max_outside:g} mm",
            remedy="check that both are of one subject, in one space; where that is right, set regions.max_outside",
        )
    crossing = len(self_intersections(joined([surface, container])))
    pushed = replace(surface, points=_pushed(surface, container, tree, gaps))
    moved, remaining = _uncrossed(pushed, container, tree, gap)
    if len(remaining):
        moved, remaining = _taken_back(pushed, surface, container)
    points = moved.points
    if len(remaining):
        both = joined([moved, container])
        first = both.points[both.faces[remaining[0]]].mean(axis=0)
        raise InputError(
            f"the inner surface {name} cannot be moved away from the one around it: {len(remaining)} triangles "
            f"cross, the first at {_place(first)}",
            remedy="edit the surfaces there, or choose a smaller regions.min_gap",
        )
    after, _, found = depths(tree, container, points)
    distance = np.linalg.norm(points - surface.points, axis=1)
    far = int(distance.argmax())
    asked = np.einsum("kc,kc->k", found.barycentric, gaps[container.faces[found.faces]])
    x, y, z = surface.points[far].tolist()
    before, volume = (enclosed_volume(p, surface.faces) / 1000 for p in (surface.points, points))
    whole = enclosed_volume(container.points, container.faces) / 1000
    report = Separated(
        name=name,
        min_gap_mm=gap,
        crossing_faces_before=crossing,
        outside_max_mm=float(max(-depth[worst], 0)),
        vertices=len(points),
        vertices_moved=int((distance > 0).sum()),
        moved_mean_mm=float(distance.mean()),
        moved_max_mm=float(distance.max()),
        moved_most_at_mm=(x, y, z),
        gap_least_mm=float(after.min()),
        vertices_in_thin_blades=int(((after < gap * (1 - _TOLERANCE)) & (asked < gap)).sum()),
        volume_before_ml=before,
        volume_ml=volume,
        around_before_ml=whole - before,
        around_ml=whole - volume,
    )
    logger.info(
        "%s: %d of %d vertices moved by up to %.3f mm, %.3f on average",
        name,
        report.vertices_moved,
        report.vertices,
        report.moved_max_mm,
        report.moved_mean_mm,
    )
    return moved, report


def _pushed(surface: TriSurface, container: TriSurface, tree: SurfaceTree, gaps: FloatArray) -> FloatArray:
    """Positions of the vertices of `surface` at which it keeps the `gaps` of the container's vertices."""
    links = edges(surface.faces)
    points = surface.points.copy()
    corners, weights = _samples(surface, spacing=float(gaps.max()))
    active = np.arange(len(corners))
    for step in range(_STEPS):
        places = np.einsum("kc,kcj->kj", weights[active], points[corners[active]])
        depth, normal, found = depths(tree, container, places)
        wanted = np.einsum("kc,kc->k", found.barycentric, gaps[container.faces[found.faces]])
        short = np.where(wanted - depth > _TOLERANCE * wanted, wanted - depth, 0)
        if not short.any():
            break
        if step == 0:  # the others never come near
            active = active[depth < 3 * gaps.max()]
            short, normal = (values[depth < 3 * gaps.max()] for values in (short, normal))
        step_of = _largest(corners[active], short, -normal, len(points))
        points += _smoothed(links, step_of)
    return points


def _samples(surface: TriSurface, *, spacing: float) -> tuple[IntArray, FloatArray]:
    """Vertices, then points in the faces: the corners (k, 3) of a triangle and their weights (k, 3).

    A face is sampled at its centre, or where edges are more than twice the spacing (mm) long, on a grid of that.
    """
    number = np.arange(len(surface.points), dtype=np.int32)
    corners, weights = [np.column_stack([number] * 3)], [np.tile([1.0, 0, 0], (len(number), 1))]
    start, end = edges(surface.faces).T
    edge = float(np.linalg.norm(surface.points[start] - surface.points[end], axis=1).mean())
    parts = int(np.ceil(edge / (2 * spacing)))
    grid = [(i / parts, j / parts) for i in range(parts + 1) for j in range(parts + 1 - i)] if parts > 1 else []
    for u, v in [(1 / 3, 1 / 3), *grid]:
        if max(u, v, 1 - u - v) < 1:
            corners.append(surface.faces)
            weights.append(np.tile([u, v, 1 - u - v], (len(surface.faces), 1)))
    return np.concatenate(corners), np.concatenate(weights)


def _uncrossed(
    surface: TriSurface, container: TriSurface, tree: SurfaceTree, gap: float
) -> tuple[TriSurface, IntArray]:
    """Smooth and push inward the vertices of triangles that still cross others, and of ever more around them.

    Returns also the triangles of both surfaces that cross in the end, those of the container last.
    """

    def smoothed(surface: TriSurface, chosen: NDArray[np.bool_]) -> FloatArray:
        depth, normal, _ = depths(tree, container, surface.points[chosen])
        points = (surface.points[chosen] + neighbour_means(surface.points, surface.faces)[chosen]) / 2
        # only where the other surface is near: a surface may also cross itself deep inside
        moved: FloatArray = points - np.where(depth < 2 * gap, _NUDGE * gap, 0)[:, None] * normal
        return moved

    return _moved_apart(surface, container, smoothed)


def _taken_back(pushed: TriSurface, given: TriSurface, container: TriSurface) -> tuple[TriSurface, IntArray]:
    """Let the vertices of triangles that cross others, and ever more around them, go back to where they were given.

    Where an inner surface is too thin to give way on both sides, the gap becomes smaller than asked for. Returns also
    the triangles that cross in the end, as `_uncrossed` does.
    """
    return _moved_apart(pushed, container, lambda one, chosen: (one.points[chosen] + given.points[chosen]) / 2)


def _moved_apart(
    surface: TriSurface,
    container: TriSurface,
    moved: Callable[[TriSurface, NDArray[np.bool_]], FloatArray],
) -> tuple[TriSurface, IntArray]:
    """Give the vertices of crossing triangles, and of ever more around them, the places that `moved` has for them."""
    for number in range(_ROUNDS + 1):
        surface = single_precision(surface)
        crossing = self_intersections(joined([surface, container]))
        own = crossing[crossing < len(surface.faces)]
        if not len(own) or number == _ROUNDS:
            break
        chosen = np.zeros(len(surface.points), np.bool_)
        chosen[surface.faces[own]] = True
        chosen = rings(surface.faces, chosen, number // 3)
        points = surface.points.copy()
        points[chosen] = moved(surface, chosen)
        surface = replace(surface, points=points)
    return surface, crossing


def _largest(corners: IntArray, lengths: FloatArray, directions: FloatArray, count: int) -> FloatArray:
    """For each vertex, the longest of the steps that the samples it belongs to ask for: (count, 3)."""
    rows, vertex = np.repeat(np.arange(len(corners)), 3), corners.ravel()
    rows, vertex = rows[lengths[rows] > 0], vertex[lengths[rows] > 0]
    order = np.lexsort((rows, -lengths[rows], vertex))
    vertex, rows = vertex[order], rows[order]
    first = np.r_[True, vertex[1:] != vertex[:-1]][: len(vertex)]
    steps = np.zeros((count, 3))
    steps[vertex[first]] = lengths[rows[first], None] * directions[rows[first]]
    return steps


def _smoothed(links: IntArray, steps: FloatArray) -> FloatArray:
    """Steps (n, 3) that are partly the mean of those around, so that what is moved goes over into what is not."""
    asked = (steps != 0).any(axis=1)
    smooth = steps
    for _ in range(_SMOOTHINGS):
        smooth = (smooth + _neighbour_mean(links, smooth)) / 2
    return np.where(asked[:, None], (1 - _SMOOTH) * steps + _SMOOTH * smooth, smooth)


def _neighbour_mean(links: IntArray, values: FloatArray) -> FloatArray:
    start, end = np.concatenate([links, links[:, ::-1]]).T
    count = np.bincount(start, minlength=len(values))
    total = np.stack([np.bincount(start, values[end, axis], minlength=len(values)) for axis in range(3)], axis=1)
    mean: NDArray[np.float64] = total / np.maximum(count, 1)[:, None]
    return mean


def _place(point: FloatArray) -> str:
    return "({}) mm".format(", ".join(f"{x:.1f}" for x in point))
