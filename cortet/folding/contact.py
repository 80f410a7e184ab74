"""Contact of the surface with itself, of half a brain with the medial plane, and of crowns with an envelope.

A surface node that comes closer than `reach` to a triangle facing it is pushed away along the shortest line, in
proportion to how much of the reach is missing. A node that is already behind the triangle is pushed back to its front.
A uniform grid (all 27 cells around the node's own) lists the triangles that a node might meet, for a radius larger than
the reach. The list is complete until some node has moved by half the difference.

Two parts of the surface face each other when their normals point against each other. Triangles that share a vertex with
the triangles around a node are left out: they belong to the same fold.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from cortet.geometry.closest_point import on_triangle, triangle_normal
from cortet.geometry.topology import edges, face_normals, vertex_normals
from cortet.meshes import FloatArray, IntArray

#: in mean edges of the undeformed surface: distance where the force begins, and radius of the list (Wang et al. 2021)
REACH, RADIUS = 0.2, 0.6
#: force at distance 0, per squared mean edge, in units of the bulk modulus: that of the reference (Wang et al. 2021),
#: and one that holds what presses folds together, and allows steps that are longer by the root of their ratio
REFERENCE_PENALTY, PENALTY = 10.0, 2.0
#: the same for the envelope, one reach beyond it
SOFT = 0.3


class Contact(NamedTuple):
    """The surface of a body and what it might touch; s surface nodes, k triangles."""

    #: (s,) int32, nodes of the body
    nodes: IntArray
    #: (k, 3) int32, nodes of the body, outward
    faces: IntArray
    #: neighbours of surface node i along edges, as nodes of the body: ring[ring_offsets[i]:ring_offsets[i + 1]]
    ring_offsets: NDArray[np.int64]
    ring: IntArray
    #: triangles that surface node i might meet: candidates[offsets[i]:offsets[i + 1]]
    offsets: NDArray[np.int64]
    candidates: IntArray
    #: (s, 3), positions of the surface nodes when the list was made
    listed: FloatArray
    #: (n,), how stiff the contacts of a node are, at most 1: in proportion to its volume if that is less than usual
    weight: FloatArray
    #: distance at which the force begins, and largest force of one node
    reach: float
    strength: float
    #: the list holds triangles closer than this
    radius: float
    #: +1 or -1 keeps the body on that side of the medial plane; 0: no plane
    side: float
    #: distance of the plane from x = 0, away from the body, and force per depth behind it
    gap: float
    stiffness: float
    #: (p, 4), planes of the envelope at the start (`planes_of`), and force per depth beyond it
    planes: FloatArray
    softness: float
    #: (s,), the plane nearest to each surface node, or -1 without an envelope, and the size of the envelope when these
    #: planes were found
    plane: IntArray
    envelope: float
    #: per surface node: triangle in contact or -1, its weights (s, 3), force on the node (s, 3)
    touched: IntArray
    weights: FloatArray
    force: FloatArray


def contact_of(
    x: FloatArray,
    faces: IntArray,
    *,
    bulk: float,
    side: float = 0.0,
    gap: float = 0.0,
    volumes: FloatArray | None = None,
    penalty: float = PENALTY,
    plane: float | None = None,
    planes: FloatArray | None = None,
) -> Contact:
    """The contact of a body in its reference state, with its first list.

    Parameters
    ----------
    x : (n, 3) positions of all nodes
    faces : (k, 3) int32, boundary faces, outward
    bulk : modulus, the unit of the penalty
    side : +1 or -1 for half a brain that must stay on that side of the medial plane
    gap : distance of that plane from x = 0, away from the body
    volumes : (n,), around each node; None: all contacts are equally stiff
    penalty : force at distance 0, per squared mean edge, in units of the bulk modulus
    plane : the same at a depth of one reach behind the plane; None: `penalty`
    planes : (p, 4), planes of the envelope; None: no envelope
    """
    nodes = np.unique(faces).astype(np.int32)
    pairs = edges(faces)
    mean_edge = float(np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1).mean())
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    s = len(nodes)
    empty = Contact(
        nodes=nodes,
        faces=np.ascontiguousarray(faces, np.int32),
        ring_offsets=np.append(np.searchsorted(both[:, 0], nodes), len(both)),
        ring=np.ascontiguousarray(both[:, 1], np.int32),
        offsets=np.zeros(s + 1, np.int64),
        candidates=np.zeros(0, np.int32),
        listed=x[nodes],
        weight=np.ones(len(x)) if volumes is None else np.minimum(volumes / np.median(volumes[nodes]), 1),
        reach=REACH * mean_edge,
        strength=penalty * bulk * mean_edge**2,
        radius=RADIUS * mean_edge,
        side=float(side),
        gap=float(gap),
        stiffness=(penalty if plane is None else plane) * bulk * mean_edge / REACH,
        planes=np.zeros((0, 4)) if planes is None else planes,
        softness=SOFT * bulk * mean_edge / REACH,
        plane=np.full(s, -1, np.int32),
        envelope=1.0,
        touched=np.full(s, -1, np.int32),
        weights=np.zeros((s, 3)),
        force=np.zeros((s, 3)),
    )
    return listed_at(empty, x, 1.0)


def listed_at(contact: Contact, x: FloatArray, envelope: float) -> Contact:
    """The same contact with the list for positions x (n, 3) and a size of the envelope."""
    faces = contact.faces
    corners = x[faces]
    centroids = corners.mean(axis=1)
    # a triangle within the radius of a node has its centroid in one of the 27 cells around the node's
    size = contact.radius + float(np.linalg.norm(corners - centroids[:, None], axis=2).max())
    low = np.minimum(centroids.min(axis=0), x[contact.nodes].min(axis=0)) - size
    counts = ((np.maximum(centroids.max(axis=0), x[contact.nodes].max(axis=0)) - low) / size).astype(np.int64) + 2
    cell = ((centroids - low) / size).astype(np.int64)
    key = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    order = np.argsort(key, kind="stable").astype(np.int32)
    starts = np.zeros(counts.prod() + 1, np.int64)
    np.cumsum(np.bincount(key, minlength=len(starts) - 1), out=starts[1:])
    normals = face_normals(x, faces)
    grid = (low, size, counts, starts, order)
    node_normals = vertex_normals(x, faces)
    offsets = np.zeros(len(contact.nodes) + 1, np.int64)
    np.cumsum(_search(contact, x, normals, node_normals, grid, offsets, np.zeros(0, np.int32)), out=offsets[1:])
    candidates = np.empty(offsets[-1], np.int32)
    _search(contact, x, normals, node_normals, grid, offsets, candidates)
    listed = x[contact.nodes]
    _, plane = beyond(contact.planes, listed, envelope)
    return contact._replace(offsets=offsets, candidates=candidates, listed=listed, plane=plane, envelope=envelope)


@numba.njit(cache=True, error_model="numpy")
def _search(contact, x, normals, node_normals, grid, offsets, candidates):  # type: ignore[no-untyped-def]
    """Number of triangles within the radius of each surface node; also writes them unless `candidates` is empty."""
    low, size, counts, starts, order = grid
    found = np.zeros(len(contact.nodes), np.int64)
    for i in range(len(contact.nodes)):
        node = contact.nodes[i]
        p, n = x[node], node_normals[node]
        cx, cy, cz = int((p[0] - low[0]) / size), int((p[1] - low[1]) / size), int((p[2] - low[2]) / size)
        for ix in range(max(cx - 1, 0), min(cx + 2, counts[0])):
            for iy in range(max(cy - 1, 0), min(cy + 2, counts[1])):
                first = (ix * counts[1] + iy) * counts[2]
                for face in order[starts[first + max(cz - 1, 0)] : starts[first + min(cz + 2, counts[2])]]:
                    if n[0] * normals[face, 0] + n[1] * normals[face, 1] + n[2] * normals[face, 2] >= 0:
                        continue
                    corners = _corners(x, contact.faces, face)
                    a, b, c = on_triangle(corners, p[0], p[1], p[2])
                    distance2 = 0.0
                    for k in range(3):
                        distance2 += (p[k] - a * corners[k] - b * corners[k + 3] - c * corners[k + 6]) ** 2
                    if distance2 < contact.radius**2 and not _of_the_same_fold(contact, i, face):
                        if len(candidates):
                            candidates[offsets[i] + found[i]] = face
                        found[i] += 1
    return found


@numba.njit(cache=True, error_model="numpy")
def _of_the_same_fold(contact, i, face):  # type: ignore[no-untyped-def]
    """Whether a triangle has the surface node i, or a neighbour of it, as a corner."""
    for k in range(3):
        corner = contact.faces[face, k]
        if corner == contact.nodes[i]:
            return True
        for neighbour in contact.ring[contact.ring_offsets[i] : contact.ring_offsets[i + 1]]:
            if corner == neighbour:
                return True
    return False


@numba.njit(cache=True, error_model="numpy")
def _corners(x, faces, face):  # type: ignore[no-untyped-def]
    """The nine coordinates of a triangle."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    return x[a, 0], x[a, 1], x[a, 2], x[b, 0], x[b, 1], x[b, 2], x[c, 0], x[c, 1], x[c, 2]


