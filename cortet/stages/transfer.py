"""S2: carry the per-vertex fields of a surface (thickness, curvature, growth rate, labels) to the nodes of its mesh."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cortet.mesh import FloatArray, IntArray, TetMesh, TriSurface
from cortet.optimise.closest_point import closest_points, surface_tree
from cortet.topology import boundary_nodes

VERSION: int = 1

#: a boundary node further than this from the surface (mm) takes its values from a place it does not belong to
FAR_MM = 1.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TransferReport:
    """Which fields were carried, and how far."""

    #: name -> ``interpolated`` or ``label``
    fields: dict[str, str]
    mean_distance_mm: float
    max_distance_mm: float
    nodes_further_than_1mm: int


def transfer(mesh: TetMesh, surface: TriSurface) -> tuple[TetMesh, TransferReport]:
    """Give every node the values of `surface.point_data`.

    A boundary node takes the barycentric mean at the closest point of the surface; of an integer field (labels) it
    takes the value of the vertex with the largest weight. An interior node takes those of its nearest boundary node.
    Fields the mesh has already stay, or are replaced by those of the same name.

    Parameters
    ----------
    mesh : lying in the coordinates of `surface`
    surface : its `point_data` holds the fields, (n,) or (n, k)
    """
    nodes = boundary_nodes(mesh)
    interior = np.setdiff1d(np.arange(len(mesh.points)), nodes)
    found = closest_points(surface_tree(surface.points, surface.faces), mesh.points[nodes])
    source = np.empty(len(mesh.points), np.int64)  # for every node, which of `nodes` it takes its values from
    source[nodes] = np.arange(len(nodes))
    source[interior] = cKDTree(mesh.points[nodes]).query(mesh.points[interior])[1]

    corners = surface.faces[found.faces]
    fields = {name: _at(values, corners, found.barycentric)[source] for name, values in surface.point_data.items()}
    far = int((found.distances > FAR_MM).sum())
    if far:
        logger.warning(
            "%d boundary nodes are more than %g mm from the surface, the furthest %.2f mm: do they belong together?",
            far,
            FAR_MM,
            found.distances.max(),
        )
    return replace(mesh, point_data={**mesh.point_data, **fields}), TransferReport(
        fields={name: "label" if _is_label(values) else "interpolated" for name, values in surface.point_data.items()},
        mean_distance_mm=float(found.distances.mean()),
        max_distance_mm=float(found.distances.max()),
        nodes_further_than_1mm=far,
    )


def _is_label(values: NDArray[Any]) -> bool:
    return bool(np.issubdtype(values.dtype, np.integer))


def _at(values: NDArray[Any], corners: IntArray, weights: FloatArray) -> NDArray[Any]:
    """Values of one field at points given by the (k, 3) corners and weights of the triangles they lie in."""
    if _is_label(values):
        values_there: NDArray[Any] = values[corners[np.arange(len(corners)), weights.argmax(axis=1)]]
    else:
        values_there = np.einsum("kc,kc...->k...", weights, values[corners])
    return values_there
