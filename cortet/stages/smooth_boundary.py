"""Post-mesh smoothing of the boundary (CORTET paper, section 4.4): optional, after the elements are good.

The boundary of a mesh is rougher than its surface, because its triangles are irregular. The published stage smooths it
and accepts that it leaves the surface. Here the smoothed boundary is put back onto the surface by default. This keeps
most of what smoothing gained, which is a better arrangement of vertices, not another shape.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from cortet.config.section import Boundary
from cortet.config.stages import Clean, SmoothBoundary
from cortet.geometry.closest_point import SurfaceTree, closest_points, tree_of
from cortet.geometry.nesting import joined, sheets
from cortet.geometry.smoothing import surface_preserving
from cortet.geometry.topology import edges, sheet
from cortet.measure.fidelity import Distances, boundary_roughness, summary
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface
from cortet.optimise.crossing import without_crossing
from cortet.optimise.soundness import require_sound
from cortet.stages.clean import clean

VERSION: int = 8

#: layers of interior nodes that follow the boundary, each by this share of the one above
_SHELLS, _FOLLOWING = 2, 0.5
#: how many times the iterations are halved if elements invert
_RETRIES = 4

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SmoothBoundaryReport:
    """What was done, and the result."""

    onto_surface: bool
    #: the requested number, halved until no element inverted; 0 if even one iteration inverts some
    iterations: int
    #: RMS distance of boundary and interface vertices from the mean of their neighbours, over the mean edge length
    roughness_before: float
    roughness: float
    #: of these nodes, each to its surface
    nodes_to_surface_mm: Distances
    #: how far they moved
    displacement_mm: Distances
    q_mean_before: float
    q_max_before: float
    q_mean: float
    q_max: float
    vertices_held: int


def smooth_boundary(
    mesh: TetMesh, surface: TriSurface, settings: SmoothBoundary = SmoothBoundary()
) -> tuple[TetMesh, SmoothBoundaryReport]:
    """Smooth the boundary of a mesh and its interfaces, let the interior follow, and clean the elements again.

    Parameters
    ----------
    mesh : positive volumes
    surface : the surface that was meshed, with its inner ones
    settings : as `SmoothBoundary` describes them; published: 10 iterations that leave the surface

    Raises
    ------
    StageError : the given mesh has inverted elements
    """
    before = quality(mesh.points, mesh.cells)
    require_sound(mesh, before)
    given = sheets(surface)

    def attempt(start: TetMesh, held: IntArray) -> tuple[TetMesh, int]:
        walls = [sheet(start, number) for number in range(len(given))]
        nodes = np.concatenate([nodes for _, nodes in walls])
        free = ~np.isin(nodes, held)
        count = settings.iterations
        for _ in range(_RETRIES + 1):
            smoothed = [
                _smoothed(wall, count, tree_of(one) if settings.onto_surface else None)
                for (wall, _), one in zip(walls, given, strict=True)
            ]
            target = np.where(free[:, None], np.concatenate(smoothed), start.points[nodes])
            points = _followed(start, nodes, target)
            if (signed_volumes(points, start.cells) > 0).all():
                break
            count //= 2
            logger.warning("smoothing inverts elements; trying %d iterations", count)
        else:
            points, count = start.points, 0
        moved = replace(start, points=points)
        if settings.thresholds:
            mode: Boundary = "slide" if settings.onto_surface else "free"
            cleaning = Clean(thresholds=settings.thresholds, boundary=mode, improve_mean=False)
            moved, _ = clean(moved, surface, cleaning, held=held)
        return moved, count

    result, used, held = without_crossing(mesh, attempt)
    after = quality(result.points, result.cells)
    walls, placed = ([sheet(one, number)[0] for number in range(len(given))] for one in (mesh, result))
    off = [closest_points(tree_of(one), wall.points).distances for one, wall in zip(given, placed, strict=True)]
    began, ended = joined(walls), joined(placed)
    return result, SmoothBoundaryReport(
        onto_surface=settings.onto_surface,
        iterations=used,
        roughness_before=boundary_roughness(began.points, began.faces),
        roughness=boundary_roughness(ended.points, ended.faces),
        nodes_to_surface_mm=summary(np.concatenate(off)),
        displacement_mm=summary(np.linalg.norm(ended.points - began.points, axis=1)),
        q_mean_before=float(before.mean()),
        q_max_before=float(before.max()),
        q_mean=float(after.mean()),
        q_max=float(after.max()),
        vertices_held=len(held),
    )


def _smoothed(boundary: TriSurface, iterations: int, tree: SurfaceTree | None) -> FloatArray:
    """Positions of the boundary's vertices after smoothing, (b, 3) mm; each iteration ends on the surface, if given."""
    if not len(boundary.points):  # an interface that this part of a mesh does not contain
        return boundary.points
    if tree is None:
        return surface_preserving(boundary, iterations=iterations)
    for _ in range(iterations):
        smoothed = surface_preserving(boundary, iterations=1)
        boundary = replace(boundary, points=closest_points(tree, smoothed).points)
    return boundary.points


def _followed(mesh: TetMesh, nodes: IntArray, target: FloatArray) -> FloatArray:
    """Move boundary `nodes` to `target`, and nodes of the layers below by a share of their upper neighbours' mean."""
    shift = np.zeros_like(mesh.points)
    shift[nodes] = target - mesh.points[nodes]
    links = edges(mesh.cells)
    links = np.concatenate([links, links[:, ::-1]])
    reached = np.zeros(len(mesh.points), bool)
    reached[nodes] = True
    for _ in range(_SHELLS):
        upper, lower = links[reached[links[:, 0]] & ~reached[links[:, 1]]].T
        degree = np.bincount(lower, minlength=len(shift))
        below = np.flatnonzero(degree)
        for axis in range(3):
            total = np.bincount(lower, shift[upper, axis], minlength=len(shift))
            shift[below, axis] = _FOLLOWING * total[below] / degree[below]
        reached[below] = True
    points = mesh.points + shift
    points[nodes] = target
    return points
