"""Local operations on a closed triangulated surface that must stay near another one: the compiled part of `remesh`.

Edges are split, collapsed and flipped and vertices moved, and each of these is refused when it would take the
triangles away from the given surface. For this, sample points of the given surface (its vertices and the centres of its
faces) are attached to the nearest triangle around the operation. After each operation every sample around it must be
within its own limit of a triangle, and on average within a lower one. So nothing of the surface is lost, whatever the
edge length: a narrow sulcus that is filled, or a thin blade that is cut off, leaves samples behind.

The idea of attached samples is that of Hu et al., Error-bounded and feature preserving surface remeshing with minimal
angle improvement, TVCG 2017; the operations are those of Botsch and Kobbelt, SGP 2004.

Half-edge 3 f + i runs from corner i of face f to corner i + 1. A dead face has -1 as its first corner, a dead vertex -1
as its half-edge.
"""
# Numba's compiled functions take the named tuple as it is; nothing here runs in parallel, so bits do not depend on
# the number of threads.

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.geometry.closest_point import closest_point, on_triangle, triangle_normal
from cortet.mesh import FloatArray, IntArray

#: triangles around an operation that are looked at; with more, it is refused
_MOST_FACES = 64
#: an edge is split or collapsed when it is longer or shorter than these multiples of the target (Botsch and Kobbelt)
LONG, SHORT = 4 / 3, 4 / 5
#: the normal of a triangle may turn by less than acos(this) in one operation
_MIN_COSINE = 0.3
#: shape of a triangle below which it is nearly flat: its normal says nothing, and TetGen may fail on it
FLAT = 0.05
#: shape of a triangle below which it may be mended at the cost of some distance
POOR = 0.7
#: a smoothing step that is refused is tried again at half the length
_SMOOTHING_TRIES = 2
#: a vertex keeps so many neighbours: with three, one flat tetrahedron fills the corner, wherever vertices go
_LEAST_VALENCE = 4
#: a flip must not make the shape of the worse of its two triangles worse than this, nor halve it
_MIN_SHAPE = 0.3


class Work(NamedTuple):
    """A surface that is being remeshed, in arrays with room to grow, and the samples attached to its faces."""

    #: (n, 3) float64 mm
    points: FloatArray
    #: (n,) int32, triangle of the given surface (in tree order) that each vertex lies on
    place: IntArray
    #: (n,) float64 mm, target edge length
    size: FloatArray
    #: (n,) int32, a half-edge that leaves the vertex
    leaving: IntArray
    #: (m, 3) int32
    faces: IntArray
    #: (3 m,) int32, the same edge in the other direction
    opposite: IntArray
    #: (m,) int32, the first sample of each face, and (s,) int32, the one after each sample; -1 ends a list
    first: IntArray
    after: IntArray
    #: (s, 3) float64 mm, samples of the given surface
    samples: FloatArray
    #: (s,) float64 mm2, squared distance of each to its face, and the limit of it
    distance2: FloatArray
    limit2: FloatArray
    #: (2,) int64: vertices and faces in use, dead ones included
    used: NDArray[np.int64]


class Scratch(NamedTuple):
    """What an operation writes down before it is made."""

    #: faces whose samples are looked at, and the triangles (9 coordinates) that take their place
    old: IntArray
    new: FloatArray
    #: samples of the old faces, the new triangle each is nearest to, and the squared distance
    sample: IntArray
    nearest: IntArray
    distance2: FloatArray


class Limits(NamedTuple):
    """Mean squared distances (mm2) of the samples around an operation."""

    #: up to this an operation is made without asking whether another would be closer
    free: float
    #: above this it is refused
    most: float


def scratch(samples: int) -> Scratch:
    """Room for operations on a surface with so many samples."""
    return Scratch(
        np.empty(_MOST_FACES, np.int32),
        np.empty((_MOST_FACES, 9)),
        np.empty(samples, np.int32),
        np.empty(samples, np.int32),
        np.empty(samples),
    )