@numba.njit(cache=True, error_model="numpy")
def moved_too_far(contact, x):  # type: ignore[no-untyped-def]
    """Whether some surface node has moved so far that the list may lack a contact."""
    limit = 0.5 * (contact.radius - contact.reach)
    for i in range(len(contact.nodes)):
        node, d = contact.nodes[i], 0.0
        for k in range(3):
            d += (x[node, k] - contact.listed[i, k]) ** 2
        if not d < limit**2:
            return True
    return False


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _touch_all(contact, x, nodes):  # type: ignore[no-untyped-def]
    for i in numba.prange(nodes):
        touch(contact, x, i)


@numba.njit(cache=True, error_model="numpy")
def touch(contact, x, i):  # type: ignore[no-untyped-def]
    """The triangle nearest to surface node i, if it is within reach, and the force it exerts on the node."""
    contact = Contact(*contact)  # Numba's parallel loops take no named tuples
    contact.touched[i] = -1
    if contact.offsets[i] == contact.offsets[i + 1]:
        return
    node = contact.nodes[i]
    p0, p1, p2 = x[node, 0], x[node, 1], x[node, 2]
    nearest2 = contact.reach**2
    for k in range(contact.offsets[i], contact.offsets[i + 1]):
        face = contact.candidates[k]
        corners = _corners(x, contact.faces, face)
        a, b, c = on_triangle(corners, p0, p1, p2)
        d0 = p0 - a * corners[0] - b * corners[3] - c * corners[6]
        d1 = p1 - a * corners[1] - b * corners[4] - c * corners[7]
        d2 = p2 - a * corners[2] - b * corners[5] - c * corners[8]
        distance2 = d0 * d0 + d1 * d1 + d2 * d2
        if not distance2 < nearest2:
            continue
        n0, n1, n2 = triangle_normal(corners)
        in_front = d0 * n0 + d1 * n1 + d2 * n2 > 0
        if not in_front and not (a > 0 and b > 0 and c > 0):
            continue  # beyond an edge: another triangle is nearer, or the node is outside
        nearest2 = distance2
        distance, weight = math.sqrt(distance2), contact.weight[node]
        for corner in contact.faces[face]:
            weight = min(weight, contact.weight[corner])
        size = weight * contact.strength * (1 - (distance if in_front else -distance) / contact.reach)
        if in_front and distance > 0:
            n0, n1, n2 = d0 / distance, d1 / distance, d2 / distance
        contact.touched[i] = face
        contact.weights[i, 0], contact.weights[i, 1], contact.weights[i, 2] = a, b, c
        contact.force[i, 0], contact.force[i, 1], contact.force[i, 2] = size * n0, size * n1, size * n2


