"""New vertices where no swap helps: inside tetrahedra whose vertices lie on the boundary, across a blade or a corner.

A tetrahedron whose four vertices lie on the boundary can only slide. One that is alone at a boundary edge keeps its
opening angle. A vertex inside mends both. The tetrahedra around an edge, a face or a tetrahedron are removed; so are
those behind the worst face of that cavity, as long as it pays. The faces of the cavity are then joined to the new
vertex (Klingner and Shewchuk, Aggressive tetrahedral mesh improvement, IMR 2007). The vertex minimises the sum of mu^p
over the new tetrahedra. Vertices that the cavity encloses are removed from the mesh, so edges collapse, too.

Each boundary face of a cavity remains a face of its filling, so only the inside changes. But where that is better, a
vertex of the boundary is removed (`optimise.removal`), and one with a single tetrahedron gets a second one. The code is
serial and takes the worst tetrahedron first.
"""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.geometry.closest_point import SurfaceTree
from cortet.geometry.topology import TET_FACES, neighbours, numbers, used_vertices
from cortet.meshes import FloatArray, IntArray, TetMesh
from cortet.optimise.cavities import EDGE_FRAMES, MAX_RING, replace_cells, ring_around
from cortet.optimise.removal import remove_vertex
from cortet.optimise.star import FLATNESS, MU2, derivatives, empty_star, energy, find_mu2, newton_step, set_column
from cortet.optimise.swaps import flip_beside_lone, live_cells, swappable
from cortet.optimise.vertices import interface_triangles

#: most tetrahedra of a cavity
_MOST = 60
#: a cavity is given up once it has grown by this many tetrahedra since its best filling
_PATIENCE = 5
#: power of the energy that a new vertex minimises, and Newton steps of each cavity
_POWER, _STEPS = 8, 2
#: step lengths tried, and the ratio of each to the one before
_BACKTRACKS, _SHRINK = 5, 0.4
#: the worst mu of a cavity must fall by this factor, or the vertex is not inserted
MIN_GAIN = 0.995
#: passes over the list of bad tetrahedra
_ROUNDS = 2


def insert_vertices(
    mesh: TetMesh,
    mu2: FloatArray,
    region: IntArray,
    threshold: float,
    *,
    gain: float = MIN_GAIN,
    tree: SurfaceTree | None = None,
    held: NDArray[np.bool_] | None = None,
) -> tuple[TetMesh, int]:
    """Insert vertices in tetrahedra with mu^2 above `threshold` if that improves their worst.

    Vertices that a cavity encloses are removed. A new vertex takes the values of a vertex near it.

    Parameters
    ----------
    mesh : positive volumes
    mu2, region : (m,) of the tetrahedra; a cavity never joins different regions
    gain : the worst mu of a cavity must fall by this factor; if above 1, it may rise before the vertices are moved
    tree : if given, vertices of the boundary may be removed where it stays on this surface
    held : (n,) vertices whose boundary faces stay

    Returns
    -------
    The mesh, old vertices first, and the number of vertices inserted.
    """
    bad = int((mu2 > threshold).sum())
    if not bad:
        return mesh, 0
    count, room = len(mesh.points), len(mesh.points) + 2 * bad + 8
    held = np.zeros(count, np.bool_) if held is None else held
    on_triangle = None if tree is None else interface_triangles(mesh, tree)
    work = swappable(mesh, mu2, region, held, on_triangle=on_triangle, vertices=room)
    like = np.arange(room)
    used = np.array([count])
    changed = np.ones(room, np.bool_)
    for _ in range(_ROUNDS):
        rows = np.flatnonzero(work.mu2[: work.counters[0]] > threshold).astype(np.int32)
        # where nothing has changed, an attempt that failed would fail again
        rows = rows[changed[work.cells[rows]].any(axis=1)]
        queue = rows[np.argsort(-work.mu2[rows], kind="stable")]
        changed[:] = False
        if not _insert_all(work, tree, queue, like, used, changed, threshold, gain):
            break
    live = live_cells(work)
    kept = used_vertices(live.cells, room)
    point_data = {name: values[like[kept]] for name, values in mesh.point_data.items()}
    cell_data = {name: values[live.origin] for name, values in mesh.cell_data.items()}
    cells = numbers(kept, room)[live.cells]
    made = replace(mesh, points=work.points[kept], cells=cells, point_data=point_data, cell_data=cell_data)
    neighbours.remember(made, live.neighbours)
    return made, int(used[0]) - count


