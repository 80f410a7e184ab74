"""The icosphere: a sphere made by dividing the triangles of an icosahedron."""

from __future__ import annotations

import pymeshlab

from cortet.geometry.limits import SUBDIVISIONS, require_within
from cortet.meshes import TriSurface


def icosphere(subdivisions: int) -> TriSurface:
    """Unit sphere of 10 * 4**subdivisions + 2 vertices, counter-clockwise seen from outside."""
    require_within(subdivisions, SUBDIVISIONS, "the number of subdivisions of the icosahedron")
    meshes = pymeshlab.MeshSet()
    meshes.create_sphere(radius=1.0, subdiv=subdivisions)
    sphere = meshes.current_mesh()
    return TriSurface(sphere.vertex_matrix(), sphere.face_matrix())
