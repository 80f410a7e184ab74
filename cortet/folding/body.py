"""The reference state of a growing body: everything about a mesh that does not change while it folds.

Lengths are divided by `Scale.length`, so that the constants below hold; they come from whole brains of size 1.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cortet.errors import InputError, counted
from cortet.folding.fields import MASK_FIELD, THICKNESS_FIELD, node_field
from cortet.folding.law import depth_of_share, growth_share
from cortet.formats.surface_sets import INTERFACE
from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.topology import (
    boundary,
    boundary_faces,
    boundary_nodes,
    cut_components,
    enclosed_centroid,
    interfaces,
    vertex_normals,
)
from cortet.measure.quality import signed_volumes
from cortet.meshes import FILLED, REGION, FloatArray, IntArray, MeshSets, TetMesh, TriSurface

#: cortical thickness at t = 0, and its gain per unit of time
THICKNESS, THICKENING = 0.042, 0.01
#: no cortex grows within the first radius around the corpus callosum; all cortex does beyond the sum of both
_CALLOSUM_RADIUS, _CALLOSUM_RIM = 0.5, 0.1
#: no cortex grows within the first radius of the reference's ellipsoid; all cortex does beyond the second. Its centre
#: and the inverse of its half axes in normalised RAS coordinates (the reference's x is our -y, and its z our -z)
_ELLIPSOID_RADII = (0.5, 0.6)
_ELLIPSOID_CENTRE, _ELLIPSOID_AXES = np.array([0.0, 0.1, -0.05]), np.array([1.0, 0.714, 1.0])
#: places in a tetrahedron, (20, 4) barycentric, at which it is asked whether there is cortex
_PLACES = np.array([place for place in product(range(4), repeat=4) if sum(place) == 3]) / 4 + 1 / 16
#: depth, in thicknesses, at which nothing grows
_NO_GROWTH = 10.0
#: how far a field of 0 to 1 may leave this range: values in single precision, carried to nodes as weighted means
_ROUNDING = 1e-5


class Material(NamedTuple):
    """Constants of the model, dimensionless (Tallinen et al. 2016; there the damping is 0.5)."""

    #: shear modulus of growing cortex, and of tissue that does not grow
    mu_cortex: float = 1.0
    mu_core: float = 1.167
    bulk: float = 5.0
    density: float = 0.01
    #: a drag on all that moves, which holds wide folds back most: with ten times as much, folds on a core that yields
    #: come later and are a tenth narrower
    damping: float = 0.05
    #: part of its shear energy that an element has from its own deformation, the rest from that of its edges
    #: (`smoothing`); 1: linear tetrahedra
    own: float = 0.1


class Scale(NamedTuple):
    """x_mm = origin + length * x."""

    #: (3,) mm
    origin: FloatArray
    #: mm
    length: float


class Body(NamedTuple):
    """m tetrahedra on n nodes in their reference state; lengths are dimensionless."""

    #: (m, 4) int32
    cells: IntArray
    #: (m, 3, 3), gradients of the shape functions of the nodes 1, 2 and 3 of each element
    gradients: FloatArray
    #: (m,)
    volumes: FloatArray
    #: (m, 3), unit vector across the cortex; the zero vector lets an element grow in all directions
    normals: FloatArray
    #: (m,), depth at which there is as much cortex as on average in the element; if the cortex is a region: 0 inside,
    #: and too deep for any growth outside
    depth: FloatArray
    #: (m,), 1 where there is cortex next to the surface, 0 where there is none; only cortex has the stiffness of cortex
    mask: FloatArray
    #: (m,), share of the tangential growth of its law that the cortex takes part in
    amount: FloatArray
    #: (m,), shear modulus of its core over `Material.mu_core`
    stiffness: FloatArray
    #: (m,), thickness of the cortex at the start
    thickness: FloatArray
    #: (m,) int32, the growth law
    label: IntArray
    #: (n,), nodes that stay in their sagittal plane
    held: NDArray[np.bool_]


def require_positive(volumes: FloatArray) -> None:
    """Raise InputError where a signed volume (m,) is not above 0: nothing else can then be said about the mesh."""
    if not volumes.min() > 0:
        worst, bad = int(np.argmin(volumes)), int((~(volumes > 0)).sum())
        raise InputError(
            f"{counted(bad, 'tetrahedron is', 'tetrahedra are')} flat or inverted before growth starts; "
            f"the worst is tetrahedron {worst}",
            remedy="mesh the surface again",
        )


def scale_of(mesh: TetMesh | TriSurface, hemisphere: str | None, *, reference: bool = False) -> Scale:
    """Unit of length and origin of a mesh, or of the inside of a closed surface, in RAS coordinates.

    They are about half the length of the brain, and its centre.

    The unit of a whole brain (`hemisphere` None) is the largest distance from its centroid along any axis. That of half
    a brain ("L" or "R") is the largest of half its length, its full width and half its height; the plane x = 0 touches
    its medial side. So the unit is the same as that of the whole (Wang et al. 2021).

    Parameters
    ----------
    reference : use the mean of the nodes as the centroid; it depends on where the mesh is fine
    """
    origin = mesh.points.mean(axis=0) if reference else _centroid(mesh)
    if hemisphere is None:
        return Scale(origin, float(np.abs(mesh.points - origin).max()))
    origin[0] = mesh.points[:, 0].max() if hemisphere == "L" else mesh.points[:, 0].min()
    return Scale(origin, float((np.ptp(mesh.points, axis=0) * [1, 0.5, 0.5]).max()))


def _centroid(mesh: TetMesh | TriSurface) -> FloatArray:
    """Centroid of the volume: (3,)."""
    if isinstance(mesh, TriSurface):
        return enclosed_centroid(mesh.points, mesh.faces)
    volumes = signed_volumes(mesh.points, mesh.cells)
    return np.asarray(volumes @ mesh.points[mesh.cells].mean(axis=1) / volumes.sum())


def body_of(
    mesh: TetMesh,
    scale: Scale,
    *,
    thickness: float = THICKNESS,
    mask: FloatArray | None = None,
    amount: FloatArray | None = None,
    labels: IntArray | None = None,
    held: NDArray[np.bool_] | None = None,
    reference: bool = False,
) -> Body:
    """The body of a mesh.

    If the mesh has interfaces (sets of faces `..._interface`), the cortex lies outside them, and grows perpendicular to
    the direction from them to the surface. Otherwise, the depth says what is cortex.

    Parameters
    ----------
    thickness : of the cortex at the start, dimensionless; point data `thickness` (mm) of the mesh replace it
    mask : (n,) 0 to 1, whether there is cortex next to the surface; None: everywhere
    amount : (n,), share of the tangential growth that each node takes part in; None: all of it
    labels : (n,) int32, growth law of each node; an element has that of its node nearest to the surface
    held : (n,), nodes that stay in their sagittal plane; None: no node
    reference : take the depth of an element from the distances to the nearest surface nodes (Wang et al. 2021). These
        distances are longer than the depth, and the more so the larger the cells are: with cells of 0.75 and 0.5 of the
        thickness, a brain of 22 weeks has 8 % and 4 % less cortex
    """
    points = (mesh.points - scale.origin) / scale.length
    cells = mesh.cells
    edges = points[cells[:, 1:]] - points[cells[:, :1]]
    volumes = np.linalg.det(edges) / 6
    require_positive(volumes)
    distance, nearest = nearest_surface_node(points, mesh)
    faces, cortex = boundary_faces(mesh), cortex_region(mesh, points)
    depth = distance if reference else closest_points(surface_tree(points, faces), points).distances
    normals = vertex_normals(points, faces)[nearest] if cortex is None else cortex.direction
    if (given := node_field(mesh, THICKNESS_FIELD)) is not None:
        node_thickness = given / scale.length
        if not node_thickness.min() > 0:
            raise InputError(
                f"the field {THICKNESS_FIELD} must be positive, but falls to {node_thickness.min() * scale.length:g} mm"
            )
    else:
        node_thickness = np.full(len(points), thickness)
    nearest_corner = depth[cells].argmin(axis=1)[:, None]
    node_label = np.zeros(len(points), np.int32) if labels is None else labels
    total = normals[cells].sum(axis=1)
    cell_thickness = node_thickness[cells].mean(axis=1)
    if cortex is not None:  # all of it grows as its surface does, and nothing else grows
        cell_thickness = np.where(cortex.cells, cortex.thickness[cells].mean(axis=1), cell_thickness)
        cell_depth = np.where(cortex.cells, 0.0, _NO_GROWTH * cell_thickness)
    elif reference:
        cell_depth = depth[cells].mean(axis=1)
    else:
        cell_depth = _mean_depth(depth[cells], cell_thickness, _PLACES)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return Body(
        cells=cells,
        gradients=np.ascontiguousarray(np.linalg.inv(edges).transpose(0, 2, 1)),
        volumes=volumes,
        normals=np.divide(total, length, out=np.zeros_like(total), where=length > 0),
        depth=cell_depth,
        mask=np.ones(len(cells)) if mask is None else mask[cells].mean(axis=1),
        amount=np.ones(len(cells)) if amount is None else amount[cells].mean(axis=1),
        stiffness=np.ones(len(cells)),
        thickness=cell_thickness,
        label=np.take_along_axis(node_label[cells], nearest_corner, axis=1)[:, 0].astype(np.int32),
        held=np.zeros(len(points), bool) if held is None else held,
    )


def nearest_surface_node(points: FloatArray, mesh: TetMesh) -> tuple[FloatArray, IntArray]:
    """The distance of each node to the nearest node of the surface, (n,), and that node, (n,)."""
    surface = boundary_nodes(mesh)
    distance, nearest = cKDTree(points[surface]).query(points)
    return distance, surface[nearest]


@numba.njit(cache=True, error_model="numpy")
def _mean_depth(depth, thickness, places):  # type: ignore[no-untyped-def]
    """Depth (m,) at which there is as much cortex as on average in elements with corners at depths (m, 4)."""
    found = np.empty(len(depth))
    for e in range(len(depth)):
        share = 0.0
        for place in places:
            share += growth_share((place * depth[e]).sum(), thickness[e], 1.0) / len(places)
        found[e] = depth_of_share(share, thickness[e])
    return found


def growth_mask(
    mesh: TetMesh, scale: Scale, wall: NDArray[np.bool_] | None = None, *, reference: bool = False
) -> FloatArray:
    """Share of the growth that each node takes part in: (n,) from 0 to 1.

    Point data `growth` of the mesh are used if there are any. Otherwise, the surface of half a brain grows outside its
    medial wall, fully from one cortical thickness off its rim. The surface of a whole brain grows outside a ball around
    its centre, where the corpus callosum is. Caps on holes of the file (`filled`) do not grow either. A node below the
    surface has the share of its nearest surface node.

    Parameters
    ----------
    wall : (n,), nodes of the medial wall; None: a whole brain
    reference : the share depends on the node's own position, outside an ellipsoid (Wang et al. 2021)
    """
    if (values := amount_of_growth(mesh)) is not None:
        return values
    if reference:
        x = (mesh.points - scale.origin) / scale.length
        inner, outer = _ELLIPSOID_RADII
        radius = np.linalg.norm((x - _ELLIPSOID_CENTRE) * _ELLIPSOID_AXES, axis=1)
        return np.clip((radius - inner) / (outer - inner), 0, 1)
    return default_mask(mesh, scale, wall)


def amount_of_growth(mesh: TetMesh) -> FloatArray | None:
    """The point data `growth` of a mesh, (n,) from 0 to 1; None if it has none."""
    if (values := node_field(mesh, MASK_FIELD)) is not None:
        if not (values.min() >= -_ROUNDING and values.max() <= 1 + _ROUNDING):
            raise InputError(
                f"the field {MASK_FIELD} has values from {values.min():.9g} to {values.max():.9g}, not 0 to 1",
                remedy="divide it by its largest value",
            )
        return np.clip(values, 0, 1)
    return None


def default_mask(mesh: TetMesh, scale: Scale, wall: NDArray[np.bool_] | None = None) -> FloatArray:
    """Whether there is cortex next to the surface, from the medial wall and caps alone: (n,) from 0 to 1."""
    x = (mesh.points - scale.origin) / scale.length
    nearest = nearest_surface_node(mesh.points, mesh)[1]
    surface = boundary_nodes(mesh)
    caps = node_field(mesh, FILLED)
    filled = surface[:0] if caps is None else surface[caps[surface] != 0]
    known = _away_from(x, filled, nearest)
    if wall is None:
        return np.minimum(known, np.clip((np.linalg.norm(x, axis=1)[nearest] - _CALLOSUM_RADIUS) / _CALLOSUM_RIM, 0, 1))
    return np.minimum(known, _away_from(x, np.flatnonzero(wall), nearest))


def _away_from(x: FloatArray, nodes: NDArray[np.integer], at: IntArray) -> FloatArray:
    """Distance of each of the nodes `at` to the nearest of `nodes`, in cortical thicknesses, at most 1: (n,)."""
    if not len(nodes):
        return np.ones(len(at))
    return np.clip(cKDTree(x[nodes]).query(x[at])[0] / THICKNESS, 0, 1)


class CortexRegion(NamedTuple):
    """The cortex of a body with n nodes and m tetrahedra; lengths in the unit of its points."""

    #: (m,), whether a tetrahedron is cortex
    cells: NDArray[np.bool_]
    #: (n,), distance between the two surfaces at each node: the sum of its distances to each of them
    thickness: FloatArray
    #: (n, 3), unit vectors from the interface to the outer surface
    direction: FloatArray


def with_interface(mesh: TetMesh) -> TetMesh:
    """The mesh with its interfaces as a set of faces, if its tetrahedra have numbers of regions."""
    if REGION not in mesh.cell_data or mesh.sets.cells or interface_faces(mesh) is not None:
        return mesh
    found = interfaces(mesh)
    if not len(found.faces):
        return mesh
    faces = {**mesh.sets.faces, f"region{INTERFACE}": found.faces}
    return replace(mesh, sets=MeshSets(mesh.sets.nodes, faces, mesh.sets.cells))


def interface_faces(mesh: TetMesh) -> IntArray | None:
    """All faces between regions: (k, 3); None if no set names any."""
    named = [faces for name, faces in mesh.sets.faces.items() if name.endswith(INTERFACE)]
    return np.concatenate(named) if named else None


def cortex_region(mesh: TetMesh, points: FloatArray) -> CortexRegion | None:
    """The region next to the boundary of a mesh with interfaces; None for a mesh without.

    Parameters
    ----------
    points : (n, 3), nodes of the mesh, in the unit of the lengths to return
    """
    faces = interface_faces(mesh)
    if faces is None:
        return None
    part = cut_components(mesh, faces)
    outer = boundary(mesh)
    cortex = np.isin(part, np.unique(part[outer.cells]))
    facing = faces[np.isin(faces, mesh.cells[cortex]).all(axis=1)]
    out, inside = (closest_points(surface_tree(points, some), points) for some in (outer.faces, facing))
    across = out.points - inside.points
    thickness = np.linalg.norm(across, axis=1)
    direction = across / np.maximum(thickness, np.finfo(float).tiny)[:, None]
    return CortexRegion(cortex, out.distances + inside.distances, direction)
