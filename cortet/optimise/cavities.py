"""Cavities of a tetrahedral mesh: the tetrahedra around an edge, their best refilling, and its insertion in the mesh.

Swaps and insertions share this compiled code. Tetrahedra are in arrays with spare rows; a dead row has -1 as its
first vertex.
"""

from __future__ import annotations

import numba
import numpy as np

#: largest number of tetrahedra tried around an edge; for more, a better filling is rarely found
MAX_RING = 10


MAX_NEW = 2 * (MAX_RING - 1)


#: most tetrahedra of a star that is searched
MAX_STAR = 512


#: corners (a, b, c, d) of a positive tetrahedron for each of its edges (a, b)
EDGE_FRAMES = np.array([[0, 1, 2, 3], [0, 2, 3, 1], [0, 3, 1, 2], [1, 2, 0, 3], [1, 3, 2, 0], [2, 3, 0, 1]])


@numba.njit(cache=True, error_model="numpy")
def mu2_at(points, a, b, c, d):  # type: ignore[no-untyped-def]
    """mu^2 of a tetrahedron, infinite unless its volume is positive."""
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    wx, wy, wz = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1], points[d, 2] - points[a, 2]
    v6 = ux * (vy * wz - vz * wy) + uy * (vz * wx - vx * wz) + uz * (vx * wy - vy * wx)
    if v6 <= 0:
        return np.inf
    uu, vv, ww = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
    uv, vw, wu = ux * vx + uy * vy + uz * vz, vx * wx + vy * wy + vz * wz, wx * ux + wy * uy + wz * uz
    s = (3 * (uu + vv + ww) - 2 * (uv + vw + wu)) / 6
    return s * s * s / (2 * v6 * v6)


@numba.njit(cache=True, error_model="numpy")
def corner_of(cells, e, vertex):  # type: ignore[no-untyped-def]
    """The index of the corner of tetrahedron e that is `vertex`, -1 if none."""
    for i in range(4):
        if cells[e, i] == vertex:
            return i
    return -1


@numba.njit(cache=True, error_model="numpy")
def fourth(cells, e, a, b, c):  # type: ignore[no-untyped-def]
    """The vertex of tetrahedron e that is none of a, b, c."""
    for i in range(4):
        vertex = cells[e, i]
        if vertex != a and vertex != b and vertex != c:
            return vertex
    return -1


@numba.njit(cache=True, error_model="numpy")
def ring_around(mesh, e, frame, ring, cavity):  # type: ignore[no-untyped-def]
    """Walk around edge (a, b) of tetrahedron e.

    Fills `ring` with the opposite vertices, counter-clockwise seen from b, and `cavity` with the tetrahedra
    (a, b, ring[i], ring[i + 1]). Returns a, b, number of vertices, number of tetrahedra. The two numbers are equal for
    an interior edge; a boundary edge has one vertex more. Both are zero if there are too many or regions differ.
    """
    cells, neighbours = mesh.cells, mesh.neighbours
    a, b, c, d = cells[e, frame[0]], cells[e, frame[1]], cells[e, frame[2]], cells[e, frame[3]]
    # walk backwards first, to find the open end of a boundary ring
    start, before = e, c
    ahead = d
    while True:
        f = neighbours[start, corner_of(cells, start, ahead)]
        if f < 0 or f == e:
            break
        ahead = before
        before = fourth(cells, f, a, b, ahead)
        start = f
    closed = f == e
    if closed:
        start, before, ahead = e, c, d
    size = 0
    f = start
    ring[0] = before
    while True:
        if size == MAX_RING or mesh.region[f] != mesh.region[e]:
            return a, b, 0, 0
        cavity[size] = f
        size += 1
        ring[size] = ahead
        f = neighbours[f, corner_of(cells, f, before)]
        if f < 0 or f == start:
            break
        before = ahead
        ahead = fourth(cells, f, a, b, before)
    return a, b, size if closed else size + 1, size


