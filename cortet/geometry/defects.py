"""Where a triangulated surface has flat faces or is not a manifold; `topology.surface_topology` only counts defects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.topology import TRI_EDGES, face_areas, fans, packed
from cortet.meshes import FloatArray, IntArray


def defective_vertices(faces: IntArray) -> NDArray[np.int64]:
    """Vertices of edges that are not in exactly two faces, and vertices with more than one fan of faces; ascending."""
    return np.union1d(_of_bad_edges(faces), _pinched(faces))


def flat_faces(points: FloatArray, faces: IntArray) -> IntArray:
    """Faces whose area is zero within the rounding of coordinates to float32; (k,) int32, ascending."""
    points = points.astype(np.float32).astype(np.float64)
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = face_areas(points, faces) <= np.finfo(np.float32).eps * longest**2
    return np.flatnonzero(flat).astype(np.int32)


def _of_bad_edges(faces: IntArray) -> NDArray[np.int64]:
    sides = faces[:, TRI_EDGES].reshape(-1, 2)
    edge, count = np.unique(packed(sides), return_inverse=True, return_counts=True)[1:]
    return np.unique(sides[count[edge] != 2])


def _pinched(faces: IntArray) -> NDArray[np.int64]:
    """Vertices whose faces form more than one fan; ascending."""
    fan = fans(faces)
    vertex = np.zeros(fan.max(initial=-1) + 1, np.int64)
    vertex[fan] = faces.ravel()
    return np.flatnonzero(np.bincount(vertex) > 1)
