"""S3: move nodes to better positions with Gmsh's Relocate3D.

With `boundary="free"`, as published, Gmsh gets only tetrahedra and also moves boundary nodes off the surface, by 0.1 mm
and more. With `boundary="fixed"`, the boundary triangles lie on a discrete surface, and their nodes stay exactly where
they are. Reference: https://gmsh.info/doc/texinfo/gmsh.html (gmsh/model/mesh/optimize).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from cortet.config.stages import Relocate
from cortet.errors import StageError
from cortet.geometry.topology import boundary_faces, boundary_nodes
from cortet.measure.quality import quality
from cortet.meshes import FloatArray, IntArray, TetMesh
from cortet.optimise.backing_off import back_off

VERSION: int = 1

_TRIANGLE, _TETRAHEDRON = 2, 4  # Gmsh's element types
_SURFACE, _VOLUME = (2, 1), (3, 1)  # dimension and tag of the discrete entities

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RelocateReport:
    """What moved, and the result."""

    passes: int
    boundary: str
    max_displacement_mm: float
    mean_q_before: float
    mean_q_after: float
    q_max_before: float
    q_max_after: float


def relocate(mesh: TetMesh, settings: Relocate = Relocate()) -> tuple[TetMesh, RelocateReport]:
    """Relocate nodes; connectivity, numbering and fields stay as they are.

    Parameters
    ----------
    mesh : any tetrahedral mesh
    settings : as `Relocate` describes them

    Raises
    ------
    StageError
        Gmsh failed, or returned a different mesh
    """
    fixed = np.array([], np.int32) if settings.boundary == "free" else boundary_nodes(mesh)
    points = _relocated(mesh, settings.passes, fixed)
    points, share = back_off(mesh.points, points, mesh.cells)
    if backed_off := int((share < 1).sum()):
        logger.warning("%d nodes were moved only partly, to avoid inverted tetrahedra", backed_off)

    displacement = np.linalg.norm(points - mesh.points, axis=1)
    on_boundary = displacement[boundary_nodes(mesh)]
    if settings.boundary == "fixed" and on_boundary.max() > 0:
        raise StageError(f"Gmsh moved fixed boundary nodes, by up to {on_boundary.max():g} mm")
    before, after = quality(mesh.points, mesh.cells), quality(points, mesh.cells)
    return replace(mesh, points=points), RelocateReport(
        passes=settings.passes,
        boundary=settings.boundary,
        max_displacement_mm=float(displacement.max()),
        mean_q_before=float(before.mean()),
        mean_q_after=float(after.mean()),
        q_max_before=float(before.max()),
        q_max_after=float(after.max()),
    )


@contextmanager
def _session() -> Iterator[None]:
    """An empty, silent Gmsh model on one thread, which reads no arguments, configuration or signals."""
    import gmsh

    gmsh.initialize(argv=[], readConfigFiles=False, run=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        yield
    finally:
        gmsh.finalize()


def _relocated(mesh: TetMesh, passes: int, fixed: IntArray) -> FloatArray:
    """New positions of the nodes, in the order of the mesh; those of `fixed` lie on a surface that Gmsh respects."""
    import gmsh

    free = np.setdiff1d(np.arange(len(mesh.points)), fixed)
    faces = boundary_faces(mesh) if len(fixed) else np.empty((0, 3), np.int32)
    with _session():
        try:
            if len(fixed):
                gmsh.model.addDiscreteEntity(*_SURFACE)
                gmsh.model.mesh.addNodes(*_SURFACE, fixed + 1, mesh.points[fixed].ravel())
                gmsh.model.mesh.addElementsByType(_SURFACE[1], _TRIANGLE, np.arange(len(faces)) + 1, faces.ravel() + 1)
            gmsh.model.addDiscreteEntity(*_VOLUME, [_SURFACE[1]] if len(fixed) else [])
            gmsh.model.mesh.addNodes(*_VOLUME, free + 1, mesh.points[free].ravel())
            tags = np.arange(len(faces), len(faces) + len(mesh.cells)) + 1
            gmsh.model.mesh.addElementsByType(_VOLUME[1], _TETRAHEDRON, tags, mesh.cells.ravel() + 1)
            for done in range(passes):  # as published; one call with niter=passes is another method
                gmsh.model.mesh.optimize("Relocate3D")
                logger.info("Gmsh Relocate3D, pass %d of %d", done + 1, passes)
            node_tags, coordinates, _ = gmsh.model.mesh.getNodes()
            element_tags, element_nodes = gmsh.model.mesh.getElementsByType(_TETRAHEDRON)
        except Exception as error:  # the Gmsh API raises plain exceptions
            raise StageError(f"Gmsh failed: {error}") from error

    # Gmsh renumbers nodes while it optimises. Element tags and the order of corners stay, so the corners of the
    # elements show which node became which; all elements must agree.
    if not np.array_equal(np.sort(element_tags), tags):
        raise StageError(f"Gmsh returned {len(element_tags)} tetrahedra that differ from the {len(tags)} it was given")
    corners = element_nodes.reshape(-1, 4)[np.argsort(element_tags)].astype(np.int64)
    tag_of_node = np.zeros(len(mesh.points), np.int64)
    tag_of_node[mesh.cells] = corners
    if not np.array_equal(tag_of_node[mesh.cells], corners):
        raise StageError("Gmsh changed the connectivity of the mesh")
    by_tag = np.argsort(node_tags)
    rows = by_tag[np.searchsorted(node_tags, tag_of_node, sorter=by_tag)]
    return np.ascontiguousarray(coordinates.reshape(-1, 3)[rows])
