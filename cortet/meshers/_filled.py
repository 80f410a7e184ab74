"""What every mesher does with its tetrahedra: order them, and compare their boundary with the surface."""

from __future__ import annotations

import logging

from cortet.geometry.ordering import ordered_along_curve
from cortet.geometry.topology import boundary_faces, compact, components, surface_topology
from cortet.measure.quality import oriented, signed_volumes
from cortet.meshers.mesher import Attempt
from cortet.meshes import REGION, FloatArray, IntArray, TetMesh, TriSurface

logger = logging.getLogger(__name__)


def well_ordered(points: FloatArray, cells: IntArray, region: IntArray | None = None) -> tuple[TetMesh, int]:
    """Tetrahedra of a mesher with positive volumes, numbered along a curve; and how many flat ones were dropped.

    Parameters
    ----------
    points, cells : (n, 3) mm; (m, 4), of either orientation
    region : (m,) of the tetrahedra, where there are several
    """
    if region is not None:
        region = region[signed_volumes(points, cells) != 0]
    cells, flat = oriented(points, cells)
    points, cells, _ = compact(points, cells)
    points, cells, order = ordered_along_curve(points, cells)
    return TetMesh(points, cells, cell_data={} if region is None else {REGION: region[order]}), flat


def checked(
    mesh: TetMesh,
    surface: TriSurface,
    *,
    facet_distance: float | None = None,
    edge_length: float | None = None,
    passes: tuple[str, ...] = (),
    flat: int,
) -> Attempt:
    """Compare the topology of a mesh with that of its surface; lengths in mm."""
    boundary = surface_topology(boundary_faces(mesh))
    problems = boundary.problems(int(surface_topology(surface.faces).genus))
    if (bodies := components(mesh.cells)) != 1:
        problems.append(f"{bodies} bodies instead of one")
    return Attempt(
        facet_distance_mm=facet_distance,
        edge_length_mm=edge_length,
        passes=passes,
        nodes=len(mesh.points),
        tetrahedra=len(mesh.cells),
        flat_tetrahedra_dropped=flat,
        boundary=boundary,
        problems=tuple(problems),
    )


def log_attempt(what: str, attempt: Attempt, seconds: float) -> None:
    """Log the result of an attempt."""
    found = "; ".join(attempt.problems) or "topology of the surface"
    logger.info("%s: %d nodes, %d tetrahedra, %s, %.1f s", what, attempt.nodes, attempt.tetrahedra, found, seconds)
