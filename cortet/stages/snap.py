"""S6: put boundary nodes back on the surface that was meshed, at its nearest point (not vertex).

If cleaning slid boundary nodes along the surface, there is nothing to do, and the report says so. If it let them float,
snapping may spoil elements: their nodes are held back, the mesh is cleaned while they slide, and the rest of the way is
tried again. Nodes that would make the boundary cross itself stay where they are.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from cortet.config.stages import Clean, Snap
from cortet.errors import counted
from cortet.geometry.closest_point import SurfaceTree, closest_points, tree_of
from cortet.geometry.topology import boundary_nodes
from cortet.measure.quality import quality
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface
from cortet.optimise.backing_off import back_off
from cortet.optimise.crossing import without_crossing
from cortet.stages.clean import clean

VERSION: int = 6

#: boundary nodes nearer than this (mm) lie on the surface; CGAL leaves them up to 2e-6 mm off
ON_SURFACE_MM = 1e-4
#: how often the mesh is cleaned so that boundary nodes can move on, and how
REPAIR_ROUNDS, REPAIR = 3, Clean(thresholds=[0.5, 0.3], boundary="slide")

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SnapReport:
    """How far the boundary was off the surface, how far it is now, and what that took."""

    #: in plain words
    outcome: str
    max_distance_before_mm: float
    max_distance_after_mm: float
    repair_rounds: int
    #: boundary nodes that could not be brought all the way to the surface
    nodes_left_off: int
    q_max_before: float
    q_max_after: float


def snap(mesh: TetMesh, surface: TriSurface, settings: Snap = Snap()) -> tuple[TetMesh, SnapReport]:
    """Move boundary nodes to the nearest point of `surface`, as far as no element inverts or rises to the limit.

    Parameters
    ----------
    mesh : positive volumes; its boundary lies near `surface`
    surface : the surface that was meshed
    settings : as `Snap` describes them; no element with q below `q_max` is raised to it, and no other is raised at all

    Raises
    ------
    StageError
        the given mesh has inverted elements
    """
    tree = tree_of(surface)
    nodes = boundary_nodes(mesh)
    found = closest_points(tree, mesh.points[nodes])

    def attempt(start: TetMesh, held: IntArray) -> tuple[TetMesh, int]:
        return _brought(start, surface, tree, np.setdiff1d(boundary_nodes(start), held), settings.q_max, held)

    if found.distances.max() <= ON_SURFACE_MM:
        snapped, rounds, outcome = mesh, 0, "nothing to do: the boundary already lies on the surface"
    else:
        snapped, rounds, _ = without_crossing(mesh, attempt)
        outcome = "the boundary lies on the surface" + (", after repair of elements" if rounds else "")
    distances = closest_points(tree, snapped.points[nodes]).distances
    left_off = int((distances > ON_SURFACE_MM).sum())
    if left_off:
        outcome = (
            f"{counted(left_off, 'boundary node stays', 'boundary nodes stay')} off the surface, by up to "
            f"{distances.max():.3g} mm, to keep elements valid"
        )
        logger.warning(outcome)
    return snapped, SnapReport(
        outcome=outcome,
        max_distance_before_mm=float(found.distances.max()),
        max_distance_after_mm=float(distances.max()),
        repair_rounds=rounds,
        nodes_left_off=left_off,
        q_max_before=float(quality(mesh.points, mesh.cells).max()),
        q_max_after=float(quality(snapped.points, snapped.cells).max()),
    )


def _brought(
    mesh: TetMesh, surface: TriSurface, tree: SurfaceTree, nodes: IntArray, q_max: float, held: IntArray
) -> tuple[TetMesh, int]:
    """Bring `nodes` to the surface as far as elements allow; cleaning in between does not move the vertices `held`.

    Returns also how often the mesh was cleaned.
    """
    rounds = 0
    while True:
        positions = closest_points(tree, mesh.points[nodes]).points
        points, _ = back_off(mesh.points, _placed(mesh.points, nodes, positions), mesh.cells, q_max=q_max)
        mesh = replace(mesh, points=points)
        late = int((np.linalg.norm(points[nodes] - positions, axis=1) > ON_SURFACE_MM).sum())
        if not late or rounds == REPAIR_ROUNDS:
            return mesh, rounds
        rounds += 1
        logger.info("%d boundary nodes held back: cleaning around them, round %d", late, rounds)
        mesh, _ = clean(mesh, surface, REPAIR, held=held)


def _placed(points: FloatArray, nodes: IntArray, positions: FloatArray) -> FloatArray:
    """Copy of `points` with `nodes` at `positions`."""
    moved = points.copy()
    moved[nodes] = positions
    return moved