@numba.njit(cache=True, inline="always")
def _next(h):  # type: ignore[no-untyped-def]
    return h - 2 if h % 3 == 2 else h + 1


@numba.njit(cache=True, inline="always")
def _previous(h):  # type: ignore[no-untyped-def]
    return h + 2 if h % 3 == 0 else h - 1


@numba.njit(cache=True, inline="always")
def _origin(w, h):  # type: ignore[no-untyped-def]
    return w.faces[h // 3, h % 3]


@numba.njit(cache=True)
def link(faces, opposite, leaving):  # type: ignore[no-untyped-def]
    """Fill `opposite` and `leaving` for the faces (m, 3) of a closed, oriented manifold."""
    m, n = len(faces), len(leaving)
    count = np.zeros(n + 1, np.int64)
    for f in range(m):
        for i in range(3):
            count[faces[f, i] + 1] += 1
            leaving[faces[f, i]] = 3 * f + i
    for v in range(n):
        count[v + 1] += count[v]
    at = count[:-1].copy()
    halfedge = np.empty(3 * m, np.int32)
    for h in range(3 * m):
        v = faces[h // 3, h % 3]
        halfedge[at[v]] = h
        at[v] += 1
    for h in range(3 * m):
        a, b = faces[h // 3, h % 3], faces[h // 3, (h % 3 + 1) % 3]
        for k in range(count[b], count[b + 1]):
            g = halfedge[k]
            if faces[g // 3, (g % 3 + 1) % 3] == a:
                opposite[h] = g


@numba.njit(cache=True)
def _length(w, a, b):  # type: ignore[no-untyped-def]
    dx, dy, dz = w.points[a, 0] - w.points[b, 0], w.points[a, 1] - w.points[b, 1], w.points[a, 2] - w.points[b, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True)
def _corners(w, f, moved, x, y, z, row):  # type: ignore[no-untyped-def]
    """Coordinates of face f, with vertex `moved` at (x, y, z)."""
    for i in range(3):
        v = w.faces[f, i]
        if v == moved:
            row[3 * i], row[3 * i + 1], row[3 * i + 2] = x, y, z
        else:
            row[3 * i], row[3 * i + 1], row[3 * i + 2] = w.points[v, 0], w.points[v, 1], w.points[v, 2]


@numba.njit(cache=True)
def _set_corner(row, i, points, v):  # type: ignore[no-untyped-def]
    row[3 * i], row[3 * i + 1], row[3 * i + 2] = points[v, 0], points[v, 1], points[v, 2]


@numba.njit(cache=True)
def _cross(c):  # type: ignore[no-untyped-def]
    """Normal of a triangle (9 coordinates), of length twice its area."""
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@numba.njit(cache=True)
def _turned(new, old):  # type: ignore[no-untyped-def]
    """Whether the normal of a triangle has turned too far; a nearly flat old one has no direction to turn from."""
    if not _shape(old) > FLAT:
        return False
    mx, my, mz = _cross(old)
    nx, ny, nz = _cross(new)
    was, now = mx * mx + my * my + mz * mz, nx * nx + ny * ny + nz * nz
    return not (nx * mx + ny * my + nz * mz > _MIN_COSINE * np.sqrt(was * now))


@numba.njit(cache=True)
def _shape(c):  # type: ignore[no-untyped-def]
    """4 sqrt(3) area over the sum of squared edges: 1 for the equilateral triangle, 0 for a flat one."""
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    nx, ny, nz = _cross(c)
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    squares = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz + wx * wx + wy * wy + wz * wz
    return 2 * np.sqrt(3.0) * np.sqrt(nx * nx + ny * ny + nz * nz) / squares if squares > 0 else 0.0


@numba.njit(cache=True)
def _measure(w, s, olds, news, most):  # type: ignore[no-untyped-def]
    """Find the new triangle nearest to each sample of the old faces.

    Returns the number of samples and the sum of squared distances, infinite when one is beyond its limit or the mean
    is above `most` and above what it was.
    """
    count, total, before = 0, 0.0, 0.0
    for k in range(olds):
        i = w.first[s.old[k]]
        while i >= 0:
            x, y, z = w.samples[i, 0], w.samples[i, 1], w.samples[i, 2]
            best, nearest = np.inf, -1
            for j in range(news):
                c = s.new[j]
                u, v, t = on_triangle(c, x, y, z)
                dx = u * c[0] + v * c[3] + t * c[6] - x
                dy = u * c[1] + v * c[4] + t * c[7] - y
                dz = u * c[2] + v * c[5] + t * c[8] - z
                d = dx * dx + dy * dy + dz * dz
                if d < best:
                    best, nearest = d, j
            if best > w.limit2[i]:
                return count, np.inf
            s.sample[count], s.nearest[count], s.distance2[count] = i, nearest, best
            total += best
            before += w.distance2[i]
            count += 1
            i = w.after[i]
    if total > max(before, most * count):
        return count, np.inf
    return count, total


@numba.njit(cache=True)
def _attach(w, s, olds, count, face_of):  # type: ignore[no-untyped-def]
    """Hand the samples that were measured to the faces that `face_of` names for the new triangles."""
    for k in range(olds):
        w.first[s.old[k]] = -1
    for k in range(count):
        i, f = s.sample[k], face_of[s.nearest[k]]
        w.distance2[i] = s.distance2[k]
        w.after[i] = w.first[f]
        w.first[f] = i


@numba.njit(cache=True)
def _onto_surface(tree, x, y, z, hint, nx, ny, nz):  # type: ignore[no-untyped-def]
    """Nearest point of the surface and its triangle; triangle -1 where it lies on the opposite bank of n."""
    px, py, pz, place, _, _, _ = closest_point(tree, x, y, z, hint)
    mx, my, mz = triangle_normal(tree.corners[place])
    if not nx * mx + ny * my + nz * mz > 0:
        place = -1
    return px, py, pz, place


@numba.njit(cache=True)
def _normal(w, f):  # type: ignore[no-untyped-def]
    """Normal of face f, of length twice its area."""
    a, b, c = w.points[w.faces[f, 0]], w.points[w.faces[f, 1]], w.points[w.faces[f, 2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@numba.njit(cache=True)
def _valence(w, v):  # type: ignore[no-untyped-def]
    h = w.leaving[v]
    count = 0
    while True:
        count += 1
        h = w.opposite[_previous(h)]
        if h == w.leaving[v]:
            return count


@numba.njit(cache=True)
def _joined(w, a, b):  # type: ignore[no-untyped-def]
    """Whether an edge joins two vertices."""
    h = w.leaving[a]
    while True:
        if _origin(w, _next(h)) == b:
            return True
        h = w.opposite[_previous(h)]
        if h == w.leaving[a]:
            return False


@numba.njit(cache=True)
def _pair(w, h, g):  # type: ignore[no-untyped-def]
    w.opposite[h] = g
    w.opposite[g] = h


@numba.njit(cache=True)
def split_long(w, tree, s, limits):  # type: ignore[no-untyped-def]
    """Split the edges longer than 4/3 of the target; returns the number of splits, -1 if there was no room for all."""
    done = 0
    face_of = np.empty(4, np.int64)
    for h in range(3 * w.used[1]):
        f = h // 3
        if w.faces[f, 0] < 0:
            continue
        g = w.opposite[h]
        a, b = _origin(w, h), _origin(w, g)
        if g < h or _length(w, a, b) <= LONG * min(w.size[a], w.size[b]):
            continue
        if w.used[0] + 1 > len(w.points) or w.used[1] + 2 > len(w.faces):
            return -1
        k = g // 3
        n, m = _normal(w, f), _normal(w, k)
        middle = 0.5 * (w.points[a] + w.points[b])
        px, py, pz, place = _onto_surface(
            tree, middle[0], middle[1], middle[2], w.place[a], n[0] + m[0], n[1] + m[1], n[2] + m[2]
        )
        if place < 0:
            continue
        c, d = _origin(w, _previous(h)), _origin(w, _previous(g))
        s.old[0], s.old[1] = f, k
        for row, first, second in ((0, a, c), (1, c, b), (2, b, d), (3, d, a)):
            s.new[row, 0], s.new[row, 1], s.new[row, 2] = px, py, pz
            _set_corner(s.new[row], 1, w.points, second)
            _set_corner(s.new[row], 2, w.points, first)
        one, two = _face_row(w, f), _face_row(w, k)
        if _turned(s.new[0], one) or _turned(s.new[1], one) or _turned(s.new[2], two) or _turned(s.new[3], two):
            continue
        count, total = _measure(w, s, 2, 4, limits.most)
        if total == np.inf:
            continue
        v, p, q = w.used[0], w.used[1], w.used[1] + 1
        w.used[0] += 1
        w.used[1] += 2
        w.points[v, 0], w.points[v, 1], w.points[v, 2] = px, py, pz
        w.place[v], w.size[v] = place, min(w.size[a], w.size[b])
        bc, da = _next(h), _next(g)  # half-edges b -> c and a -> d
        behind_bc, behind_ad = w.opposite[bc], w.opposite[da]
        i, j = h % 3, g % 3
        # f = (a, b, c) becomes (a, v, c), k = (b, a, d) becomes (b, v, d); p = (v, b, c), q = (v, a, d)
        w.faces[f, (i + 1) % 3] = v
        w.faces[k, (j + 1) % 3] = v
        w.faces[p, 0], w.faces[p, 1], w.faces[p, 2] = v, b, c
        w.faces[q, 0], w.faces[q, 1], w.faces[q, 2] = v, a, d
        _pair(w, 3 * p + 1, behind_bc)
        _pair(w, 3 * q + 1, behind_ad)
        _pair(w, 3 * p + 2, bc)
        _pair(w, 3 * q + 2, da)
        _pair(w, h, 3 * q)
        _pair(w, g, 3 * p)
        w.leaving[v], w.leaving[a], w.leaving[b] = 3 * p, h, g
        w.leaving[c], w.leaving[d] = 3 * p + 2, 3 * q + 2
        w.first[p] = w.first[q] = -1
        face_of[0], face_of[1], face_of[2], face_of[3] = f, p, k, q
        _attach(w, s, 2, count, face_of)
        done += 1
    return done


@numba.njit(cache=True)
def _face_row(w, f):  # type: ignore[no-untyped-def]
    row = np.empty(9)
    _corners(w, f, -1, 0.0, 0.0, 0.0, row)
    return row


@numba.njit(cache=True)
def _collapsed(w, s, a, b, x, y, z, first, second):  # type: ignore[no-untyped-def]
    """Write down what collapsing a and b into (x, y, z) changes; `first` and `second` are the faces that vanish.

    The faces that vanish come first among the old ones. Returns the number of old faces, 0 where the collapse turns a
    triangle over, makes an edge too long, or has too many faces around it.
    """
    s.old[0], s.old[1] = first, second
    olds = 2
    row = np.empty(9)
    longest = LONG * min(w.size[a], w.size[b])
    for end in range(2):
        v = a if end == 0 else b
        h = w.leaving[v]
        while True:
            f = h // 3
            if f != first and f != second:
                if olds == _MOST_FACES:
                    return 0
                c = _origin(w, _next(h))
                dx, dy, dz = w.points[c, 0] - x, w.points[c, 1] - y, w.points[c, 2] - z
                if dx * dx + dy * dy + dz * dz > longest * longest:
                    return 0
                _corners(w, f, v, x, y, z, s.new[olds - 2])
                _corners(w, f, -1, x, y, z, row)
                if _turned(s.new[olds - 2], row):
                    return 0
                s.old[olds] = f
                olds += 1
            h = w.opposite[_previous(h)]
            if h == w.leaving[v]:
                break
    return olds


@numba.njit(cache=True)
def _may_collapse(w, h):  # type: ignore[no-untyped-def]
    """Whether collapsing half-edge h leaves a manifold: its ends share two neighbours, and all keep enough faces."""
    a, b = _origin(w, h), _origin(w, w.opposite[h])
    c, d = _origin(w, _previous(h)), _origin(w, _previous(w.opposite[h]))
    if min(_valence(w, c), _valence(w, d), _valence(w, a) + _valence(w, b) - 3) <= _LEAST_VALENCE:
        return False
    shared = 0
    g = w.leaving[a]
    while True:
        if _joined(w, b, _origin(w, _next(g))):
            shared += 1
        g = w.opposite[_previous(g)]
        if g == w.leaving[a]:
            return shared == 2


@numba.njit(cache=True)
def collapse_short(w, tree, s, limits, floor):  # type: ignore[no-untyped-def]
    """Collapse the edges shorter than 4/5 of the target, and vertices of three faces; returns the number of collapses.

    Where one is refused because it would leave the surface, the target becomes the length there is, but not less than
    `floor` (mm), so that the triangles around are graded towards it. An edge shorter than that stays only where a
    sample would be beyond its own limit.
    """
    done = 0
    face_of = np.empty(_MOST_FACES, np.int64)
    places = np.empty((3, 3))
    place = np.empty(3, np.int64)
    for h in range(3 * w.used[1]):
        if w.faces[h // 3, 0] < 0 or w.opposite[h] < h:
            continue
        a, b = _origin(w, h), _origin(w, w.opposite[h])
        length = _length(w, a, b)
        pointed = min(_valence(w, a), _valence(w, b)) < _LEAST_VALENCE
        if (length >= SHORT * min(w.size[a], w.size[b]) and not pointed) or not _may_collapse(w, h):
            continue
        f, k = h // 3, w.opposite[h] // 3
        n, m = _normal(w, f), _normal(w, k)
        places[1], places[2] = w.points[a], w.points[b]
        middle = 0.5 * (w.points[a] + w.points[b])
        place[1], place[2] = w.place[a], w.place[b]
        px, py, pz, place[0] = _onto_surface(
            tree, middle[0], middle[1], middle[2], w.place[a], n[0] + m[0], n[1] + m[1], n[2] + m[2]
        )
        places[0, 0], places[0, 1], places[0, 2] = px, py, pz
        most = np.inf if length < SHORT * floor else limits.most
        best, chosen, far = np.inf, -1, False
        for trial in range(3):
            if place[trial] < 0:
                continue
            x, y, z = places[trial]
            olds = _collapsed(w, s, a, b, x, y, z, f, k)
            if olds == 0:
                continue
            count, total = _measure(w, s, olds, olds - 2, most)
            far |= total == np.inf
            if total < best:
                best, chosen = total, trial
            if total <= limits.free * count:
                break
        if chosen < 0:
            if far:
                w.size[a] = min(w.size[a], max(floor, length / SHORT))
                w.size[b] = min(w.size[b], max(floor, length / SHORT))
            continue
        x, y, z = places[chosen]
        olds = _collapsed(w, s, a, b, x, y, z, f, k)
        count, _ = _measure(w, s, olds, olds - 2, most)
        for i in range(olds - 2):
            face_of[i] = s.old[i + 2]
        _attach(w, s, olds, count, face_of)
        _collapse(w, h)
        w.points[b, 0], w.points[b, 1], w.points[b, 2] = x, y, z
        w.place[b], w.size[b] = place[chosen], min(w.size[a], w.size[b])
        done += 1
    return done


@numba.njit(cache=True)
def _collapse(w, h):  # type: ignore[no-untyped-def]
    """Take vertex a of half-edge a -> b out; its faces get b instead, and the two of the edge die."""
    g = w.opposite[h]
    a, b = _origin(w, h), _origin(w, g)
    c, d = _origin(w, _previous(h)), _origin(w, _previous(g))
    e = w.leaving[a]
    while True:
        w.faces[e // 3, e % 3] = b
        e = w.opposite[_previous(e)]
        if e == w.leaving[a]:
            break
    # what was behind b -> c and c -> a now meets; likewise for a -> d and d -> b
    one, two = w.opposite[_next(h)], w.opposite[_previous(h)]
    three, four = w.opposite[_next(g)], w.opposite[_previous(g)]
    _pair(w, one, two)
    _pair(w, three, four)
    # `one` runs c -> b, `two` a -> c, `three` d -> a, `four` b -> d
    w.leaving[c], w.leaving[d], w.leaving[b] = one, three, four
    w.leaving[a] = -1
    w.faces[h // 3, 0] = -1
    w.faces[g // 3, 0] = -1


@numba.njit(cache=True)
def flip(w, s, limits):  # type: ignore[no-untyped-def]
    """Flip the edges where that brings the numbers of neighbours nearer to six; returns the number of flips."""
    done = 0
    face_of = np.empty(2, np.int64)
    for h in range(3 * w.used[1]):
        if w.faces[h // 3, 0] < 0 or w.opposite[h] < h:
            continue
        g = w.opposite[h]
        a, b = _origin(w, h), _origin(w, g)
        c, d = _origin(w, _previous(h)), _origin(w, _previous(g))
        va, vb, vc, vd = _valence(w, a), _valence(w, b), _valence(w, c), _valence(w, d)
        now = (va - 6) ** 2 + (vb - 6) ** 2 + (vc - 6) ** 2 + (vd - 6) ** 2
        then = (va - 7) ** 2 + (vb - 7) ** 2 + (vc - 5) ** 2 + (vd - 5) ** 2
        if min(va, vb) <= _LEAST_VALENCE or then > now or _joined(w, c, d):
            continue
        f, k = h // 3, g // 3
        one, two = _face_row(w, f), _face_row(w, k)
        _set_corner(s.new[0], 0, w.points, a)
        _set_corner(s.new[0], 1, w.points, d)
        _set_corner(s.new[0], 2, w.points, c)
        _set_corner(s.new[1], 0, w.points, d)
        _set_corner(s.new[1], 1, w.points, b)
        _set_corner(s.new[1], 2, w.points, c)
        shape, worst = min(_shape(s.new[0]), _shape(s.new[1])), min(_shape(one), _shape(two))
        if (then == now and shape <= worst) or shape < min(_MIN_SHAPE, worst) or shape < 0.5 * worst:
            continue
        turned = False
        for i in range(2):
            turned |= _turned(s.new[i], one) or _turned(s.new[i], two)
        if turned:
            continue
        s.old[0], s.old[1] = f, k
        count, total = _measure(w, s, 2, 2, limits.most if worst < POOR and shape > worst else limits.free)
        if total == np.inf:
            continue
        bc, ca, ad, db = w.opposite[_next(h)], w.opposite[_previous(h)], w.opposite[_next(g)], w.opposite[_previous(g)]
        w.faces[f, 0], w.faces[f, 1], w.faces[f, 2] = a, d, c
        w.faces[k, 0], w.faces[k, 1], w.faces[k, 2] = d, b, c
        _pair(w, 3 * f, ad)
        _pair(w, 3 * f + 1, 3 * k + 2)
        _pair(w, 3 * f + 2, ca)
        _pair(w, 3 * k, db)
        _pair(w, 3 * k + 1, bc)
        w.leaving[a], w.leaving[d], w.leaving[c], w.leaving[b] = 3 * f, 3 * f + 1, 3 * f + 2, 3 * k + 1
        face_of[0], face_of[1] = f, k
        _attach(w, s, 2, count, face_of)
        done += 1
    return done


@numba.njit(cache=True)
def smooth(w, tree, s, limits):  # type: ignore[no-untyped-def]
    """Move every vertex along the surface towards the middle of its triangles; returns the number of moves.

    The middle is weighted by area over squared target length, which makes triangles as large as their target says.
    """
    moved = 0
    row = np.empty(9)
    for v in range(w.used[0]):
        if w.leaving[v] < 0:
            continue
        olds = 0
        cx = cy = cz = total_weight = nx = ny = nz = 0.0
        h = w.leaving[v]
        while olds < _MOST_FACES:
            f = h // 3
            a, b = _origin(w, _next(h)), _origin(w, _previous(h))
            mx, my, mz = _normal(w, f)
            size = (w.size[v] + w.size[a] + w.size[b]) / 3
            weight = np.sqrt(mx * mx + my * my + mz * mz) / (size * size)
            nx, ny, nz = nx + mx, ny + my, nz + mz
            cx += weight * (w.points[v, 0] + w.points[a, 0] + w.points[b, 0]) / 3
            cy += weight * (w.points[v, 1] + w.points[a, 1] + w.points[b, 1]) / 3
            cz += weight * (w.points[v, 2] + w.points[a, 2] + w.points[b, 2]) / 3
            total_weight += weight
            s.old[olds] = f
            olds += 1
            h = w.opposite[_previous(h)]
            if h == w.leaving[v]:
                break
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if olds == _MOST_FACES or not length > 0 or not total_weight > 0:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        ox, oy, oz = w.points[v]
        dx, dy, dz = cx / total_weight - ox, cy / total_weight - oy, cz / total_weight - oz
        off = dx * nx + dy * ny + dz * nz
        dx, dy, dz = dx - off * nx, dy - off * ny, dz - off * nz
        worst = np.inf
        for i in range(olds):
            _corners(w, s.old[i], -1, ox, oy, oz, row)
            worst = min(worst, _shape(row))
        for _ in range(_SMOOTHING_TRIES):
            x, y, z, place = _onto_surface(tree, ox + dx, oy + dy, oz + dz, w.place[v], nx, ny, nz)
            dx, dy, dz = 0.5 * dx, 0.5 * dy, 0.5 * dz
            if place < 0:
                continue
            turned, shape = False, np.inf
            for i in range(olds):
                _corners(w, s.old[i], v, x, y, z, s.new[i])
                shape = min(shape, _shape(s.new[i]))
                _corners(w, s.old[i], -1, x, y, z, row)
                turned |= _turned(s.new[i], row)
            if turned:
                continue
            if shape < min(worst, POOR):
                continue
            count, total = _measure(w, s, olds, olds, limits.most if worst < POOR else limits.free)
            if total == np.inf:
                continue
            _attach(w, s, olds, count, s.old.copy())
            w.points[v, 0], w.points[v, 1], w.points[v, 2] = x, y, z
            w.place[v] = place
            moved += 1
            break
    return moved


@numba.njit(cache=True)
def limit_growth(faces, points, size, growth):  # type: ignore[no-untyped-def]
    """Lower `size` (n,) until no edge of `faces` sees it grow by more than `growth` times the length of the edge."""
    changed = True
    while changed:
        changed = False
        for f in range(len(faces)):
            if faces[f, 0] < 0:
                continue
            for i in range(3):
                a, b = faces[f, i], faces[f, (i + 1) % 3]
                dx, dy, dz = points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], points[a, 2] - points[b, 2]
                rise = growth * np.sqrt(dx * dx + dy * dy + dz * dz)
                if size[a] > size[b] + rise * (1 + 1e-9):
                    size[a] = size[b] + rise
                    changed = True
                elif size[b] > size[a] + rise * (1 + 1e-9):
                    size[b] = size[a] + rise
                    changed = True


@numba.njit(cache=True)
def relax(w, given, tree_faces, ease):  # type: ignore[no-untyped-def]
    """Let targets grow by the factor `ease`, up to what is `given` per vertex of the surface under each vertex."""
    for v in range(w.used[0]):
        if w.leaving[v] >= 0:
            corners = tree_faces[w.place[v]]
            most = min(given[corners[0]], given[corners[1]], given[corners[2]])
            w.size[v] = min(w.size[v] * ease, most)
