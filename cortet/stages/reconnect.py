"""S4+: local reconnection, for elements that no movement of vertices can mend.

After cleaning, the worst tetrahedra lie at interior edges of three tetrahedra (where q >= 0.300, wherever the vertices
go), at boundary edges of one, and between the two sides of a blade, with all their vertices on the boundary. Swaps
remove the first kind and some of the second; new vertices inside mend the others, and vertices of the boundary that are
in the way are removed. The vertices around them move again after each round. Connectivity changes, which never happens
in the published chain; hence a separate stage.
"""

from __future__ import annotations

from dataclasses import dataclass

from cortet.config.stages import Reconnect
from cortet.measure.quality import quality
from cortet.meshes import TetMesh, TriSurface
from cortet.optimise.reconnection import reconnected
from cortet.optimise.soundness import require_sound

VERSION: int = 20


@dataclass(frozen=True)
class ReconnectReport:
    """What was done, and the result."""

    threshold: float
    q_mean_before: float
    q_max_before: float
    q_mean: float
    q_max: float
    tets: int
    #: swaps considered, and those made: an edge and its tetrahedra replaced; a face replaced by an edge (2-3); an edge
    #: of the boundary or of an interface flipped; a boundary tetrahedron peeled off
    attempts: int
    edge_removals: int
    face_removals: int
    boundary_flips: int
    peeled: int
    #: vertices inserted, before and after the rest, less those of the boundary that were removed
    inserted: int
    #: vertices held in place because moving them, or flipping their boundary edges, made the boundary cross itself
    vertices_held: int


def reconnect(
    mesh: TetMesh,
    surface: TriSurface,
    settings: Reconnect = Reconnect(),
    *,
    cell_size: float | None = None,
) -> tuple[TetMesh, ReconnectReport]:
    """Swap edges and faces around tetrahedra with q above the threshold, and move the vertices there.

    Every swap improves the worst quality of the tetrahedra it replaces. All volumes stay positive, vertices are added
    or lost only with `insert`, and the boundary keeps its topology. Values per tetrahedron follow; integer values are
    labels of regions, which no swap joins. An interface of regions stays as it is; but one that lies on an inner
    surface is treated like the boundary: its vertices slide, its edges may be flipped.

    Parameters
    ----------
    mesh : positive volumes
    surface : the surface that boundary vertices slide on and that new boundary edges must be close to; the vertices of
        interfaces slide on its inner surfaces
    settings : as `Reconnect` describes them; inserted vertices carry the values of a vertex near them
    cell_size : mm, which determines how far from `surface` the boundary may slide; None if it is not known
    """
    before = quality(mesh.points, mesh.cells)
    require_sound(mesh, before)
    result, inserted, swaps, held = reconnected(
        mesh,
        surface,
        threshold=settings.threshold,
        boundary=settings.boundary,
        insert=settings.insert,
        cell_size=cell_size,
    )
    after = quality(result.points, result.cells)
    return result, ReconnectReport(
        threshold=settings.threshold,
        q_mean_before=float(before.mean()),
        q_max_before=float(before.max()),
        q_mean=float(after.mean()),
        q_max=float(after.max()),
        tets=len(result.cells),
        attempts=swaps.attempts,
        edge_removals=swaps.edge_removals,
        face_removals=swaps.face_removals,
        boundary_flips=swaps.boundary_flips,
        peeled=swaps.peeled,
        inserted=inserted,
        vertices_held=len(held),
    )
