"""S5: carry fields to the final positions, number nodes as solvers need them, and check the mesh once more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cortet.config.stages import Transfer
from cortet.errors import StageError, counted
from cortet.geometry.topology import boundary_faces, boundary_nodes, enclosed_volume, neighbours, used_vertices
from cortet.measure.quality import signed_volumes
from cortet.meshes import MeshSets, TetMesh, TriSurface
from cortet.stages.transfer import transfer

VERSION: int = 1

#: relative difference allowed between the sum of volumes and the volume inside the boundary
VOLUME_TOLERANCE = 1e-9


@dataclass(frozen=True)
class SolverReadyReport:
    """What the solver gets; its surface nodes are 0 .. surface_nodes - 1."""

    nodes: int
    surface_nodes: int
    tetrahedra: int
    #: faces in exactly one tetrahedron; `topology.boundary_faces` gives them outward
    boundary_faces: int
    volume_mm3: float


def solver_ready(
    mesh: TetMesh, surface: TriSurface, settings: Transfer = Transfer()
) -> tuple[TetMesh, SolverReadyReport]:
    """Carry the fields of the surface to the final positions, and number the nodes as solvers need them.

    Parameters
    ----------
    mesh : positive volumes
    surface : the surface that was meshed, with its fields
    settings : as `Transfer` describes them
    """
    return surface_nodes_first(transfer(mesh, surface, settings)[0])


def surface_nodes_first(mesh: TetMesh) -> tuple[TetMesh, SolverReadyReport]:
    """Renumber nodes, surface nodes first, in their previous order otherwise; tetrahedra, fields and sets follow.

    Raises
    ------
    StageError
        a volume is not positive, a node unused, or the volumes do not add up to what the boundary encloses
    """
    volumes = signed_volumes(mesh.points, mesh.cells)
    if bad := int((~(volumes > 0)).sum()):
        raise StageError(
            f"{counted(bad, 'tetrahedron is', 'tetrahedra are')} flat or inverted",
            remedy="see the reports of the previous stages",
        )
    on_boundary = np.zeros(len(mesh.points), bool)
    on_boundary[boundary_nodes(mesh)] = True
    order = np.argsort(~on_boundary, kind="stable")
    new_index = np.empty(len(order), np.int32)
    new_index[order] = np.arange(len(order))
    ready = TetMesh(
        mesh.points[order],
        new_index[mesh.cells],
        {name: values[order] for name, values in mesh.point_data.items()},
        mesh.cell_data,
        MeshSets(
            {name: np.sort(new_index[nodes]) for name, nodes in mesh.sets.nodes.items()},
            {name: new_index[faces] for name, faces in mesh.sets.faces.items()},
            mesh.sets.cells,
        ),
    )
    neighbours.remember(ready, neighbours(mesh))  # whatever the numbers of the nodes
    if unused := len(order) - len(used_vertices(ready.cells, len(order))):
        raise StageError(f"{counted(unused, 'node belongs', 'nodes belong')} to no tetrahedron")
    enclosed = enclosed_volume(ready.points, boundary_faces(ready))
    if not np.isclose(volumes.sum(), enclosed, rtol=VOLUME_TOLERANCE, atol=0):
        raise StageError(f"volumes add up to {volumes.sum():.6f} mm3, but the boundary encloses {enclosed:.6f} mm3")
    return ready, SolverReadyReport(
        nodes=len(ready.points),
        surface_nodes=int(on_boundary.sum()),
        tetrahedra=len(ready.cells),
        boundary_faces=len(boundary_faces(ready)),
        volume_mm3=float(volumes.sum()),
    )
