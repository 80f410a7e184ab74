"""Holes of a triangulated surface: their rims, and smooth caps on them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, diags, identity
from scipy.sparse.linalg import splu

from cortet.errors import InputError, place_mm
from cortet.geometry.mending import (
    REPLACED,
    Triangles,
    chosen_faces,
    edge_counts,
    faces_at,
    pieces,
    rings,
    split_fans,
    triangles,
)
from cortet.geometry.topology import TRI_EDGES, edges, enclosed_volume
from cortet.meshes import FloatArray, IntArray

#: rings of triangles around a hole that its cap joins smoothly
_AROUND = 3


def rims(faces: IntArray) -> list[IntArray]:
    """Vertices of the rim of each hole, in the direction in which a cap's triangles run; longest rim first.

    Parameters
    ----------
    faces : (m, 3), consistently oriented, each vertex with one fan of faces (`mending.split_fans`)
    """
    sides = faces[:, TRI_EDGES][edge_counts(faces) == 1]
    after = {int(end): int(start) for start, end in sides}
    found = []
    while after:
        first = min(after)
        rim, vertex = [first], after.pop(first)
        while vertex != first:
            rim.append(vertex)
            vertex = after.pop(vertex)
        found.append(np.array(rim, np.int32))
    return sorted(found, key=lambda rim: (-len(rim), int(rim[0])))


def rim_length(points: FloatArray, rim: IntArray) -> float:
    """Length of a rim, mm."""
    places = points[rim]
    return float(np.linalg.norm(places - np.roll(places, -1, axis=0), axis=1).sum())


def capped(work: Triangles, rim: IntArray, made: int) -> Triangles:
    """The triangles with one hole closed by a smooth cap, whose triangles are as large as those around it (CGAL).

    CGAL triangulates the hole with the least area and refines it; then the cap is `faired` (Liepa, Filling holes in
    meshes, SGP 2003). Given vertices stay where they are. CGAL's own fairing is not used: it numbers its unknowns by
    addresses in memory, so its bits differ from run to run.

    Parameters
    ----------
    rim : one of `rims`
    made : the value of the new faces in `Triangles.made`

    Raises
    ------
    InputError
        the `cgal` wheel is not installed, or finds no cap
    """
    try:
        from CGAL import CGAL_Polygon_mesh_processing as processing
    except ImportError:
        raise InputError(
            "filling a hole requires the Python package `cgal`, which is not installed",
            remedy="use Python 3.11 or 3.12, which `cgal` supports, or set repair.enabled: false",
        ) from None
    around, kept = _around(work, rim)
    polyhedron, items = _polyhedron(around)
    border = _border_between(items, kept, rim)
    faces: list[Any] = []
    vertices: list[Any] = []
    if border is not None:
        processing.triangulate_and_refine_hole(polyhedron, border, faces, vertices)
    if not faces:
        where = place_mm(work.points[rim].mean(axis=0))
        raise InputError(f"cannot fill the hole of {len(rim)} edges at {where}")
    count = len(around.points)
    number = np.concatenate([kept, len(work.points) + np.arange(len(vertices), dtype=np.int32)])
    for place, vertex in enumerate(vertices):
        vertex.set_id(count + place)
    new = np.array([_corners(face) for face in faces], np.int32)
    points = np.array([_place(vertex) for vertex in vertices], np.float64).reshape(-1, 3)
    local = np.concatenate([around.faces, new])
    free = np.arange(count, count + len(points))
    points = faired(np.concatenate([around.points, points]), local, free)
    return Triangles(
        np.concatenate([work.points, points]),
        np.concatenate([work.faces, number[new]]).astype(np.int32),
        np.concatenate([work.origin, np.full(len(points), -1, np.int32)]),
        np.concatenate([work.made, np.full(len(new), made, np.int8)]),
    )


def replaced(work: Triangles, vertices: IntArray, max_piece: float, flaw: str) -> Triangles:
    """The triangles without the faces at some vertices; the holes are closed smoothly.

    Parameters
    ----------
    max_piece : largest share of the area of a piece that comes loose and is dropped
    flaw : what is wrong with the faces at these vertices, for messages

    Raises
    ------
    InputError
        a larger piece would come loose, nothing would be left, or a hole cannot be filled
    """
    marked = np.zeros(len(work.points), np.bool_)
    marked[vertices] = True
    rest, _ = split_fans(chosen_faces(work, ~faces_at(work.faces, marked)))
    if not len(rest.faces):
        raise InputError(f"{flaw}; cutting them out would leave nothing of the surface")
    piece, area = pieces(rest)
    if len(area) > 1 and area[1] > max_piece * area.sum():
        where = place_mm(rest.points[rest.faces[piece == 1]].mean(axis=(0, 1)))
        share = f"{area[1] / area.sum():.1%} of the area"
        raise InputError(f"{flaw}; cutting them out would also cut off {share}, around {where}")
    rest = chosen_faces(rest, piece == 0)
    for rim in rims(rest.faces):
        rest = capped(rest, rim, REPLACED)
    return rest


def faired(points: FloatArray, faces: IntArray, free: NDArray[np.int64]) -> FloatArray:
    """Positions of the `free` vertices (f,) at which the surface bends least, without a kink at their rim: (f, 3) mm.

    The Laplacian of the Laplacian is zero at these positions; its weights are the inverse edge lengths (Liepa 2003).

    Parameters
    ----------
    points, faces : at least two rings of given triangles surround the free vertices
    """
    if not len(free):
        return np.zeros((0, 3))
    start, end = edges(faces).T
    weights = 1 / np.maximum(np.linalg.norm(points[start] - points[end], axis=1), np.finfo(np.float32).tiny)
    both = np.concatenate([start, end]), np.concatenate([end, start])
    link = coo_matrix((np.tile(weights, 2), both), shape=(len(points),) * 2).tocsr()
    total = np.asarray(link.sum(axis=1)).ravel()
    laplacian = (diags(1 / total) @ link - identity(len(points))).tocsr()
    rows = (laplacian[free] @ laplacian).tocsc()
    known = np.setdiff1d(np.arange(len(points)), free)
    solve = splu(rows[:, free])
    return np.ascontiguousarray(solve.solve(-(rows[:, known] @ points[known])))


def _around(work: Triangles, rim: IntArray) -> tuple[Triangles, IntArray]:
    """A few rings of triangles around a hole as their own manifold, and the number in `work` of each vertex."""
    marked = np.zeros(len(work.points), np.bool_)
    marked[rim] = True
    near = rings(work.faces, marked, _AROUND - 1)
    faces = work.faces[near[work.faces].any(axis=1)]
    used, local = np.unique(faces, return_inverse=True)
    part, _ = split_fans(triangles(work.points[used], local.reshape(-1, 3).astype(np.int32)))
    return part, used[part.origin].astype(np.int32)


def _polyhedron(work: Triangles) -> tuple[Any, list[Any]]:
    """CGAL's half-edge structure, whose vertices know their numbers, and its half-edges."""
    from CGAL import CGAL_Polygon_mesh_processing as processing
    from CGAL.CGAL_Kernel import Point_3
    from CGAL.CGAL_Polyhedron_3 import Polyhedron_3

    points, polygons, polyhedron = processing.Point_3_Vector(), processing.Polygon_Vector(), Polyhedron_3()
    for place in work.points.tolist():
        points.append(Point_3(*place))
    for face in work.faces.tolist():
        corners = processing.Int_Vector()
        for vertex in face:
            corners.append(vertex)
        polygons.append(corners)
    processing.polygon_soup_to_polygon_mesh(points, polygons, polyhedron)
    for number, vertex in enumerate(polyhedron.vertices()):
        vertex.set_id(number)
    return polyhedron, list(polyhedron.halfedges())


def _border_between(items: list[Any], kept: IntArray, rim: IntArray) -> Any:
    """The border half-edge between the first two vertices of a rim."""
    ends = {int(rim[0]), int(rim[1])}
    for item in items:
        if item.is_border() and {int(kept[item.vertex().id()]), int(kept[item.opposite().vertex().id()])} == ends:
            return item
    return None


def _corners(face: Any) -> list[int]:
    start = face.halfedge()
    return [start.vertex().id(), start.next().vertex().id(), start.next().next().vertex().id()]


def _place(vertex: Any) -> tuple[float, float, float]:
    point = vertex.point()
    return point.x(), point.y(), point.z()


def closed_volume(work: Triangles) -> float:
    """Signed volume, mm3, inside the triangles; fans from the middles of the rims close the holes."""
    points, faces = [work.points], [work.faces]
    count = len(work.points)
    for rim in rims(work.faces):
        points.append(work.points[rim].mean(axis=0)[None])
        faces.append(np.stack([rim, np.roll(rim, -1), np.full(len(rim), count, np.int32)], axis=1))
        count += 1
    return enclosed_volume(np.concatenate(points), np.concatenate(faces))
