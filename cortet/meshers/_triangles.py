"""Local operations on a closed triangulated surface that must stay near another one: the compiled part of `remesh`.

Edges are split, collapsed and flipped, and vertices are moved. An operation is refused if it would take the triangles
away from the given surface. For this check, sample points of the given surface (its vertices and the centres of its
faces) are attached to the nearest triangle around the operation. After each operation every sample around it must be
within its own limit of a triangle, and on average within a lower one. So nothing of the surface is lost, whatever the
edge length: a narrow sulcus that is filled, or a thin blade that is cut off, leaves samples behind.

The attached samples follow Hu et al., Error-bounded and feature preserving surface remeshing with minimal angle
improvement, TVCG 2017; the operations are those of Botsch and Kobbelt, SGP 2004.

Half-edge 3 f + i runs from corner i of face f to corner i + 1. A dead face has -1 as its first corner, a dead vertex -1
as its half-edge.
"""
# Numba's compiled functions take the named tuple directly; nothing here runs in parallel, so the bits do not depend on
# the number of threads.

from __future__ import annotations

import numba
import numpy as np

from cortet.meshers._half_edges import (
    MOST_FACES,
    corners_of,
    face_row,
    has_turned,
    length_of,
    next_of,
    normal_of,
    origin_of,
    pair,
    previous_of,
    set_corner,
    shape_of,
    share_an_edge,
    valence_of,
)
from cortet.meshers._samples import attach, measure, onto_surface

#: an edge is split or collapsed when it is longer or shorter than these multiples of the target (Botsch and Kobbelt)
LONG, SHORT = 4 / 3, 4 / 5
#: shape of a triangle below which it may be improved at the cost of some distance
POOR = 0.7
#: a smoothing step that is refused is tried again at half the length
_SMOOTHING_TRIES = 2
#: a vertex keeps at least this many neighbours: with three, the corner is always one flat tetrahedron
_LEAST_VALENCE = 4
#: a flip must not make the shape of the worse of its two triangles worse than this, nor halve it
_MIN_SHAPE = 0.3
#: faces of a block, which are scanned together
BLOCK = 16


@numba.njit(cache=True, error_model="numpy")
def thinnest(w, times):  # type: ignore[no-untyped-def]
    """The least shape, 4 sqrt(3) A / sum l^2, of the triangles with an edge longer than so many `times` its target."""
    least = np.inf
    for f in range(w.used[1]):
        if w.faces[f, 0] < 0:
            continue
        squares, too_long = 0.0, False
        for h in range(3 * f, 3 * f + 3):
            a, b = origin_of(w, h), origin_of(w, next_of(h))
            length = length_of(w, a, b)
            squares += length * length
            too_long = too_long or length > times * min(w.size[a], w.size[b])
        if too_long:
            nx, ny, nz = normal_of(w, f)
            least = min(least, 2 * np.sqrt(3.0) * np.sqrt(nx * nx + ny * ny + nz * nz) / squares)
    return least


@numba.njit(cache=True, error_model="numpy")
def points_wanted(w):  # type: ignore[no-untyped-def]
    """About how many points equilateral triangles of the target edge length would have."""
    total = 0.0
    for f in range(w.used[1]):
        if w.faces[f, 0] >= 0:
            nx, ny, nz = normal_of(w, f)
            size = min(w.size[w.faces[f, 0]], w.size[w.faces[f, 1]], w.size[w.faces[f, 2]])
            total += np.sqrt(nx * nx + ny * ny + nz * nz) / (np.sqrt(3.0) * size * size)
    return total


@numba.njit(cache=True, error_model="numpy")
def _is_longest(w, h, length):  # type: ignore[no-untyped-def]
    """Whether half-edge h, of this length, is the longest edge of its triangle, or as long as another."""
    a, b, c = origin_of(w, h), origin_of(w, next_of(h)), origin_of(w, previous_of(h))
    return length >= length_of(w, b, c) and length >= length_of(w, c, a)


@numba.njit(cache=True, error_model="numpy")
def _is_full(w):  # type: ignore[no-untyped-def]
    return w.used[0] + 1 > len(w.points) or w.used[1] + 2 > len(w.faces)


