"""Where a triangulated surface has flat faces or is not a manifold; `topology.surface_topology` only counts defects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.mending import border_vertices
from cortet.geometry.topology import face_areas, fans
from cortet.meshes import FloatArray, IntArray


def defective_vertices(faces: IntArray) -> NDArray[np.int64]:
    """Vertices of edges that are not in exactly two faces, and vertices with more than one fan of faces; ascending."""
    several = np.bincount(fans(faces)[1]) > 1
    return np.union1d(border_vertices(faces), np.flatnonzero(several))


def flat_faces(points: FloatArray, faces: IntArray) -> IntArray:
    """Faces whose area is zero within the rounding of coordinates to float32; (k,) int32, ascending."""
    points = points.astype(np.float32).astype(np.float64)
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = face_areas(points, faces) <= np.finfo(np.float32).eps * longest**2
    return np.flatnonzero(flat).astype(np.int32)
