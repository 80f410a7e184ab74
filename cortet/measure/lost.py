"""Where a mesh does not follow its surface: sulci that it fills, blades and tips that it cuts off.

A mesh can do both while every boundary node lies on the surface and the topology is right. So the distance is measured
from the surface, at its vertices and the centres of its faces. Connected samples that are too far from the boundary
form one lost part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.topology import edges, face_normals, linked
from cortet.meshes import FloatArray, IntArray, TriSurface


@dataclass(frozen=True)
class LostPlace:
    """A part of the surface that the boundary of the mesh does not follow."""

    #: the point of this part that is farthest from the boundary
    place_mm: tuple[float, float, float]
    #: distance from that point to the boundary
    distance_mm: float
    #: `filled`: that point lies inside the mesh, like the bottom of a sulcus; `cut off`: outside, like a blade's crest
    kind: Literal["filled", "cut off"]
    #: number of vertices of the surface in this part
    vertices: int


def surface_samples(surface: TriSurface) -> FloatArray:
    """The vertices of a surface, then the centres of its faces: (n + m, 3) mm."""
    return np.concatenate([surface.points, surface.points[surface.faces].mean(axis=1)])


def distances_to(boundary: TriSurface, surface: TriSurface) -> FloatArray:
    """Distances from `surface_samples` of a surface to the boundary of a mesh: (n + m,) mm."""
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


def _parts(surface: TriSurface, beyond: NDArray[np.bool_]) -> IntArray:
    """Component of each sample, (n + m,): edges and faces connect samples beyond the limit."""
    count = len(surface.points)
    corners = surface.faces.ravel()
    centres = np.repeat(np.arange(count, len(beyond)), 3)
    start, end = np.concatenate([edges(surface.faces), np.column_stack([corners, centres])]).T
    both = beyond[start] & beyond[end]
    return linked(start[both], end[both], len(beyond))