@numba.njit(cache=True, error_model="numpy")
def split_long(w, tree, s, limits, longest, changed):  # type: ignore[no-untyped-def]
    """Split the edges longer than 4/3 of the target; return the number of splits, -1 if there was no room for all.

    If `longest` is true, only those that are the longest of both their triangles: others leave thinner triangles.
    Blocks of faces that have not `changed` since they were scanned are skipped, as their edges would be refused again;
    where there is no room, none is, so that the order of splits is that of full scans.
    """
    done = 0
    face_of = np.empty(4, np.int64)
    last = 3 * w.used[1]
    h = -1
    while h + 1 < last:
        h += 1
        f = h // 3
        if h % (3 * BLOCK) == 0:
            if not (changed[f // BLOCK] or _is_full(w)):
                h += 3 * BLOCK - 1
                continue
            changed[f // BLOCK] = h + 3 * BLOCK > last  # faces that are made during this scan are left to the next one
        if w.faces[f, 0] < 0:
            continue
        g = w.opposite[h]
        a, b = origin_of(w, h), origin_of(w, g)
        length = length_of(w, a, b)
        if g < h or length <= LONG * min(w.size[a], w.size[b]):
            continue
        if longest and not (_is_longest(w, h, length) and _is_longest(w, g, length)):
            continue
        if _is_full(w):
            return -1
        k = g // 3
        n, m = normal_of(w, f), normal_of(w, k)
        middle = 0.5 * (w.points[a] + w.points[b])
        px, py, pz, on_triangle = onto_surface(
            tree, middle[0], middle[1], middle[2], w.on_triangle[a], n[0] + m[0], n[1] + m[1], n[2] + m[2]
        )
        if on_triangle < 0:
            continue
        c, d = origin_of(w, previous_of(h)), origin_of(w, previous_of(g))
        s.old[0], s.old[1] = f, k
        for row, first, second in ((0, a, c), (1, c, b), (2, b, d), (3, d, a)):
            s.new[row, 0], s.new[row, 1], s.new[row, 2] = px, py, pz
            set_corner(s.new[row], 1, w.points, second)
            set_corner(s.new[row], 2, w.points, first)
        one, two = face_row(w, f), face_row(w, k)
        if (
            has_turned(s.new[0], one)
            or has_turned(s.new[1], one)
            or has_turned(s.new[2], two)
            or has_turned(s.new[3], two)
        ):
            continue
        count, total = measure(w, s, 2, 4, limits.most)
        if total == np.inf:
            continue
        v, p, q = w.used[0], w.used[1], w.used[1] + 1
        w.used[0] += 1
        w.used[1] += 2
        w.points[v, 0], w.points[v, 1], w.points[v, 2] = px, py, pz
        w.on_triangle[v], w.size[v] = on_triangle, min(w.size[a], w.size[b])
        bc, da = next_of(h), next_of(g)  # half-edges b -> c and a -> d
        behind_bc, behind_ad = w.opposite[bc], w.opposite[da]
        i, j = h % 3, g % 3
        # f = (a, b, c) becomes (a, v, c), k = (b, a, d) becomes (b, v, d); p = (v, b, c), q = (v, a, d)
        w.faces[f, (i + 1) % 3] = v
        w.faces[k, (j + 1) % 3] = v
        w.faces[p, 0], w.faces[p, 1], w.faces[p, 2] = v, b, c
        w.faces[q, 0], w.faces[q, 1], w.faces[q, 2] = v, a, d
        pair(w, 3 * p + 1, behind_bc)
        pair(w, 3 * q + 1, behind_ad)
        pair(w, 3 * p + 2, bc)
        pair(w, 3 * q + 2, da)
        pair(w, h, 3 * q)
        pair(w, g, 3 * p)
        w.leaving[v], w.leaving[a], w.leaving[b] = 3 * p, h, g
        w.leaving[c], w.leaving[d] = 3 * p + 2, 3 * q + 2
        w.first[p] = w.first[q] = -1
        face_of[0], face_of[1], face_of[2], face_of[3] = f, p, k, q
        attach(w, s, 2, count, face_of)
        for face in face_of:
            changed[face // BLOCK] = True
            for i in range(3):  # an edge is scanned with the one of its two faces that has the lower number
                changed[w.opposite[3 * face + i] // (3 * BLOCK)] = True
        done += 1
    return done


@numba.njit(cache=True, error_model="numpy")
def _collapsed(w, s, a, b, x, y, z, first, second):  # type: ignore[no-untyped-def]
    """Record the changes if a and b are collapsed into (x, y, z); `first` and `second` are the faces that vanish.

    The faces that vanish come first among the old ones. Returns the number of old faces, 0 if the collapse turns a
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
                if olds == MOST_FACES:
                    return 0
                c = origin_of(w, next_of(h))
                dx, dy, dz = w.points[c, 0] - x, w.points[c, 1] - y, w.points[c, 2] - z
                if dx * dx + dy * dy + dz * dz > longest * longest:
                    return 0
                corners_of(w, f, v, x, y, z, s.new[olds - 2])
                corners_of(w, f, -1, x, y, z, row)
                if has_turned(s.new[olds - 2], row):
                    return 0
                s.old[olds] = f
                olds += 1
            h = w.opposite[previous_of(h)]
            if h == w.leaving[v]:
                break
    return olds


@numba.njit(cache=True, error_model="numpy")
def _may_collapse(w, h):  # type: ignore[no-untyped-def]
    """Whether collapsing half-edge h leaves a manifold: its ends share two neighbours, and all keep enough faces."""
    a, b = origin_of(w, h), origin_of(w, w.opposite[h])
    c, d = origin_of(w, previous_of(h)), origin_of(w, previous_of(w.opposite[h]))
    if min(valence_of(w, c), valence_of(w, d), valence_of(w, a) + valence_of(w, b) - 3) <= _LEAST_VALENCE:
        return False
    shared = 0
    g = w.leaving[a]
    while True:
        if share_an_edge(w, b, origin_of(w, next_of(g))):
            shared += 1
        g = w.opposite[previous_of(g)]
        if g == w.leaving[a]:
            return shared == 2


@numba.njit(cache=True, error_model="numpy")
def collapse_short(w, tree, s, limits, floor):  # type: ignore[no-untyped-def]
    """Collapse the edges shorter than 4/5 of the target, and vertices of three faces; return the number of collapses.

    If a collapse is refused because it would leave the surface, the target there becomes the present length, but not
    less than `floor` (mm), so that the triangles around are graded towards it. An edge shorter than that stays only if
    a sample would be beyond its own limit.
    """
    done = 0
    face_of = np.empty(MOST_FACES, np.int64)
    positions = np.empty((3, 3))
    on_triangle = np.empty(3, np.int64)
    for h in range(3 * w.used[1]):
        if w.faces[h // 3, 0] < 0 or w.opposite[h] < h:
            continue
        a, b = origin_of(w, h), origin_of(w, w.opposite[h])
        length = length_of(w, a, b)
        pointed = min(valence_of(w, a), valence_of(w, b)) < _LEAST_VALENCE
        if (length >= SHORT * min(w.size[a], w.size[b]) and not pointed) or not _may_collapse(w, h):
            continue
        f, k = h // 3, w.opposite[h] // 3
        n, m = normal_of(w, f), normal_of(w, k)
        positions[1], positions[2] = w.points[a], w.points[b]
        middle = 0.5 * (w.points[a] + w.points[b])
        on_triangle[1], on_triangle[2] = w.on_triangle[a], w.on_triangle[b]
        px, py, pz, on_triangle[0] = onto_surface(
            tree, middle[0], middle[1], middle[2], w.on_triangle[a], n[0] + m[0], n[1] + m[1], n[2] + m[2]
        )
        positions[0, 0], positions[0, 1], positions[0, 2] = px, py, pz
        most = np.inf if length < SHORT * floor else limits.most
        best, chosen, far = np.inf, -1, False
        for trial in range(3):
            if on_triangle[trial] < 0:
                continue
            x, y, z = positions[trial]
            olds = _collapsed(w, s, a, b, x, y, z, f, k)
            if olds == 0:
                continue
            count, total = measure(w, s, olds, olds - 2, most)
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
        x, y, z = positions[chosen]
        olds = _collapsed(w, s, a, b, x, y, z, f, k)
        count, _ = measure(w, s, olds, olds - 2, most)
        for i in range(olds - 2):
            face_of[i] = s.old[i + 2]
        attach(w, s, olds, count, face_of)
        _collapse(w, h)
        w.points[b, 0], w.points[b, 1], w.points[b, 2] = x, y, z
        w.on_triangle[b], w.size[b] = on_triangle[chosen], min(w.size[a], w.size[b])
        done += 1
    return done


@numba.njit(cache=True, error_model="numpy")
def _collapse(w, h):  # type: ignore[no-untyped-def]
    """Remove vertex a of half-edge a -> b; its faces get b instead, and the two faces of the edge die."""
    g = w.opposite[h]
    a, b = origin_of(w, h), origin_of(w, g)
    c, d = origin_of(w, previous_of(h)), origin_of(w, previous_of(g))
    e = w.leaving[a]
    while True:
        w.faces[e // 3, e % 3] = b
        e = w.opposite[previous_of(e)]
        if e == w.leaving[a]:
            break
    # the neighbours behind b -> c and c -> a now meet; likewise those behind a -> d and d -> b
    one, two = w.opposite[next_of(h)], w.opposite[previous_of(h)]
    three, four = w.opposite[next_of(g)], w.opposite[previous_of(g)]
    pair(w, one, two)
    pair(w, three, four)
    # `one` runs c -> b, `two` a -> c, `three` d -> a, `four` b -> d
    w.leaving[c], w.leaving[d], w.leaving[b] = one, three, four
    w.leaving[a] = -1
    w.faces[h // 3, 0] = -1
    w.faces[g // 3, 0] = -1


@numba.njit(cache=True, error_model="numpy")
def flip(w, s, limits):  # type: ignore[no-untyped-def]
    """Flip edges if that brings the numbers of neighbours nearer to six; return the number of flips."""
    done = 0
    face_of = np.empty(2, np.int64)
    for h in range(3 * w.used[1]):
        if w.faces[h // 3, 0] < 0 or w.opposite[h] < h:
            continue
        g = w.opposite[h]
        a, b = origin_of(w, h), origin_of(w, g)
        c, d = origin_of(w, previous_of(h)), origin_of(w, previous_of(g))
        va, vb, vc, vd = valence_of(w, a), valence_of(w, b), valence_of(w, c), valence_of(w, d)
        now = (va - 6) ** 2 + (vb - 6) ** 2 + (vc - 6) ** 2 + (vd - 6) ** 2
        then = (va - 7) ** 2 + (vb - 7) ** 2 + (vc - 5) ** 2 + (vd - 5) ** 2
        if min(va, vb) <= _LEAST_VALENCE or then > now or share_an_edge(w, c, d):
            continue
        f, k = h // 3, g // 3
        one, two = face_row(w, f), face_row(w, k)
        set_corner(s.new[0], 0, w.points, a)
        set_corner(s.new[0], 1, w.points, d)
        set_corner(s.new[0], 2, w.points, c)
        set_corner(s.new[1], 0, w.points, d)
        set_corner(s.new[1], 1, w.points, b)
        set_corner(s.new[1], 2, w.points, c)
        shape, worst = min(shape_of(s.new[0]), shape_of(s.new[1])), min(shape_of(one), shape_of(two))
        if (then == now and shape <= worst) or shape < min(_MIN_SHAPE, worst) or shape < 0.5 * worst:
            continue
        turned = False
        for i in range(2):
            turned |= has_turned(s.new[i], one) or has_turned(s.new[i], two)
        if turned:
            continue
        s.old[0], s.old[1] = f, k
        count, total = measure(w, s, 2, 2, limits.most if worst < POOR and shape > worst else limits.free)
        if total == np.inf:
            continue
        bc, ca, ad, db = (
            w.opposite[next_of(h)],
            w.opposite[previous_of(h)],
            w.opposite[next_of(g)],
            w.opposite[previous_of(g)],
        )
        w.faces[f, 0], w.faces[f, 1], w.faces[f, 2] = a, d, c
        w.faces[k, 0], w.faces[k, 1], w.faces[k, 2] = d, b, c
        pair(w, 3 * f, ad)
        pair(w, 3 * f + 1, 3 * k + 2)
        pair(w, 3 * f + 2, ca)
        pair(w, 3 * k, db)
        pair(w, 3 * k + 1, bc)
        w.leaving[a], w.leaving[d], w.leaving[c], w.leaving[b] = 3 * f, 3 * f + 1, 3 * f + 2, 3 * k + 1
        face_of[0], face_of[1] = f, k
        attach(w, s, 2, count, face_of)
        done += 1
    return done


@numba.njit(cache=True, error_model="numpy")
def smooth(w, tree, s, limits):  # type: ignore[no-untyped-def]
    """Move every vertex along the surface towards the middle of its triangles; return the number of moves.

    The middle is weighted by area over squared target length, so that the size of triangles follows their target.
    """
    moved = 0
    row = np.empty(9)
    for v in range(w.used[0]):
        if w.leaving[v] < 0:
            continue
        olds = 0
        cx = cy = cz = total_weight = nx = ny = nz = 0.0
        h = w.leaving[v]
        while olds < MOST_FACES:
            f = h // 3
            a, b = origin_of(w, next_of(h)), origin_of(w, previous_of(h))
            mx, my, mz = normal_of(w, f)
            size = (w.size[v] + w.size[a] + w.size[b]) / 3
            weight = np.sqrt(mx * mx + my * my + mz * mz) / (size * size)
            nx, ny, nz = nx + mx, ny + my, nz + mz
            cx += weight * (w.points[v, 0] + w.points[a, 0] + w.points[b, 0]) / 3
            cy += weight * (w.points[v, 1] + w.points[a, 1] + w.points[b, 1]) / 3
            cz += weight * (w.points[v, 2] + w.points[a, 2] + w.points[b, 2]) / 3
            total_weight += weight
            s.old[olds] = f
            olds += 1
            h = w.opposite[previous_of(h)]
            if h == w.leaving[v]:
                break
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if olds == MOST_FACES or not length > 0 or not total_weight > 0:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        ox, oy, oz = w.points[v]
        dx, dy, dz = cx / total_weight - ox, cy / total_weight - oy, cz / total_weight - oz
        off = dx * nx + dy * ny + dz * nz
        dx, dy, dz = dx - off * nx, dy - off * ny, dz - off * nz
        worst = np.inf
        for i in range(olds):
            corners_of(w, s.old[i], -1, ox, oy, oz, row)
            worst = min(worst, shape_of(row))
        for _ in range(_SMOOTHING_TRIES):
            x, y, z, on_triangle = onto_surface(tree, ox + dx, oy + dy, oz + dz, w.on_triangle[v], nx, ny, nz)
            dx, dy, dz = 0.5 * dx, 0.5 * dy, 0.5 * dz
            if on_triangle < 0:
                continue
            turned, shape = False, np.inf
            for i in range(olds):
                corners_of(w, s.old[i], v, x, y, z, s.new[i])
                shape = min(shape, shape_of(s.new[i]))
                corners_of(w, s.old[i], -1, x, y, z, row)
                turned |= has_turned(s.new[i], row)
            if turned:
                continue
            if shape < min(worst, POOR):
                continue
            count, total = measure(w, s, olds, olds, limits.most if worst < POOR else limits.free)
            if total == np.inf:
                continue
            attach(w, s, olds, count, s.old.copy())
            w.points[v, 0], w.points[v, 1], w.points[v, 2] = x, y, z
            w.on_triangle[v] = on_triangle
            moved += 1
            break
    return moved


@numba.njit(cache=True, error_model="numpy")
def relax(w, given, tree_faces, ease):  # type: ignore[no-untyped-def]
    """Let targets grow by the factor `ease`, up to the smallest one `given` at the surface triangle under a vertex."""
    for v in range(w.used[0]):
        if w.leaving[v] >= 0:
            corners = tree_faces[w.on_triangle[v]]
            most = min(given[corners[0]], given[corners[1]], given[corners[2]])
            w.size[v] = min(w.size[v] * ease, most)
