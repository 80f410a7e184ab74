"""How a mesh and its native surface belong together, so that values go from one to the other.

Smoothing moves vertices and keeps triangles. There a vertex of the native surface is known again by its number, and a
point of the meshed surface by its triangle and weights. Elsewhere the closest point takes their place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cortet.errors import InputError
from cortet.formats.gifti import read_surface
from cortet.formats.hashing import input_sha256
from cortet.formats.placement import placed
from cortet.formats.surface_sets import among, sides
from cortet.geometry.closest_point import closest_points, surface_tree, tree_of
from cortet.geometry.containing import containing
from cortet.geometry.interpolation import applied, at_triangles, is_label
from cortet.geometry.nesting import sheets
from cortet.geometry.topology import edges, sheet, vertex_normals
from cortet.measure.quality import signed_volumes
from cortet.meshes import REGION, FloatArray, IntArray, TetMesh, TriSurface, region_names
from cortet.solver_files.meshed import meshed_surface, parameters_of, recorded_file
from cortet.solver_files.sidecar import changed_since, read_sidecar

if TYPE_CHECKING:
    from collections.abc import Mapping

#: mm, of all vertices or of each of them (v,)
Millimetres = float | NDArray[np.float64]
#: depth: one, or the ends of a range
Depth = Millimetres | tuple[Millimetres, Millimetres]

#: mm: half of the vertices of a surface are nearer to the meshed one, or it is another's
_FAR_MM = 5.0
#: where a range of depths is sampled: the middles of ten equal parts
SAMPLES = (np.arange(10) + 0.5) / 10


class Located(NamedTuple):
    """Points on or below vertices, each in a tetrahedron."""

    #: (k,) number of the vertex, and of the tetrahedron
    vertices: NDArray[np.integer]
    cells: IntArray
    #: (k, 4) of the corners of the tetrahedron; their sum is the weight of the point among those of its vertex
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """Where the vertices of a native surface are on the boundary of a mesh, and its nodes on the native surface.

    A row of a matrix holds the weights of a value. A row without weights has no value: NaN.
    """

    mesh: TetMesh
    #: the surface as it was read, mm
    native: TriSurface
    #: the point on the surface of the mesh that is nearest to each vertex with a position
    nearest: Located
    #: (n, v) from vertices to nodes of the boundary; all other rows have no weights
    from_surface: csr_array
    #: (v, 3) mm, each vertex on the meshed surface, and the normal there, outward; NaN for a vertex without position
    points: FloatArray
    normals: FloatArray
    #: (v,) whether a vertex of that number is the same vertex on the meshed surface
    kept: NDArray[np.bool_]
    #: (v,) mm, from each vertex of the native surface to its place on the meshed surface
    distances: FloatArray

    @property
    def to_surface(self) -> csr_array:
        """(v, n) from nodes to vertices of the native surface."""
        return self.weights().nodes

    def weights(self, depth: Depth | None = None) -> ToSurface:
        """What brings values of the mesh to the vertices, on the surface, or below it along the inward normal there.

        A range is the mean over the part of it that lies in the mesh.

        Parameters
        ----------
        depth : mm, of one point or of both ends of a range; a vertex whose depth is NaN has no value
        """
        return ToSurface(self, self.nearest if depth is None else self._below(depth))

    @cached_property
    def corners(self) -> tuple[IntArray, csr_array]:
        """Number of each corner (m, 4) among pairs of a node and a region; (c, m) from tetrahedra to these pairs."""
        cells = self.mesh.cells
        region = self.mesh.cell_data.get(REGION, np.zeros(len(cells), np.int32)).astype(np.int64)
        pairs = cells + (region - region.min())[:, None] * len(self.mesh.points)
        corners = np.unique(pairs, return_inverse=True)[1].astype(np.int32).ravel()
        volumes = np.repeat(signed_volumes(self.mesh.points, cells), 4)
        shape = (int(corners.max()) + 1, len(cells))
        around = _means(corners, np.repeat(np.arange(len(cells)), 4), volumes, shape)
        return corners.reshape(-1, 4), around

    def _below(self, depth: Depth) -> Located:
        """Points below vertices; several of each for a range."""
        ends = depth if isinstance(depth, tuple) else (depth, depth)
        remedy = "give a depth of 0 mm or more, as a single value, one value per vertex, or a range (smaller, larger)"
        try:
            first, last = (np.broadcast_to(np.asarray(end, float), len(self.points)) for end in ends)
        except (TypeError, ValueError) as error:
            raise InputError(f"{depth} is not a valid depth: {error}", remedy=remedy) from error
        unknown = any(np.isnan(end) for end in ends if np.ndim(end) == 0)
        if unknown or np.any((first < 0) | (last < first) | np.isinf(first + last)):
            raise InputError(f"{depth} is not a valid depth", remedy=remedy)
        steps = SAMPLES if (first < last).any() else np.zeros(1)
        known = np.flatnonzero(np.isfinite(self.points).all(axis=1) & np.isfinite(first + last))
        found = []
        for step in steps:
            below = (first + (last - first) * step)[known, None]
            cells, own = containing(self.mesh, self.points[known] - below * self.normals[known])
            found.append((known[cells >= 0], cells[cells >= 0], own[cells >= 0]))
        return Located(*(np.concatenate(some) for some in zip(*found, strict=True)))

    def on_surface(self, values: NDArray[Any], depth: Depth | None = None) -> NDArray[Any]:
        """Values of the mesh at the vertices of the native surface: (v,) or (v, k), as `Mesh.to_surface`."""
        return self.weights(depth).of(values)


@dataclass(frozen=True, eq=False)
class ToSurface:
    """Weights with which values of a mesh come to the vertices of a native surface."""

    found: SurfaceMap
    there: Located

    @cached_property
    def nodes(self) -> csr_array:
        """(v, n) from nodes: interpolated in the tetrahedron that holds the point."""
        return self._of_corners(self.found.mesh.cells, len(self.found.mesh.points))

    @cached_property
    def means(self) -> csr_array:
        """(v, m) from tetrahedra: interpolated between means of those around each corner that are of its region."""
        corners, around = self.found.corners
        return self._of_corners(corners, around.shape[0]) @ around

    @cached_property
    def cells(self) -> csr_array:
        """(v, m) from tetrahedra: the value of the one that holds the point."""
        shape = (len(self.found.points), len(self.found.mesh.cells))
        return _means(self.there.vertices, self.there.cells, self.there.weights.sum(axis=1), shape)

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of nodes or of tetrahedra, as their number says, at the vertices: (v,) or (v, k)."""
        mesh = self.found.mesh
        if len(values) == len(mesh.points):
            return self.of_nodes(values)
        if len(values) == len(mesh.cells):
            return self.of_cells(values)
        raise InputError(
            f"{len(values):,} values do not fit a mesh of {len(mesh.points):,} nodes and {len(mesh.cells):,} "
            "tetrahedra",
            remedy="give one value for each node or tetrahedron",
        )

    def of_nodes(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (n,) or (n, k) of nodes at the vertices."""
        return applied(self.nodes, values)

    def of_cells(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (m,) or (m, k) of tetrahedra at the vertices: numbers by `means`, labels by `cells`."""
        return applied(self.cells if is_label(values) else self.means, values)

    def _of_corners(self, corners: IntArray, count: int) -> csr_array:
        """(v, count) from values at the corners of tetrahedra, which `corners` (m, 4) numbers."""
        rows, columns = np.repeat(self.there.vertices, 4), corners[self.there.cells].ravel()
        return _means(rows, columns, self.there.weights.ravel(), (len(self.found.points), count))


def surface_map(
    mesh: TetMesh, meshed: TriSurface, native: TriSurface, *, number: int = 0, renumbered: bool = False
) -> SurfaceMap:
    """The map between a mesh and one of its native surfaces.

    Parameters
    ----------
    mesh : filled from `meshed`
    meshed : the surface that was meshed, in the coordinates of the mesh, without inner surfaces
    native : the surface as it was read, in mm; vertices may have coordinates that are not finite
    number : of the surface: 0 is the outer one, i the i-th inner one
    renumbered : whether equal numbers of vertices mean nothing, as after resampling
    """
    boundary, nodes = _faces_of(mesh, number)
    finite = np.isfinite(native.points.sum(axis=1))
    kept, shared = (np.zeros(len(native.points), bool), np.zeros(len(meshed.faces), bool))
    if not renumbered:
        kept, shared = _same(native, meshed)
    points, normals = np.full(native.points.shape, np.nan), np.full(native.points.shape, np.nan)
    of_meshed = vertex_normals(meshed.points, meshed.faces)
    points[kept], normals[kept] = meshed.points[np.flatnonzero(kept)], of_meshed[np.flatnonzero(kept)]
    others = np.flatnonzero(~kept & finite)
    there = closest_points(tree_of(meshed), native.points[others])
    points[others] = there.points
    normal = at_triangles(of_meshed, meshed.faces[there.faces], there.barycentric)
    normals[others] = normal / np.linalg.norm(normal, axis=1, keepdims=True).clip(1e-12)
    known = np.flatnonzero(kept | finite)
    down = closest_points(tree_of(boundary), points[known])
    nearest = _in_tetrahedra(mesh, known, nodes[boundary.faces[down.faces]], down.barycentric)
    up = closest_points(tree_of(meshed), boundary.points)
    corners, weights = meshed.faces[up.faces].copy(), up.barycentric.copy()
    if len(far := np.flatnonzero(~shared[up.faces])):
        faces = native.faces[finite[native.faces].all(axis=1)]
        closest = closest_points(surface_tree(native.points, faces), boundary.points[far])
        corners[far], weights[far] = faces[closest.faces], closest.barycentric
    shape = (len(mesh.points), len(native.points))
    from_surface = _means(np.repeat(nodes, 3), corners.ravel(), weights.ravel(), shape)
    distances = np.linalg.norm(points - native.points, axis=1)
    return SurfaceMap(mesh, native, nearest, from_surface, points, normals, kept, distances)


def map_of_file(path: Path, mesh: TetMesh, surface: Path | None = None) -> tuple[SurfaceMap, Path, str]:
    """The map between a mesh and the surface that its sidecar or the user names; that file; how they were matched.

    Parameters
    ----------
    path, mesh : file of a mesh, and what was read from it
    surface : another file, or that of an inner surface
    """
    if changed_since(path):
        raise InputError(
            "was changed after cortet wrote it, so its surface is unknown",
            file=path,
            remedy="restore the mesh, or delete its sidecar and name the surface (--surface)",
        )
    record = read_sidecar(path).get("made_from") or {}
    given = record.get("given") or {}
    file = _given_file(path, given) if surface is None else surface
    digest = input_sha256(file)
    region = next((name for name, one in given.items() if one["sha256"] == digest), None)
    parameters = parameters_of(path)
    native = replace(read_surface(file, finite=False), inner={}, point_data={})
    native = placed(native, parameters.get("gate", {}).get("to_mm") if region else None)
    if not len(native.faces):
        raise InputError("has no triangles", file=file, remedy="name the surface that the mesh was made from")
    if record.get("meshed"):
        every = meshed_surface(path, None, {})[0]
        names = region_names(every.inner)
        number = names.index(region or next(iter(given), names[0]))
        meshed, renumbered = sheets(every)[number], "resample" in parameters
    else:  # the boundary takes the place of the meshed surface
        meshed, number, renumbered = _faces_of(mesh, 0)[0], 0, True
    found = surface_map(mesh, meshed, native, number=number, renumbered=renumbered)
    others = found.distances[~found.kept & np.isfinite(found.distances)]
    if len(others) and np.median(others) > _FAR_MM:
        raise InputError(
            f"is not the surface of {path.name}: half of its vertices are more than {np.median(others):.1f} mm away",
            file=file,
            remedy="name the surface that the mesh was made from, in mm",
        )
    matched = [f"{found.kept.sum():,} of {len(found.kept):,} vertices by their number"] if found.kept.any() else []
    if matched and (far := np.nanmedian(found.distances[found.kept])) > _FAR_MM:  # an inflated one, or another brain
        matched.append(f"although half of them are more than {far:.1f} mm away")
    if len(others):
        matched.append(f"{len(others):,} by the closest point, at most {others.max():.2f} mm away")
    return found, file, ", ".join(matched)


def _given_file(mesh: Path, given: Mapping[str, Mapping[str, str]]) -> Path:
    """The file of the outermost surface that a mesh was made from, which must be as it was then."""
    if not given:
        raise InputError(
            "no sidecar records the surface of this mesh", file=mesh, remedy="name the surface with --surface"
        )
    return recorded_file(mesh, next(iter(given.values())))


def _faces_of(mesh: TetMesh, number: int) -> tuple[TriSurface, IntArray]:
    """The faces of a mesh that represent a surface, and the node of each of their vertices."""
    surface, nodes = sheet(mesh, number)
    if not len(surface.faces):
        remedy = "name a region whose surface is part of the mesh"
        raise InputError(f"the mesh has no faces around region {number + 1}", remedy=remedy)
    return surface, nodes


def _same(native: TriSurface, meshed: TriSurface) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Vertices of the native surface that have kept their number and all their triangles; faces of the other with only
    such corners.

    Where some triangles differ, chance may make others alike, so a vertex must also be near its place.
    """
    known, shared = among(native.faces, meshed.faces), among(meshed.faces, native.faces)
    count = len(native.points)
    kept = np.bincount(native.faces[known].ravel(), minlength=count) > 0
    if not (known.all() and shared.all()):
        kept &= np.bincount(native.faces[~known].ravel(), minlength=count) == 0
        near = np.flatnonzero(kept)
        ends = edges(meshed.faces)
        edge = float(np.linalg.norm(meshed.points[ends[:, 0]] - meshed.points[ends[:, 1]], axis=1).mean())
        kept[near] = ~(np.linalg.norm(meshed.points[near] - native.points[near], axis=1) > edge)
        same = np.zeros(max(count, len(meshed.points)), bool)
        same[:count] = kept
        shared &= same[meshed.faces].all(axis=1)
    return kept, shared


def _in_tetrahedra(mesh: TetMesh, vertices: NDArray[np.integer], faces: IntArray, weights: FloatArray) -> Located:
    """Points of vertices (k,) in faces (k, 3) by weights (k, 3), in the tetrahedron that a face is seen outside of."""
    cells, _ = sides(mesh, faces)
    same = mesh.cells[cells][:, :, None] == faces[:, None, :]
    return Located(vertices, cells, (same * weights[:, None, :]).sum(axis=2))


def _means(
    rows: NDArray[np.integer], columns: NDArray[np.integer], weights: FloatArray, shape: tuple[int, int]
) -> csr_array:
    """A matrix of given weights (k,), divided by their sum in each row.

    It has no zeros among its entries, so that a value that is not finite counts only where it has a share.
    """
    total = np.bincount(rows, weights, minlength=shape[0])
    made = csr_array((weights / total[rows], (rows, columns)), shape=shape)
    made.eliminate_zeros()
    return made
