"""Vertices of the boundary that are in the way: they are joined to a neighbour on the boundary.

In a layer one tetrahedron thick, a vertex whose triangles all see one vertex of the other side has flat tetrahedra
wherever it slides, and no swap removes it. An inner surface is treated like the boundary.
"""

from __future__ import annotations

import numba
import numpy as np

from cortet.geometry.closest_point import closest_point
from cortet.geometry.topology import TET_FACES
from cortet.optimise.cavities import MAX_STAR, corner_of, mu2_at, star_of, unit_normal
from cortet.optimise.swaps import MAX_SAG

#: new faces are within acos(this) of those they replace
_MIN_FACE_COSINE = 0.7
#: most boundary faces at a vertex: three of each tetrahedron, if all have other labels
_MAX_FAN = 3 * MAX_STAR


@numba.njit(cache=True, error_model="numpy")
def remove_vertex(mesh, tree, e, changed, most):  # type: ignore[no-untyped-def]
    """Join a boundary vertex of tetrahedron e to a neighbour if the worst mu^2 around it falls by the factor `most`.

    Returns whether one was joined, and then sets `changed` for the vertices around.
    """
    star, fan = np.empty(MAX_STAR, np.int32), np.empty((_MAX_FAN, 2), np.int32)
    gone = kept = -1
    for v in mesh.cells[e]:
        size = star_of(mesh, e, v, star)
        faces = _fan(mesh, star[:size], v, fan)
        for a in fan[:faces, 0]:
            ratio = _ratio_if_joined(mesh, star[:size], v, a)
            if ratio < most and _is_sound(mesh, tree, star[:size], fan[:faces], v, a):
                most, gone, kept = ratio, v, a
    if gone < 0:
        return False
    size = star_of(mesh, e, gone, star)
    for f in star[:size]:
        changed[mesh.cells[f]] = True
    _join(mesh, star[:size], gone, kept)
    return True


@numba.njit(cache=True, error_model="numpy")
def _fan(mesh, star, v, fan):  # type: ignore[no-untyped-def]
    """Write the other two corners of each boundary face at v, outward; return their number, 0 if v must stay.

    It stays where surfaces meet, as those of labels with an inner surface: their faces are between other regions.
    """
    count, inner, outer, meet = 0, -1, -1, False
    for f in star:
        for k in range(4):
            g = mesh.neighbours[f, k]
            behind = mesh.region[g] if g >= 0 else -1
            if mesh.cells[f, k] != v and (g < 0 or mesh.region[f] < behind):
                for j in range(3):
                    if mesh.cells[f, TET_FACES[k, j]] == v:
                        fan[count, 0] = mesh.cells[f, TET_FACES[k, (j + 1) % 3]]
                        fan[count, 1] = mesh.cells[f, TET_FACES[k, (j + 2) % 3]]
                meet |= count > 0 and (mesh.region[f] != inner or behind != outer)
                inner, outer = mesh.region[f], behind
                count += 1
    stays = mesh.held[v] or meet or (outer >= 0 and mesh.on_triangle[v] < 0)
    return 0 if stays else count


@numba.njit(cache=True, error_model="numpy")
def _ratio_if_joined(mesh, star, v, a):  # type: ignore[no-untyped-def]
    """The worst mu^2 of the tetrahedra around v once it is joined to a, over the worst now."""
    worst, before = 0.0, 0.0
    for f in star:
        before = max(before, mesh.mu2[f])
        if corner_of(mesh.cells, f, a) < 0:
            b, c, d, e = mesh.cells[f]
            b, c, d, e = a if b == v else b, a if c == v else c, a if d == v else d, a if e == v else e
            worst = max(worst, mu2_at(mesh.points, b, c, d, e))
    return worst / before


@numba.njit(cache=True, error_model="numpy")
def _is_sound(mesh, tree, star, fan, v, a):  # type: ignore[no-untyped-def]
    """Whether v may be joined to a: the mesh and its boundary stay manifolds, and the boundary stays on the surface."""
    points, one, two = mesh.points, -1, -1
    for b, c in fan:
        if mesh.held[b]:
            return False
        if b == a:
            one = c
        elif c == a:
            two = b
        else:
            ox, oy, oz = unit_normal(points[v], points[b], points[c])
            nx, ny, nz = unit_normal(points[a], points[b], points[c])
            mx, my, mz = (points[a] + points[b]) / 2
            px, py, pz, _, _, _, _ = closest_point(tree, mx, my, mz, mesh.on_triangle[v])
            sag2, length2 = (px - mx) ** 2 + (py - my) ** 2 + (pz - mz) ** 2, ((points[a] - points[b]) ** 2).sum()
            if not nx * ox + ny * oy + nz * oz >= _MIN_FACE_COSINE or sag2 > MAX_SAG**2 * length2:
                return False
    first = -1
    for f in star:
        if corner_of(mesh.cells, f, a) >= 0:
            first, walls = f, 0
            for vertex in (v, a):  # the two faces that become one
                g = mesh.neighbours[f, corner_of(mesh.cells, f, vertex)]
                walls += g < 0 or mesh.region[g] != mesh.region[f]
            if walls == 2:
                return False
    around, beside = np.empty(MAX_STAR, np.int32), np.empty((_MAX_FAN, 2), np.int32)
    around = around[: star_of(mesh, first, a, around)]
    for g in around:
        for x in mesh.cells[g]:  # no edge from a to x may be there already, unless it is in a tetrahedron with both
            linked, both = False, x in (v, a)
            for f in star:
                if corner_of(mesh.cells, f, x) >= 0:
                    linked = True
                    both |= corner_of(mesh.cells, f, a) >= 0
            if linked and not both:
                return False
    others = _fan(mesh, around, a, beside)
    for b in beside[:others, 0]:
        if b not in (one, two) and (fan[:, 0] == b).any():
            return False
    return others > 0 and one >= 0 and two >= 0


@numba.njit(cache=True, error_model="numpy")
def _join(mesh, star, v, a):  # type: ignore[no-untyped-def]
    """Put a in the stead of v; the tetrahedra that had both go, and those on either side of one become neighbours."""
    for f in star:
        j = corner_of(mesh.cells, f, a)
        if j < 0:
            mesh.cells[f, corner_of(mesh.cells, f, v)] = a
            continue
        one, two = mesh.neighbours[f, corner_of(mesh.cells, f, v)], mesh.neighbours[f, j]
        for g, h in ((one, two), (two, one)):
            for k in range(4):
                if g >= 0 and mesh.neighbours[g, k] == f:
                    mesh.neighbours[g, k] = h
        mesh.cells[f, 0], mesh.mu2[f] = -1, 0.0
        mesh.dead[mesh.counters[1]] = f
        mesh.counters[1] += 1
    for f in star:
        if mesh.cells[f, 0] >= 0:
            mesh.mu2[f] = mu2_at(mesh.points, mesh.cells[f, 0], mesh.cells[f, 1], mesh.cells[f, 2], mesh.cells[f, 3])
