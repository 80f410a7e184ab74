"""The worst elements of a mesh: where they are, why they are bad, and what would help.

Connectivity alone can keep an element bad. The dihedral angles of the n tetrahedra around an edge add up to 360 degrees
inside the mesh, and to the opening angle of the boundary at a boundary edge. So at least one angle is no smaller, and
at least one no larger, than the sum over n. An element with such an angle has at least the q of
`quality.opening_bound`, wherever its vertices go.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array

from cortet.geometry.topology import TET_EDGES, boundary_faces, boundary_nodes, edges, vertex_normals
from cortet.measure.quality import dihedral_angles, opening_bound, quality
from cortet.meshes import FloatArray, TetMesh

#: an edge explains an element if its bound is at least this share of the element's q
_EXPLAINS = 0.5
_USE_RECONNECT = "switch `reconnect` on"
_USE_CLEAN = "switch `clean` on"
_CLEAN_MORE = "add a lower value to `clean.thresholds`"


class Fans(NamedTuple):
    """The tetrahedra around each of e edges."""

    #: (m, 6) int32, index of each edge of each tetrahedron, in the order of `topology.TET_EDGES`
    of_cell: NDArray[np.int32]
    #: (e,) int32, number of tetrahedra around it
    valence: NDArray[np.int32]
    #: (e,) bool, whether the edge lies on the boundary
    on_boundary: NDArray[np.bool_]
    #: (e,) float64 degrees: 360 inside the mesh, the interior angle of the boundary at a boundary edge
    opening: FloatArray


@dataclass(frozen=True)
class ValenceBound:
    """What connectivity allows: no position of the interior vertices brings the worst q below `q`."""

    #: the larger of the two below
    q: float
    interior_q: float
    #: bound by boundary edges, at the present opening angles of the boundary
    boundary_q: float
    #: interior edges in three tetrahedra (q >= 0.300) or fewer
    interior_edges_of_valence_3: int
    #: boundary edges in a single tetrahedron
    boundary_edges_of_valence_1: int


@dataclass(frozen=True)
class WorstElement:
    """One bad element."""

    #: index of the tetrahedron, 0-based
    element: int
    q: float
    centre_mm: tuple[float, float, float]
    #: how many of its four nodes lie on the boundary
    boundary_nodes: int
    #: least q that the edges of the element allow
    bound: float
    reason: str
    #: empty for an element that is good enough
    remedy: str


def fans(mesh: TetMesh) -> Fans:
    """Valence and opening angle of every edge."""
    ends = mesh.cells[:, TET_EDGES].reshape(-1, 2)
    low, high = np.minimum(*ends.T), np.maximum(*ends.T)
    every = coo_array((np.ones(len(ends), np.int32), (low, high)), shape=2 * (len(mesh.points),))
    numbered = every.tocsr()  # which adds up equal entries
    valence = numbered.data
    numbered.data = np.arange(len(valence), dtype=np.int32)
    of_cell = numbered[low, high].reshape(-1, 6)
    on_boundary = np.zeros(len(valence), bool)
    on_boundary[numbered[*edges(boundary_faces(mesh)).T]] = True
    touching = on_boundary[of_cell].any(axis=1)
    angles = dihedral_angles(mesh.points, mesh.cells[touching])
    summed = np.bincount(of_cell[touching].ravel(), angles.ravel(), minlength=len(valence))
    opening = np.where(on_boundary, summed, 360.0)
    return Fans(of_cell, valence, on_boundary, opening)


def valence_bound(around: Fans) -> ValenceBound:
    """Lower bound of the worst q by connectivity."""
    share = around.opening / around.valence
    inside, outside = (
        max(
            (opening_bound(end) for part in [share[chosen]] if len(part) for end in (part.min(), part.max())),
            default=0.0,
        )
        for chosen in (~around.on_boundary, around.on_boundary)
    )
    return ValenceBound(
        q=max(inside, outside),
        interior_q=inside,
        boundary_q=outside,
        interior_edges_of_valence_3=int((around.valence[~around.on_boundary] <= 3).sum()),
        boundary_edges_of_valence_1=int((around.valence[around.on_boundary] == 1).sum()),
    )


def worst_elements(
    mesh: TetMesh,
    around: Fans,
    *,
    count: int = 10,
    limit: float = 0.0,
    stages: Collection[str] = (),
    smaller: str = "use a smaller cell size",
) -> tuple[WorstElement, ...]:
    """The `count` elements with the largest q, worst first, each with the reason, and from `limit` on with a remedy.

    `stages` names the stages that the mesh has been through; no remedy recommends them. `smaller` is the advice to use
    smaller cells.
    """
    finer = f"{smaller}, or smooth the surface more"
    q = quality(mesh.points, mesh.cells)
    normals = vertex_normals(mesh.points, boundary_faces(mesh))
    on_boundary = np.zeros(len(mesh.points), bool)
    on_boundary[boundary_nodes(mesh)] = True
    hold = finer if "reconnect" in stages else _USE_RECONNECT
    free = _CLEAN_MORE if "clean" in stages else _USE_CLEAN
    found = []
    for element in np.argsort(-q, kind="stable")[:count].tolist():
        reason, bound, held = _reason(mesh, around, element, float(q[element]), normals, on_boundary)
        x, y, z = mesh.points[mesh.cells[element]].mean(axis=0).tolist()
        found.append(
            WorstElement(
                element=element,
                q=float(q[element]),
                centre_mm=(x, y, z),
                boundary_nodes=int(on_boundary[mesh.cells[element]].sum()),
                bound=bound,
                reason=reason,
                remedy={"fan": hold, "banks": finer, "nothing": free}[held] if q[element] >= limit else "",
            )
        )
    return tuple(found)


def _reason(
    mesh: TetMesh, around: Fans, element: int, q: float, normals: FloatArray, on_boundary: NDArray[np.bool_]
) -> tuple[str, float, Literal["fan", "banks", "nothing"]]:
    """Why an element is bad, the least q that its edges allow, and what keeps it bad."""
    nodes, fan = mesh.cells[element], around.of_cell[element]
    bounds = [opening_bound(around.opening[edge] / around.valence[edge]) for edge in fan]
    edge, bound = fan[int(np.argmax(bounds))], max(bounds)
    if bound >= _EXPLAINS * q:
        place = "an interior edge"
        if around.on_boundary[edge]:
            place = f"a boundary edge of opening angle {around.opening[edge]:.0f} degrees"
        count = "one tetrahedron" if around.valence[edge] == 1 else f"{around.valence[edge]} tetrahedra"
        return f"{place} in {count} keeps q at {bound:.3f} or above wherever its vertices move", bound, "fan"
    width = _blade(mesh.points[nodes], normals[nodes], on_boundary[nodes], around.on_boundary[fan])
    if width is not None:
        return f"it spans two opposite sides of the boundary, {width:.2f} mm apart", bound, "banks"
    if on_boundary[nodes].all():
        return "all four nodes lie on the boundary, where they can only slide", bound, "fan"
    return "its connectivity is not the cause: moving vertices further may improve it", bound, "nothing"


def _blade(
    points: FloatArray, normals: FloatArray, on_boundary: NDArray[np.bool_], boundary_edges: NDArray[np.bool_]
) -> float | None:
    """Length (mm) of the shortest interior edge between boundary nodes whose normals point apart, if there is one."""
    lengths = [
        float(np.linalg.norm(points[i] - points[j]))
        for (i, j), outer in zip(TET_EDGES, boundary_edges, strict=True)
        if not outer and on_boundary[i] and on_boundary[j] and normals[i] @ normals[j] < 0
    ]
    return min(lengths, default=None)
