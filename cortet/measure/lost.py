"""Where a mesh leaves its surface behind: sulci that it fills, blades and tips that it cuts off.

Nodes on the surface and a boundary of the right topology do not exclude either. So the distance is measured from the
surface, at its vertices and the centres of its faces, and what is too far from the boundary is gathered into places.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.topology import edges, face_normals
from cortet.mesh import FloatArray, TriSurface


@dataclass(frozen=True)
class LostPlace:
    """A part of the surface that the boundary of the mesh does not follow."""

    #: its farthest point
    place_mm: tuple[float, float, float]
    #: from there to the boundary
    distance_mm: float
    #: `filled`: it lies inside the mesh, as the bottom of a sulcus; `cut off`: outside, as the crest of a blade
    kind: Literal["filled", "cut off"]
    #: vertices of the surface that belong to it
    vertices: int


def surface_samples(surface: TriSurface) -> FloatArray:
    """The vertices of a surface, then the centres of its faces: (n + m, 3) mm."""
    return np.concatenate([surface.points, surface.points[surface.faces].mean(axis=1)])


def distances_to(boundary: TriSurface, surface: TriSurface) -> FloatArray:
    """From `surface_samples` of a surface to the boundary of a mesh: (n + m,) mm."""
    return closest_points(tree_of(boundary), surface_samples(surface)).distances


def lost_places(boundary: TriSurface, surface: TriSurface, *, limit: float) -> list[LostPlace]:
    """Connected parts of a surface that are farther than `limit` mm from the boundary of a mesh, farthest first."""
    samples = surface_samples(surface)
    found = closest_points(tree_of(boundary), samples)
    beyond = found.distances > limit
    if not beyond.any():
        return []
    label = _parts(surface, beyond)
    outside = (
        np.einsum("kc,kc->k", samples - found.points, face_normals(boundary.points, boundary.faces)[found.faces]) > 0
    )
    places = []
    for part in np.unique(label[beyond]):
        members = np.flatnonzero(beyond & (label == part))
        farthest = members[np.argmax(found.distances[members])]
        x, y, z = samples[farthest].tolist()
        places.append(
            LostPlace(
                place_mm=(x, y, z),
                distance_mm=float(found.distances[farthest]),
                kind="cut off" if outside[farthest] else "filled",
                vertices=int((members < len(surface.points)).sum()),
            )
        )
    return sorted(places, key=lambda place: -place.distance_mm)


def _parts(surface: TriSurface, beyond: NDArray[np.bool_]) -> NDArray[np.int32]:
    """A number for each sample, the same for those beyond the limit that hang together by edges or faces: (n + m,)."""
    count = len(surface.points)
    corners = surface.faces.ravel()
    centres = np.repeat(np.arange(count, len(beyond)), 3)
    start, end = np.concatenate([edges(surface.faces), np.column_stack([corners, centres])]).T
    both = beyond[start] & beyond[end]
    graph = coo_matrix((np.ones(both.sum(), np.int8), (start[both], end[both])), shape=(len(beyond), len(beyond)))
    label: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return label
