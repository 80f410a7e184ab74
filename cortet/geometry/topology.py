"""Connectivity: boundary faces, incidence, Euler number and manifold checks.

Only the few functions that take `points` use more than indices. Results that belong to one mesh (such as its boundary
faces) are computed on first use and kept as long as the mesh lives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from cortet.errors import counted
from cortet.geometry.counting import behind_faces
from cortet.geometry.remembering import OncePerCells, once_per_array, once_per_object
from cortet.meshes import REGION, FloatArray, IntArray, TetMesh, TriSurface

#: corners of the face opposite each corner of a tetrahedron, outward for positive volume
TET_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
#: the six edges of a tetrahedron
TET_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
#: the three directed edges of a triangle
TRI_EDGES = np.array([[0, 1], [1, 2], [2, 0]])


class Incidence(NamedTuple):
    """Cells around each vertex, compressed: those of v are `cells[offsets[v]:offsets[v + 1]]`."""

    #: (n + 1,) int64
    offsets: NDArray[np.int64]
    #: (total,) int32, cell indices, ascending within a vertex
    cells: IntArray
    #: (total,) int8, which corner of that cell the vertex is
    corners: NDArray[np.int8]


class BoundaryFaces(NamedTuple):
    """Faces that belong to exactly one tetrahedron."""

    #: (k, 3) int32, counter-clockwise seen from outside
    faces: IntArray
    #: (k,) int32, the tetrahedron each belongs to
    cells: IntArray


class Interfaces(NamedTuple):
    """Faces between tetrahedra of two regions. A surface precedes those that it contains, so each face belongs to the
    surface with the higher of the two numbers.
    """

    #: (k, 3) int32, counter-clockwise seen from outside the region with the higher number
    faces: IntArray
    #: (k,) int32, the tetrahedron of that region, and the one behind the face
    cells: IntArray
    behind: IntArray
    #: (k,) int32, the higher number
    region: IntArray


@dataclass(frozen=True)
class SurfaceTopology:
    """Topology of a triangulated surface, from its connectivity alone; coordinates play no role."""

    components: int
    #: V - E + F over used vertices; 2 for a sphere
    euler_number: int
    #: edges in one face only
    open_edges: int
    #: edges in more than two faces
    nonmanifold_edges: int
    #: edges whose two faces run through them in the same direction
    misoriented_edges: int
    #: vertices whose faces form more than one fan, although every edge is manifold
    pinched_vertices: int

    @property
    def is_closed_manifold(self) -> bool:
        """Whether it is one consistently oriented surface without border, with one fan of faces at every vertex."""
        return self.components == 1 and not (
            self.open_edges or self.nonmanifold_edges or self.misoriented_edges or self.pinched_vertices
        )

    @property
    def genus(self) -> float:
        """Number of handles of a closed manifold with one component."""
        return (2 - self.euler_number) / 2

    def problems(self, genus: int = 0) -> list[str]:
        """What keeps this from being one closed, oriented manifold of the given genus, in plain words."""
        found = []
        if self.components != 1:
            found.append(f"{self.components} components instead of one")
        if self.open_edges:
            found.append(f"{counted(self.open_edges, 'open edge')} (in one face only)")
        if self.nonmanifold_edges:
            found.append(f"{counted(self.nonmanifold_edges, 'edge')} in more than two faces")
        if self.misoriented_edges:
            found.append(f"{counted(self.misoriented_edges, 'edge')} between inconsistently oriented faces")
        if self.pinched_vertices:
            found.append(
                f"{counted(self.pinched_vertices, 'pinched vertex', 'pinched vertices')} (more than one fan of faces)"
            )
        if not found and self.euler_number != 2 - 2 * genus:
            found.append(f"Euler number {self.euler_number} instead of {2 - 2 * genus} (genus {self.genus:g})")
        return found


def packed(simplices: NDArray[np.integer]) -> NDArray[np.int64]:
    """One int64 key per simplex (row), the same for any order of its 2 or 3 vertices."""
    rows = np.sort(simplices, axis=1).astype(np.int64)
    base = int(rows.max(initial=0)) + 1
    if base ** rows.shape[1] >= 2**63:  # more than two million nodes: number the leading edges, then pack two values
        leading = np.unique(rows[:, 0] * base + rows[:, 1], return_inverse=True)[1]
        return leading * base + rows[:, 2]
    key = rows[:, 0]
    for column in rows.T[1:]:
        key = key * base + column
    return key


@OncePerCells
def neighbours(mesh: TetMesh) -> IntArray:
    """The tetrahedron behind the face opposite each corner: (m, 4) int32, -1 outside."""
    return behind_faces(mesh.cells, TET_FACES, len(mesh.points))


@OncePerCells
def boundary(mesh: TetMesh) -> BoundaryFaces:
    """Boundary faces of a mesh, outward, with the tetrahedron that owns each, in the order of the tetrahedra."""
    cell, corner = np.nonzero(neighbours(mesh) < 0)
    return BoundaryFaces(mesh.cells[cell[:, None], TET_FACES[corner]], cell.astype(np.int32))


def boundary_faces(mesh: TetMesh) -> IntArray:
    """Faces in exactly one tetrahedron: (k, 3) int32, outward."""
    return boundary(mesh).faces


@OncePerCells
def boundary_nodes(mesh: TetMesh) -> IntArray:
    """Nodes of the boundary faces: (b,) int32, ascending."""
    return used_vertices(boundary_faces(mesh), len(mesh.points))


@once_per_object
def boundary_surface(mesh: TetMesh) -> tuple[TriSurface, IntArray]:
    """The boundary as a surface, and the mesh node of each of its vertices; each call returns the same objects."""
    nodes = boundary_nodes(mesh)
    faces = numbers(nodes, len(mesh.points))[boundary_faces(mesh)]
    return TriSurface(mesh.points[nodes], faces), nodes


def boundary_with_fields(mesh: TetMesh) -> TriSurface:
    """The boundary with the fields of its nodes."""
    surface, nodes = boundary_surface(mesh)
    return replace(surface, point_data={name: values[nodes] for name, values in mesh.point_data.items()})


def used_vertices(simplices: IntArray, vertex_count: int) -> IntArray:
    """Vertices that occur in triangles or tetrahedra: (k,) int32, ascending."""
    used = np.zeros(vertex_count, np.bool_)
    used[simplices] = True
    return np.flatnonzero(used).astype(np.int32)


def numbers(chosen: NDArray[np.integer], count: int) -> IntArray:
    """Position in `chosen` (k,) of each of `count` indices: (count,) int32, -1 for an index that is not chosen."""
    place = np.full(count, -1, np.int32)
    place[chosen] = np.arange(len(chosen), dtype=np.int32)
    return place


@once_per_object
def interfaces(mesh: TetMesh) -> Interfaces:
    """Faces between tetrahedra of two regions; none if the mesh has no regions."""
    region = mesh.cell_data.get(REGION)
    if region is None:
        none = np.zeros(0, np.int32)
        return Interfaces(np.zeros((0, 3), np.int32), none, none, none)
    behind = neighbours(mesh)
    cell, corner = np.nonzero((behind >= 0) & (region[:, None] > region[behind]))
    faces = mesh.cells[cell[:, None], TET_FACES[corner]]
    inside = cell.astype(np.int32)
    return Interfaces(faces, inside, behind[cell, corner], region[cell].astype(np.int32))


def sheet(mesh: TetMesh, number: int) -> tuple[TriSurface, IntArray]:
    """The faces that represent one of the given surfaces, and the mesh node of each of their vertices.

    Parameters
    ----------
    number : 0 for the boundary, i for the faces around the i-th inner surface: region i + 1 is inside it
    """
    if number == 0:
        return boundary_surface(mesh)
    found = interfaces(mesh)
    points, faces, nodes = compact(mesh.points, found.faces[found.region == number + 1])
    return TriSurface(points, faces), nodes


def incidence(cells: IntArray, vertex_count: int) -> Incidence:
    """Cells (triangles or tetrahedra) around every vertex."""
    count, size = cells.shape
    corners, starts = np.tile(np.arange(size, dtype=np.int8), count), np.arange(0, cells.size + 1, size)
    around = csr_matrix((corners, cells.ravel(), starts), shape=(count, vertex_count)).tocsc()
    return Incidence(around.indptr.astype(np.int64), around.indices.astype(np.int32), around.data)


def edges(simplices: IntArray) -> IntArray:
    """Unique edges of triangles or tetrahedra: (e, 2) int32, lower index first, sorted."""
    local = TRI_EDGES if simplices.shape[1] == 3 else TET_EDGES
    ends = simplices[:, local].reshape(-1, 2)
    size = int(simplices.max(initial=0)) + 1
    every = coo_array((np.ones(len(ends), np.int8), (np.minimum(*ends.T), np.maximum(*ends.T))), shape=(size, size))
    found = every.tocsr().tocoo()  # each once, in order
    return np.column_stack([found.row, found.col]).astype(np.int32)


def components(simplices: IntArray) -> int:
    """Number of connected components of the used vertices."""
    return len(np.unique(component_labels(simplices)[simplices[:, 0]]))


def component_labels(simplices: IntArray) -> IntArray:
    """Component of every vertex up to the largest used index: (n,) int32; each unused vertex is its own component."""
    first, last = np.repeat(simplices[:, 0], simplices.shape[1] - 1), simplices[:, 1:].ravel()
    return linked(first, last, int(simplices.max(initial=-1)) + 1)


def linked(first: NDArray[np.integer], second: NDArray[np.integer], count: int) -> IntArray:
    """Group of each of `count` things, (count,), that links from `first` (k,) to `second` (k,) join."""
    graph = coo_matrix((np.ones(len(first), np.int8), (first, second)), shape=(count, count))
    label: IntArray = connected_components(graph, directed=False)[1]
    return label


@once_per_array
def surface_topology(faces: IntArray) -> SurfaceTopology:
    """Components, Euler number and every kind of non-manifold defect of a triangulated surface.

    Parameters
    ----------
    faces : (m, 3) int32
    """
    sides = sides_of(faces)
    of_vertex = np.bincount(fans(faces, sides)[1])
    return SurfaceTopology(
        components=components(faces),
        euler_number=int(np.count_nonzero(of_vertex) - len(sides.counts) + len(faces)),
        open_edges=int((sides.counts == 1).sum()),
        nonmanifold_edges=int((sides.counts > 2).sum()),
        misoriented_edges=int(sides.same.sum()),
        pinched_vertices=int((of_vertex > 1).sum()),
    )


class Sides(NamedTuple):
    """The sides of faces and the edges they form; side 3 f + i runs from corner i of face f to corner i + 1."""

    #: (e,) faces at each edge
    counts: NDArray[np.int64]
    #: (k,) both sides of each edge of exactly two faces
    first: NDArray[np.int64]
    second: NDArray[np.int64]
    #: (k,) whether both sides run the same way, so that the two faces disagree
    same: NDArray[np.bool_]


def sides_of(faces: IntArray) -> Sides:
    """The sides of triangles (m, 3), by the edges they form, ordered by edge."""
    directed = faces[:, TRI_EDGES].reshape(-1, 2)
    order = np.argsort(packed(directed), kind="stable")
    ordered = directed[order]
    starts = np.flatnonzero(np.r_[True, (np.sort(ordered[1:], 1) != np.sort(ordered[:-1], 1)).any(1)])
    counts = np.diff(np.r_[starts, len(order)])
    paired = starts[counts == 2]
    first, second = order[paired], order[paired + 1]
    return Sides(counts, first, second, directed[first, 0] == directed[second, 0])


def fans(faces: IntArray, sides: Sides | None = None) -> tuple[IntArray, NDArray[np.int64]]:
    """The fan that each corner of each face belongs to, (3 m,), corner i of face f at 3 f + i; the vertex of each fan.

    The two faces of an edge link their corners at both of its ends. The fans of a vertex are the connected components
    of its corners. Edges of one face, or of more than two, link none.
    """
    first, second, same = (sides or sides_of(faces))[1:]
    after_first, after_second = (side // 3 * 3 + (side % 3 + 1) % 3 for side in (first, second))
    others = np.concatenate([np.where(same, second, after_second), np.where(same, after_second, second)])
    fan = linked(np.concatenate([first, after_first]), others, 3 * len(faces))
    vertex = np.zeros(fan.max(initial=-1) + 1, np.int64)
    vertex[fan] = faces.ravel()
    return fan, vertex


def cut_components(mesh: TetMesh, faces: IntArray) -> IntArray:
    """Component of each tetrahedron, (m,), once the mesh is cut open along the faces (k, 3)."""
    cells, behind = mesh.cells, neighbours(mesh).copy()
    cell = np.flatnonzero(np.isin(cells, faces).sum(axis=1) >= 3)
    near = cells[cell][:, TET_FACES].reshape(-1, 3)
    key = packed(np.concatenate([faces, near]))
    cut = np.isin(key[len(faces) :], key[: len(faces)]).reshape(-1, 4)
    behind[cell] = np.where(cut, -1, behind[cell])
    return bodies(behind)


def bodies(behind: IntArray) -> IntArray:
    """Connected body of each tetrahedron, (m,), by the tetrahedron behind each of its faces, (m, 4), -1 for none."""
    start, _ = np.nonzero(behind >= 0)
    return linked(start, behind[behind >= 0], len(behind))


def compact(points: FloatArray, cells: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Drop unused vertices, keeping the order of the others.

    Returns the (k, 3) points, the renumbered cells, and the (k,) old index of each kept vertex.
    """
    used = used_vertices(cells, len(points))
    return points[used], numbers(used, len(points))[cells], used