@numba.njit(cache=True, error_model="numpy")
def ring_of_two(mesh, e, frame, ring, cavity):  # type: ignore[no-untyped-def]
    """Walk around an edge of tetrahedron e that lies on the interface of two regions.

    As `ring_around`, but ring[0] is where the region of e begins, and the ring ends with ring[0] again. Returns the
    number of tetrahedra in that region and in both. Both are zero if there are too many, only one region, more than
    two, or if the edge is on the boundary.
    """
    cells, neighbours, region = mesh.cells, mesh.neighbours, mesh.region
    a, b, before, ahead = cells[e, frame[0]], cells[e, frame[1]], cells[e, frame[2]], cells[e, frame[3]]
    start = e
    while True:
        f = neighbours[start, corner_of(cells, start, ahead)]
        if f < 0 or f == e:
            return 0, 0
        if region[f] != region[e]:
            break
        ahead = before
        before = fourth(cells, f, a, b, ahead)
        start = f
    size, first = 0, 0
    f = start
    ring[0] = before
    while True:
        if size == MAX_RING:
            return 0, 0
        if first == 0 and region[f] != region[e]:
            first = size
            other = region[f]
        if first > 0 and region[f] != other:
            return 0, 0
        cavity[size] = f
        size += 1
        ring[size] = ahead
        f = neighbours[f, corner_of(cells, f, before)]
        if f < 0:
            return 0, 0
        if f == start:
            return first, size
        before = ahead
        ahead = fourth(cells, f, a, b, before)


@numba.njit(cache=True, error_model="numpy")
def best_filling(points, a, b, ring, n, limit, cost, split):  # type: ignore[no-untyped-def]
    """Best triangulation of the polygon ring[0..n-1], each triangle joined to a and to b. Returns its worst mu^2.

    cost[i, j] is the worst mu^2 of the best filling of the sub-polygon i..j; split[i, j] is the third vertex of the
    triangle at the side (i, j). A triangle worse than `limit` counts as infinite.
    """
    for i in range(n - 1):
        cost[i, i + 1] = 0.0
    for width in range(2, n):
        for i in range(n - width):
            j = i + width
            best, third = np.inf, i + 1
            for k in range(i + 1, j):
                worst = max(cost[i, k], cost[k, j])
                if worst >= best:
                    continue
                worst = max(worst, mu2_at(points, ring[i], ring[k], ring[j], b))
                if worst >= min(best, limit):
                    continue
                worst = max(worst, mu2_at(points, ring[i], ring[j], ring[k], a))
                if worst < best:
                    best, third = worst, k
            cost[i, j], split[i, j] = best, third
    return cost[0, n - 1]


