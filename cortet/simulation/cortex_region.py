"""The growing cortex as a region of the mesh, where it has one: between its boundary and the outermost interface."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.formats.surface_sets import INTERFACE
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.topology import boundary, cut_components, interfaces
from cortet.mesh import REGION, FloatArray, IntArray, MeshSets, TetMesh


class CortexRegion(NamedTuple):
    """The cortex of a body with n nodes and m tetrahedra; lengths in the unit of its points."""

    #: (m,), which tetrahedra are cortex
    cells: NDArray[np.bool_]
    #: (n,), distance of the two surfaces at each node: to the nearest point of the one and of the other
    thickness: FloatArray
    #: (n, 3), unit vectors from the interface to the outer surface
    direction: FloatArray


def with_interface(mesh: TetMesh) -> TetMesh:
    """The mesh with its interfaces as a set of faces, where regions are numbers of its tetrahedra."""
    if REGION not in mesh.cell_data or mesh.sets.cells or interface_faces(mesh) is not None:
        return mesh
    found = interfaces(mesh)
    if not len(found.faces):
        return mesh
    faces = {**mesh.sets.faces, f"region{INTERFACE}": found.faces}
    return replace(mesh, sets=MeshSets(mesh.sets.nodes, faces, mesh.sets.cells))


def interface_faces(mesh: TetMesh) -> IntArray | None:
    """All faces between regions: (k, 3); None where no set names any."""
    named = [faces for name, faces in mesh.sets.faces.items() if name.endswith(INTERFACE)]
    return np.concatenate(named) if named else None


def cortex_region(mesh: TetMesh, points: FloatArray) -> CortexRegion | None:
    """The region next to the boundary of a mesh with interfaces; None for a mesh without.

    Parameters
    ----------
    points : (n, 3), nodes of the mesh in the unit that lengths are wanted in
    """
    faces = interface_faces(mesh)
    if faces is None:
        return None
    part = cut_components(mesh, faces)
    outer = boundary(mesh)
    cortex = np.isin(part, np.unique(part[outer.cells]))
    facing = faces[_touches(mesh.cells[cortex], faces)]
    out, inside = (closest_points(surface_tree(points, some), points) for some in (outer.faces, facing))
    across = out.points - inside.points
    thickness = np.linalg.norm(across, axis=1)
    direction = across / np.maximum(thickness, np.finfo(float).tiny)[:, None]
    return CortexRegion(cortex, out.distances + inside.distances, direction)


def _touches(cells: IntArray, faces: IntArray) -> NDArray[np.bool_]:
    """Whether all nodes of each face are nodes of some of these tetrahedra."""
    return np.asarray(np.isin(faces, cells).all(axis=1))