@numba.njit(cache=True, error_model="numpy")
def _insert_all(mesh, tree, queue, like, used, changed, threshold, gain):  # type: ignore[no-untyped-def]
    done = 0
    for e in queue:
        if mesh.cells[e, 0] < 0 or mesh.mu2[e] <= threshold:
            continue
        if used[0] == len(mesh.points) or mesh.counters[0] + 4 * _MOST > len(mesh.cells):
            break
        done += _insert(mesh, tree, e, like, used, changed, gain)
    return done


@numba.njit(cache=True, error_model="numpy")
def _insert(mesh, tree, e, like, used, changed, gain):  # type: ignore[no-untyped-def]
    """Try a new vertex on every edge, on every face and in the middle of a tetrahedron, and make the best one.

    Returns True if one was made, and then sets `changed` for the vertices around.
    """
    cavity, faces = np.empty(_MOST, np.int32), np.empty((4 * _MOST, 4), np.int32)
    best_cavity = np.empty(_MOST, np.int32)
    position, best_position = np.empty(3), np.empty(3)
    ring, around = np.empty(MAX_RING + 1, np.int32), np.empty(MAX_RING, np.int32)
    best, size = gain**2, 0
    for seed in range(11):
        count = _begun(mesh, e, seed, cavity, position, ring, around)
        if count == 0:
            continue
        ratio, count = _best_cavity(mesh, cavity, count, faces, position)
        if ratio < best:
            best, size = ratio, count
            best_cavity[:count], best_position[:] = cavity[:count], position
    if tree is not None and (flip_beside_lone(mesh, tree, e, changed) or remove_vertex(mesh, tree, e, changed, best)):
        return True
    if size == 0:
        return False
    v = used[0]
    used[0] += 1
    mesh.points[v] = best_position
    like[v] = like[mesh.cells[e, 0]]
    outer = _outer_faces(mesh, best_cavity, size, faces)
    new = np.empty((outer, 4), np.int32)
    for i in range(outer):
        new[i, 0], new[i, 1], new[i, 2], new[i, 3] = v, faces[i, 0], faces[i, 1], faces[i, 2]
        for j in range(4):
            changed[new[i, j]] = True
    rows = np.empty(max(size, outer), np.int32)
    rows[:size] = best_cavity[:size]
    replace_cells(mesh, rows, size, new, outer)
    return True


@numba.njit(cache=True, error_model="numpy")
def _begun(mesh, e, seed, cavity, position, ring, around):  # type: ignore[no-untyped-def]
    """Write the smallest cavity of a new vertex, and its `position`; return the number of tetrahedra, 0 for no vertex.

    Seeds 0 to 5 are the edges of tetrahedron e, 6 to 9 its faces, 10 its middle.
    """
    if seed < 6:
        a, b, n, tets = ring_around(mesh, e, EDGE_FRAMES[seed], ring, around)
        cavity[:tets] = around[:tets]
        position[:] = (mesh.points[a] + mesh.points[b]) / 2
        return tets if n == tets else 0
    cavity[0], count = e, 1
    if seed < 10:
        f = mesh.neighbours[e, seed - 6]
        if f < 0 or mesh.region[f] != mesh.region[e]:
            return 0
        cavity[1], count = f, 2
    position[:] = 0.0
    for i in range(4):
        if seed == 10 or i != seed - 6:
            position += mesh.points[mesh.cells[e, i]] / (4 if seed == 10 else 3)
    return count


@numba.njit(cache=True, error_model="numpy")
def _outer_faces(mesh, cavity, size, faces):  # type: ignore[no-untyped-def]
    """Write the faces around a cavity, outward, and the tetrahedron behind each (-1: none); return their number."""
    count = 0
    for done in range(size):
        count = _with_one_more(mesh, cavity, done, faces, count)
    return count


