"""S2: carry the per-vertex fields of a surface (thickness, curvature, growth rate, labels) to the nodes of its mesh."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cortet.config.stages import Transfer
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.interpolation import at_triangles, is_label
from cortet.geometry.nesting import sheets
from cortet.geometry.topology import numbers, sheet
from cortet.measure.harmonic import harmonic
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface

VERSION: int = 1

#: field of the distance between two surfaces
THICKNESS = "thickness"
#: a boundary node farther than this from the surface (mm) takes its values from a point where it does not belong
FAR_MM = 1.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TransferReport:
    """Which fields were carried, and how far."""

    #: name -> ``interpolated`` or ``label``
    fields: dict[str, str]
    max_distance_mm: float
    nodes_further_than_1mm: int
    #: how interior nodes got their values; labels always come from the nearest boundary node
    interior: str


def transfer(mesh: TetMesh, surface: TriSurface, settings: Transfer = Transfer()) -> tuple[TetMesh, TransferReport]:
    """Give every node the values of `surface.point_data`.

    A boundary node takes the barycentric mean at the closest point of the surface; for an integer field (labels), the
    value of the vertex with the largest weight. An interior node takes the values of its nearest boundary node or, for
    an interpolated field, the harmonic function of the boundary's values.
    Fields that the mesh already has stay, unless a field of the same name replaces them.

    The nodes of an interface take the values of its inner surface, just as those of the boundary take those of
    `surface`. Where one of the surfaces lacks a field, its nodes get interior values. If the vertices of `surface` and
    of its only inner surface correspond and neither has a field `thickness`, their distance becomes that field.

    Parameters
    ----------
    mesh : in the coordinates of `surface`
    surface : its `point_data` holds the fields, (n,) or (n, k)
    settings : as `Transfer` describes them

    Raises
    ------
    StageError
        harmonic interpolation did not converge
    """
    surface = with_thickness(surface)
    called = [("boundary nodes", "the surface"), *((f"nodes of the interface {name}", name) for name in surface.inner)]
    walls = [sheet(mesh, number)[1] for number in range(len(called))]
    known: dict[str, dict[int, NDArray[Any]]] = {}  # field -> number of a surface that has it -> values of its nodes
    distances, far = [], 0
    for number, (one, nodes, names) in enumerate(zip(sheets(surface), walls, called, strict=True)):
        found = closest_points(tree_of(one), mesh.points[nodes])
        distances.append(found.distances)
        far += _warned_of_far(found.distances, *names)
        for name, values in one.point_data.items():
            there = at_triangles(values, one.faces[found.faces], found.barycentric)
            known.setdefault(name, {})[number] = there

    @cache
    def sources(numbers: tuple[int, ...]) -> tuple[IntArray, IntArray]:
        """The nodes of some surfaces, and which of these each node of the mesh takes its values from."""
        nodes = np.concatenate([walls[number] for number in numbers])
        return nodes, _nearest(mesh.points, nodes)

    fields = {}
    for name, parts in known.items():
        nodes, source = sources(tuple(parts))
        carried = np.concatenate(list(parts.values()))[source]
        if settings.interior == "harmonic" and not is_label(carried) and len(nodes) < len(mesh.points):
            columns = carried.reshape(len(carried), -1).astype(np.float64)
            carried = harmonic(mesh, nodes, columns[nodes], columns).reshape(carried.shape)
        fields[name] = carried
    return replace(mesh, point_data={**mesh.point_data, **fields}), TransferReport(
        fields={name: "label" if is_label(values) else "interpolated" for name, values in fields.items()},
        max_distance_mm=float(np.concatenate(distances).max()),
        nodes_further_than_1mm=far,
        interior=settings.interior,
    )


def _warned_of_far(distances: FloatArray, nodes: str, surface: str) -> int:
    """Number of nodes that are too far from their surface; logs a warning about them."""
    far = int((distances > FAR_MM).sum())
    if far:
        logger.warning(
            "%d %s are more than %g mm from %s (up to %.2f mm): check that mesh and surface match",
            far,
            nodes,
            FAR_MM,
            surface,
            distances.max(),
        )
    return far


def _nearest(points: FloatArray, nodes: IntArray) -> IntArray:
    """Index in `nodes` (b,) of the node nearest to each of all `points` (n, 3): (n,) int32."""
    source = numbers(nodes, len(points))
    inner = np.flatnonzero(source < 0)
    source[inner] = cKDTree(points[nodes]).query(points[inner])[1]
    return source


def with_thickness(surface: TriSurface) -> TriSurface:
    """The surfaces with the distance of corresponding vertices, mm, as `thickness`, if they have none yet."""
    if len(surface.inner) != 1:
        return surface
    name, inner = next(iter(surface.inner.items()))
    known = THICKNESS in surface.point_data or THICKNESS in inner.point_data
    if known or not np.array_equal(surface.faces, inner.faces):
        return surface
    thickness = np.linalg.norm(surface.points - inner.points, axis=1)
    within = replace(inner, point_data={**inner.point_data, THICKNESS: thickness})
    return replace(surface, point_data={**surface.point_data, THICKNESS: thickness}, inner={name: within})
