"""Carry the surface that was meshed along as the mesh folds, so that folds on different meshes can be compared."""

from __future__ import annotations

from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.topology import boundary_faces
from cortet.meshes import FloatArray, TetMesh


def carried(points: FloatArray, mesh: TetMesh, moved: FloatArray) -> FloatArray:
    """Positions of the vertices of a surface after the nodes of a mesh have moved: (k, 3) mm.

    A vertex moves with the point of the boundary that was nearest to it, and keeps its offset from that point, which is
    smaller than a cell.

    Parameters
    ----------
    points : (k, 3) vertices of the surface, mm
    mesh : the mesh before it moved
    moved : (n, 3) mm, its nodes after that
    """
    faces = boundary_faces(mesh)
    found = closest_points(surface_tree(mesh.points, faces), points)
    return points - found.points + (found.barycentric[:, :, None] * moved[faces[found.faces]]).sum(axis=1)