@numba.njit(cache=True, error_model="numpy")
def filled_with(a, b, ring, n, split, new):  # type: ignore[no-untyped-def]
    """Write the tetrahedra of the triangulation in `split` to `new`; return their number."""
    stack = np.empty((MAX_RING + 1, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, n - 1
    top, size = 1, 0
    while top:
        top -= 1
        i, j = stack[top]
        if j - i < 2:
            continue
        k = split[i, j]
        new[size, 0], new[size, 1], new[size, 2], new[size, 3] = ring[i], ring[k], ring[j], b
        new[size + 1, 0], new[size + 1, 1], new[size + 1, 2], new[size + 1, 3] = ring[i], ring[j], ring[k], a
        size += 2
        stack[top, 0], stack[top, 1] = i, k
        stack[top + 1, 0], stack[top + 1, 1] = k, j
        top += 2
    return size


@numba.njit(cache=True, error_model="numpy")
def _same_face(cells, e, i, f, j):  # type: ignore[no-untyped-def]
    """Whether the face of e opposite corner i has the vertices of the face of f opposite corner j."""
    for k in range(4):
        if k != i:
            corner = corner_of(cells, f, cells[e, k])
            if corner < 0 or corner == j:
                return False
    return True


@numba.njit(cache=True, error_model="numpy")
def replace_cells(mesh, cavity, old, new, size):  # type: ignore[no-untyped-def]
    """Replace tetrahedra cavity[:old] by new[:size], and write the rows of the new ones to cavity[:size].

    Outer faces of the cavity keep their neighbours. If no new tetrahedron has such a face, its neighbour gets a
    boundary face there.
    """
    cells, neighbours, counters = mesh.cells, mesh.neighbours, mesh.counters
    outside = np.empty((4 * old, 4), np.int32)  # three vertices of an outer face, and its neighbour outside
    outer = 0
    for i in range(old):
        e = cavity[i]
        for corner in range(4):
            f = neighbours[e, corner]
            inside = False
            for j in range(old):
                inside |= f == cavity[j]
            if not inside:
                k = 0
                for other in range(4):
                    if other != corner:
                        outside[outer, k] = cells[e, other]
                        k += 1
                outside[outer, 3] = f
                if f >= 0:  # forget the cavity; a new tetrahedron may become the neighbour below
                    for back in range(4):
                        if neighbours[f, back] == e:
                            neighbours[f, back] = -1
                outer += 1
    origin, region = mesh.origin[cavity[0]], mesh.region[cavity[0]]
    for i in range(old):
        mesh.cells[cavity[i], 0] = -1
        mesh.mu2[cavity[i]] = 0.0
        mesh.dead[counters[1]] = cavity[i]
        counters[1] += 1
    for i in range(size):
        if counters[1]:
            counters[1] -= 1
            e = mesh.dead[counters[1]]
        else:
            e = counters[0]
            counters[0] += 1
        cavity[i] = e
        for k in range(4):
            cells[e, k] = new[i, k]
            neighbours[e, k] = -1
        mesh.mu2[e] = mu2_at(mesh.points, new[i, 0], new[i, 1], new[i, 2], new[i, 3])
        mesh.origin[e], mesh.region[e] = origin, region
    for i in range(size):
        e = cavity[i]
        for corner in range(4):
            if neighbours[e, corner] >= 0:
                continue
            for j in range(i + 1, size):
                for back in range(4):
                    if neighbours[cavity[j], back] < 0 and _same_face(cells, e, corner, cavity[j], back):
                        neighbours[e, corner], neighbours[cavity[j], back] = cavity[j], e
            if neighbours[e, corner] >= 0:
                continue
            for o in range(outer):
                matched = 0
                for k in range(3):
                    other = corner_of(cells, e, outside[o, k])
                    matched += other >= 0 and other != corner
                f = outside[o, 3]
                if matched == 3 and f >= 0:
                    neighbours[e, corner] = f
                    for back in range(4):
                        if neighbours[f, back] < 0 and _same_face(cells, e, corner, f, back):
                            neighbours[f, back] = e


@numba.njit(cache=True, error_model="numpy")
def star_of(mesh, e, a, star):  # type: ignore[no-untyped-def]
    """Write the tetrahedra around vertex a, a corner of e, to `star`; return their number, 0 if there are too many."""
    star[0], size, done = e, 1, 0
    while done < size:
        f = star[done]
        done += 1
        for i in range(4):
            g = mesh.neighbours[f, i]
            if g < 0 or mesh.cells[f, i] == a:
                continue
            known = False
            for j in range(size):
                known |= star[j] == g
            if not known:
                if size == len(star):
                    return 0
                star[size] = g
                size += 1
    return size


@numba.njit(cache=True, error_model="numpy")
def share_an_edge(mesh, e, a, b):  # type: ignore[no-untyped-def]
    """Whether vertex a, a corner of tetrahedron e, shares an edge with vertex b; also True if its star is too large."""
    star = np.empty(MAX_STAR, np.int32)
    size = star_of(mesh, e, a, star)
    for f in star[:size]:
        if corner_of(mesh.cells, f, b) >= 0:
            return True
    return size == 0


# scalars throughout: a small array for each difference takes longer than the arithmetic
@numba.njit(cache=True, error_model="numpy")
def unit_normal(a, b, c):  # type: ignore[no-untyped-def]
    """Unit normal of triangle a, b, c: x, y, z. The corners are counter-clockwise seen from its tip; NaN if flat."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length