@numba.njit(cache=True, error_model="numpy")
def _with_one_more(mesh, cavity, size, faces, count):  # type: ignore[no-untyped-def]
    """Update the first `count` faces around cavity[:size], as `_outer_faces` does, for one more: cavity[size]."""
    e = cavity[size]
    kept = 0
    for i in range(count):
        if faces[i, 3] != e:
            for j in range(4):
                faces[kept, j] = faces[i, j]
            kept += 1
    for k in range(4):
        f = mesh.neighbours[e, k]
        inside = False
        for j in range(size):
            inside |= f == cavity[j]
        if not inside:
            for j in range(3):
                faces[kept, j] = mesh.cells[e, TET_FACES[k, j]]
            faces[kept, 3] = f
            kept += 1
    return kept


@numba.njit(cache=True, error_model="numpy")
def _best_cavity(mesh, cavity, count, faces, position):  # type: ignore[no-untyped-def]
    """Grow a cavity behind its worst face, and find the size whose filling improves the worst mu^2 most.

    Starts from cavity[:count] and a vertex at `position`; in the end, both hold the best that was found. Returns
    the new worst over the old, infinite if no filling is valid, and the size of the cavity.
    """
    star = empty_star()
    trial = position.copy()
    best, size = np.inf, count
    worst = 0.0
    for i in range(count):
        worst = max(worst, mesh.mu2[cavity[i]])
    outer = _outer_faces(mesh, cavity, count, faces)
    while True:
        achieved, at = _settled(mesh, faces, outer, trial, star, _STEPS)
        if achieved / worst < best:
            best, size = achieved / worst, count
            position[:] = trial
        behind = faces[at, 3]
        if behind < 0 or count == _MOST or count - size == _PATIENCE or mesh.region[behind] != mesh.region[cavity[0]]:
            return best, size
        cavity[count] = behind
        outer = _with_one_more(mesh, cavity, count, faces, outer)
        count += 1
        worst = max(worst, mesh.mu2[behind])


@numba.njit(cache=True, error_model="numpy")
def _settled(mesh, faces, outer, position, star, steps):  # type: ignore[no-untyped-def]
    """Move a vertex joined to all `faces` to where these tetrahedra are best; return their worst mu^2, and which."""
    for _ in range(steps):
        _rows(mesh, faces, outer, position, star)
        before = energy(star, outer, 0.0, 0.0, 0.0, _POWER // 2, np.inf)
        if not before < np.inf:
            break
        dx, dy, dz = newton_step(derivatives(star, outer, _POWER // 2))
        moved = False
        for _ in range(_BACKTRACKS):
            if energy(star, outer, dx, dy, dz, _POWER // 2, np.inf) < before:
                position[0], position[1], position[2] = position[0] + dx, position[1] + dy, position[2] + dz
                moved = True
                break
            dx, dy, dz = _SHRINK * dx, _SHRINK * dy, _SHRINK * dz
        if not moved:
            break
    _rows(mesh, faces, outer, position, star)
    find_mu2(star, outer, 0.0, 0.0, 0.0)
    worst, at, lowest = 0.0, 0, np.inf
    for i in range(outer):
        mu2, flatness = star[MU2 + i], star[FLATNESS + i]
        # if the vertex is behind several faces, take the one it is farthest behind
        if mu2 > worst or (mu2 == np.inf and flatness < lowest):
            worst, at = mu2, i
            lowest = flatness if mu2 == np.inf else np.inf
    return worst, at


@numba.njit(cache=True, error_model="numpy")
def _rows(mesh, faces, outer, position, star):  # type: ignore[no-untyped-def]
    points = mesh.points
    x, y, z = position[0], position[1], position[2]
    for i in range(outer):
        a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
        ax, ay, az = points[a, 0] - x, points[a, 1] - y, points[a, 2] - z
        bx, by, bz = points[b, 0] - x, points[b, 1] - y, points[b, 2] - z
        cx, cy, cz = points[c, 0] - x, points[c, 1] - y, points[c, 2] - z
        set_column(star, i, ax, ay, az, bx, by, bz, cx, cy, cz)
