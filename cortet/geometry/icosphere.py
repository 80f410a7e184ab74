"""The sphere of an icosahedron whose triangles were divided so often."""

from __future__ import annotations

import pymeshlab

from cortet.mesh import TriSurface


def icosphere(subdivisions: int) -> TriSurface:
    """Unit sphere of 10 * 4**subdivisions + 2 vertices, counter-clockwise seen from outside."""
    meshes = pymeshlab.MeshSet()
    meshes.create_sphere(radius=1.0, subdiv=subdivisions)
    sphere = meshes.current_mesh()
    return TriSurface(sphere.vertex_matrix(), sphere.face_matrix())