@numba.njit(cache=True, error_model="numpy")
def contact_forces(contact, x, external, envelope):  # type: ignore[no-untyped-def]
    """Set the contact forces of all surface nodes in `external` (n, 3); return the number of nodes in contact."""
    for node in contact.nodes:
        external[node] = 0
    _touch_all(tuple(contact), x, len(contact.nodes))
    count = 0
    for i in range(len(contact.nodes)):  # in order, because several nodes may push a triangle's corners
        face = contact.touched[i]
        if face >= 0:
            count += 1
            for k in range(3):
                external[contact.nodes[i], k] += contact.force[i, k]
                for j in range(3):
                    external[contact.faces[face, j], k] -= contact.weights[i, j] * contact.force[i, k]
    if contact.side != 0:
        count += _against_plane(contact, x, external)
    if len(contact.planes) > 0:
        _against_envelope(contact, x, external, envelope)
    return count


@numba.njit(cache=True, error_model="numpy")
def _against_plane(contact, x, external):  # type: ignore[no-untyped-def]
    """Push nodes beyond the medial plane back; the force per depth is that of a contact."""
    count = 0
    for node in contact.nodes:
        depth = -contact.side * x[node, 0] - contact.gap
        if depth > 0:
            external[node, 0] += contact.weight[node] * (contact.side * contact.stiffness * depth)
            count += 1
    return count


@numba.njit(cache=True, error_model="numpy")
def _against_envelope(contact, x, external, envelope):  # type: ignore[no-untyped-def]
    """Push nodes back that are beyond an envelope of a size, by the planes nearest when contacts were listed."""
    for i in range(len(contact.nodes)):
        node, plane = contact.nodes[i], contact.plane[i]
        a, b, c = contact.planes[plane, 0], contact.planes[plane, 1], contact.planes[plane, 2]
        depth = a * x[node, 0] + b * x[node, 1] + c * x[node, 2] + envelope * contact.planes[plane, 3]
        push = -contact.softness * max(depth, 0.0)
        external[node, 0] += push * a
        external[node, 1] += push * b
        external[node, 2] += push * c


# --- the envelope ----------------------------------------------------------------------------------------------------


def planes_of(hull: ConvexHull) -> FloatArray:
    """The distinct planes of a convex hull: (p, 4), outward unit normal n and offset o; n x + o < 0 is inside."""
    return np.unique(hull.equations, axis=0)  # the hull has one plane per triangle, and a flat side has many triangles


@numba.njit(cache=True, error_model="numpy")
def beyond(planes: FloatArray, points: FloatArray, size: float = 1.0) -> tuple[FloatArray, NDArray[np.int32]]:
    """How far points lie beyond the planes of a hull: the largest distance of each point, and its plane.

    Parameters
    ----------
    planes : (p, 4), `planes_of`
    points : (n, 3)
    size : factor by which the hull is scaled about the origin

    Returns
    -------
    distance (n,), negative inside; plane (n,)
    """
    distance, plane = np.full(len(points), -np.inf), np.full(len(points), -1, np.int32)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(len(planes)):
            d = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z + size * planes[k, 3]
            if d > distance[i]:
                distance[i], plane[i] = d, k
    return distance, plane