def face_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Normals of length twice the area: (m, 3), mm2."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def face_areas(points: FloatArray, faces: IntArray) -> FloatArray:
    """Areas: (m,), mm2."""
    return 0.5 * np.linalg.norm(face_normals(points, faces), axis=1)


def vertex_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Area-weighted unit normals: (n, 3); zero for an unused vertex."""
    return unit_vectors(summed(faces.ravel(), np.repeat(face_normals(points, faces), 3, axis=0), len(points)))


def summed(numbers: NDArray[np.integer], vectors: FloatArray, count: int) -> FloatArray:
    """Sum of the vectors (k, 3) of each of `count` numbers (k,): (count, 3)."""
    return np.stack([np.bincount(numbers, vectors[:, i], minlength=count) for i in range(3)], axis=1)


def unit_vectors(vectors: NDArray[Any]) -> FloatArray:
    """Vectors (k, 3) scaled to unit length; vectors of length 0 stay as they are."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny)


def enclosed_volume(points: FloatArray, faces: IntArray) -> float:
    """Signed volume inside a closed surface, positive when its faces point outward: mm3 (divergence theorem)."""
    centred = points - points.mean(axis=0)
    a, b, c = (centred[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def enclosed_centroid(points: FloatArray, faces: IntArray) -> FloatArray:
    """Centroid of what lies inside a closed surface: (3,) mm (divergence theorem)."""
    middle = points.mean(axis=0)
    a, b, c = (points[faces[:, i]] - middle for i in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c))
    centroid: FloatArray = middle + volumes @ (a + b + c) / (4 * volumes.sum())
    return centroid


def mean_edge(points: FloatArray, faces: IntArray) -> float:
    """Mean length of the edges, mm."""
    start, end = edges(faces).T
    return float(np.linalg.norm(points[start] - points[end], axis=1).mean())


def neighbour_means(points: FloatArray, faces: IntArray) -> FloatArray:
    """Mean position of the edge neighbours of each vertex: (n, 3) mm; NaN for an unused vertex."""
    return linked_means(points, edges(faces))


def linked_means(vectors: FloatArray, links: IntArray) -> FloatArray:
    """Mean of the vectors (n, 3) of those that links (k, 2) join to each; NaN for one without links."""
    here, there = np.concatenate([links, links[:, ::-1]]).T
    degree = np.bincount(here, minlength=len(vectors))
    with np.errstate(invalid="ignore"):
        return summed(here, vectors[there], len(vectors)) / degree[:, None]
