"""Ten-node tetrahedra with midside nodes on the surface wherever the elements stay valid.

The Jacobian determinant of a ten-node tetrahedron is a cubic polynomial. Its 20 Bernstein coefficients bound it from
both sides over the whole element (Johnen, Remacle, Geuzaine, J. Comput. Phys. 233, 2013). So a positive least
coefficient proves more than positive values at nodes and quadrature points.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError, StageError, place_mm
from cortet.geometry.banks import banks
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.filling import require_body
from cortet.geometry.intersection import self_intersections
from cortet.geometry.limits import LEAST_BANK_GAP
from cortet.geometry.topology import TRI_EDGES, boundary_surface, edges, sheet
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface

#: corners at the ends of the six edges, in the order of VTK, Abaqus and FEBio
EDGES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]], np.int32)
#: least Jacobian determinant allowed, as a fraction of that of the straight element
LEAST_JACOBIAN = 0.2
#: the four triangles that make a face: 0 to 2 are its corners, 3 to 5 the middles of `TRI_EDGES`
_PARTS = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


@dataclass(frozen=True)
class QuadraticMesh:
    """A mesh of ten-node tetrahedra."""

    #: (n + k, 3) mm: the unchanged corners, then one node per edge
    points: FloatArray
    #: (m, 10) int32: four corners, then the middles of `EDGES`
    cells: IntArray
    #: (k, 2) int32, corners at the ends of each midside node's edge
    ends: IntArray
    #: (k,) whether the edge lies on the boundary or an interface
    on_surface: NDArray[np.bool_]
    #: edges with their middle on the surface; edges left straight to keep an element valid; edges left straight to keep
    #: faces from crossing
    curved: int
    straightened_for_elements: int
    straightened_for_crossings: int
    #: lower bound of the Jacobian determinant over all elements, as a fraction of that of the straight element
    least_jacobian: float
    #: mm, largest distance of a midside node from the middle of its edge
    largest_move_mm: float


def quadratic(mesh: TetMesh, surface: TriSurface, *, max_boundary_distance: float | None = 1e-3) -> QuadraticMesh:
    """Give every edge of a mesh a midside node, and move those of the boundary and the interfaces to the surface.

    An edge stays straight if the curved faces would cross, or if the Jacobian determinant would fall below
    `LEAST_JACOBIAN` of that of the straight element anywhere in an element around it.

    Parameters
    ----------
    mesh : with positive volumes
    surface : the surface that was meshed, on which the boundary lies, with the inner surfaces of the regions
    max_boundary_distance : mm, largest distance of a node of the boundary or an interface from its surface; None: any

    Returns
    -------
    the ten-node mesh; the corners keep their numbers

    Raises
    ------
    InputError
        tetrahedra are flat or inverted or fill no body, nodes lie on another surface, or banks almost touch
    StageError
        an element of the result is not valid
    """
    _require_sound(mesh)
    walls = list(_walls(mesh, surface))
    if max_boundary_distance is not None:
        _require_on_surface(mesh, walls, max_boundary_distance)
        _require_banks_apart(mesh, surface)
    ends = edges(mesh.cells)
    key = ends[:, 0].astype(np.int64) * len(mesh.points) + ends[:, 1]

    def number_of(pairs: IntArray) -> IntArray:
        """Edge number of pairs of corners (..., 2)."""
        low, high = pairs.min(axis=-1), pairs.max(axis=-1)
        return np.searchsorted(key, low.astype(np.int64) * len(mesh.points) + high).astype(np.int32)

    of_cells = number_of(mesh.cells[:, EDGES])
    straight = mesh.points[ends].mean(axis=1)
    middle, on_surface = straight.copy(), np.zeros(len(ends), bool)
    for faces, target in walls:
        chosen = np.unique(number_of(faces[:, TRI_EDGES]))
        middle[chosen] = closest_points(tree_of(target), straight[chosen]).points
        on_surface[chosen] = True
    shape = _Shape(mesh, of_cells, straight, middle, (middle != straight).any(axis=1))
    of_walls = [(faces, number_of(faces[:, TRI_EDGES])) for faces, _ in walls]
    for_elements = for_crossings = 0
    while True:  # each edge that is made straight changes its faces and its elements
        for_elements += shape.straighten_elements()
        found = sum(shape.straighten_crossings(faces, of_faces) for faces, of_faces in of_walls)
        for_crossings += found
        if not found:
            break

    touched = np.flatnonzero(shape.moved[of_cells].any(axis=1))
    least = jacobian_bounds(mesh.points[mesh.cells[touched]], middle[of_cells[touched]])
    if not least.min(initial=1.0) > 0:
        raise StageError(
            "a curved ten-node element may be inverted: the lower bound of its Jacobian determinant is "
            f"{least.min():.3g}"
        )
    return QuadraticMesh(
        points=np.concatenate([mesh.points, middle]),
        cells=np.concatenate([mesh.cells, of_cells + np.int32(len(mesh.points))], axis=1),
        ends=ends,
        on_surface=on_surface,
        curved=int(shape.moved.sum()),
        straightened_for_elements=for_elements,
        straightened_for_crossings=for_crossings,
        least_jacobian=float(least.min(initial=1.0)),
        largest_move_mm=float(np.linalg.norm(middle - straight, axis=1).max()),
    )


def jacobian_bounds(corners: FloatArray, middles: FloatArray) -> FloatArray:
    """Lower bounds of the Jacobian determinants of ten-node tetrahedra.

    Parameters
    ----------
    corners : (m, 4, 3)
    middles : (m, 6, 3), of `EDGES`

    Returns
    -------
    (m,), fractions of the size of the determinant of the straight element; 1 for a straight one, -1 for an inverted one
    """
    # control points of the quadratic map: they equal the nodes at corners, but not at edges
    control = np.empty((len(corners), 4, 4, 3))
    for corner in range(4):
        control[:, corner, corner] = corners[:, corner]
    for number, (i, j) in enumerate(EDGES):
        control[:, i, j] = control[:, j, i] = 2 * middles[:, number] - (corners[:, i] + corners[:, j]) / 2
    # derivatives along the edges from corner 0 are linear: `slopes[:, a, b]` points to corner a + 1, taken at corner b
    slopes = 2 * (control[:, 1:] - control[:, :1])
    least = np.full(len(corners), np.inf)
    for powers in combinations_with_replacement(range(4), 3):
        orders = sorted(set(permutations(powers)))
        terms = [_determinant(*(slopes[:, a, b] for a, b in enumerate(order))) for order in orders]
        np.minimum(least, np.mean(terms, axis=0), out=least)
    return least / np.abs(_determinant(*(corners[:, a] - corners[:, 0] for a in (1, 2, 3))))


def _determinant(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    return np.einsum("mi,mi->m", a, np.cross(b, c))


def _require_sound(mesh: TetMesh) -> None:
    """Raise InputError for flat or inverted tetrahedra, whose determinant says nothing, and for overlapping ones."""
    a, b, c, d = (mesh.points[mesh.cells[:, corner]] for corner in range(4))
    if wrong := np.count_nonzero(~(_determinant(b - a, c - a, d - a) > 0)):
        raise InputError(
            f"{wrong} of {len(mesh.cells)} tetrahedra are flat or inverted",
            remedy="`cortet certify` lists their locations; repair them in the program that made the mesh",
        )
    require_body(mesh)


def _require_on_surface(mesh: TetMesh, walls: list[tuple[IntArray, TriSurface]], limit: float) -> None:
    """Raise InputError where nodes of the boundary or an interface are farther than `limit` mm from its surface."""
    if not 0 < limit < np.inf:
        raise InputError(f"max_boundary_distance = {limit:g} is not above 0", remedy="give a distance in mm")
    for faces, target in walls:
        distances = closest_points(tree_of(target), mesh.points[np.unique(faces)]).distances
        if off := np.count_nonzero(distances > limit):
            raise InputError(
                f"{off} of {len(distances)} boundary nodes are more than {limit:g} mm from the surface, the farthest "
                f"{distances.max():.3g} mm",
                remedy="give the meshed surface, NAME.meshed.surf.gii, which `cortet mesh` writes next to the mesh; "
                "smoothing can make it differ from the input surface",
            )


def _require_banks_apart(mesh: TetMesh, surface: TriSurface) -> None:
    """Raise InputError for a slit: the middles of both its banks would move onto the surface around it."""
    found = banks(boundary_surface(mesh)[0], surface)
    if found.least_share < LEAST_BANK_GAP:
        raise InputError(
            f"two banks of the boundary are {found.gap_mm:.3g} mm apart at {place_mm(found.place_mm)}, but those "
            f"of the surface are at least {found.surface_gap_mm:.3g} mm apart",
            remedy="mesh it again with a smaller cell size",
        )


def _walls(mesh: TetMesh, surface: TriSurface) -> Iterator[tuple[IntArray, TriSurface]]:
    """Faces of the boundary, then of each interface, as nodes of the mesh, with the surface on which they lie."""
    for number, target in enumerate((surface, *surface.inner.values())):
        wall, nodes = sheet(mesh, number)
        yield nodes[wall.faces], target


class _Shape(NamedTuple):
    """Positions of the middles of the edges; each method makes edges straight and says how many."""

    mesh: TetMesh
    #: (m, 6) edges of the elements
    of_cells: IntArray
    #: (k, 3) mm, the middles of the straight edges and the present middles; (k,) whether they differ
    straight: FloatArray
    middle: FloatArray
    moved: NDArray[np.bool_]

    def straighten_elements(self) -> int:
        """Straighten the edges of overly distorted elements; returns how many."""
        count = 0
        suspects = np.flatnonzero(self.moved[self.of_cells].any(axis=1))
        while len(suspects):
            of_suspects = self.of_cells[suspects]
            bounds = jacobian_bounds(self.mesh.points[self.mesh.cells[suspects]], self.middle[of_suspects])
            changed = self._straighten(of_suspects[bounds < LEAST_JACOBIAN])
            count += len(changed)
            suspects = np.flatnonzero(np.isin(self.of_cells, changed).any(axis=1))
        return count

    def straighten_crossings(self, faces: IntArray, of_faces: IntArray) -> int:
        """Straighten the edges of faces (f, 3) with a triangle, of four, that crosses another; returns how many."""
        count = 0
        corners = np.concatenate([faces, of_faces + len(self.mesh.points)], axis=1)
        used, parts = np.unique(corners[:, _PARTS].reshape(-1, 3), return_inverse=True)
        while True:
            points = np.concatenate([self.mesh.points, self.middle])[used]
            crossing = self_intersections(TriSurface(points, parts.reshape(-1, 3).astype(np.int32)))
            changed = self._straighten(of_faces[np.unique(crossing // len(_PARTS))])
            if not len(changed):
                return count
            count += len(changed)

    def _straighten(self, edges: IntArray) -> IntArray:
        """Make edges straight; returns those that were curved."""
        changed = np.unique(edges)
        changed = changed[self.moved[changed]]
        self.middle[changed], self.moved[changed] = self.straight[changed], False
        return changed
