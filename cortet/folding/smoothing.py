"""Elements that bend: the deformation of a linear tetrahedron is smoothed over those around its edges.

Linear tetrahedra resist bending too much. Here the shear energy is that of edges (Liu and Nguyen-Thoi, Smoothed Finite
Element Methods, 2010; with nodal pressures: Onishi, Iida and Amaya, International Journal for Numerical Methods in
Engineering 109, 2017). Around an edge, F is the mean over its tetrahedra t, weighted by w = mu V:

    F_e = sum(w_t F_t) / sum(w_t),    W_e = sum(w_t) / 6 (I(F_e) - 3) / 2,    I = J^(-2/3) tr B

The weight has the modulus in it, so that the mean stress of a stiff layer stays what it is. A single tetrahedron has
little part in its edges, and could collapse. So it has a part of its energy, `Material.own`, from its own F. A patch
test is passed exactly for any part.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.folding.elements import EDGES, GROWN, MEAN, SMOOTHED, J, put_tensor, tensor
from cortet.folding.law import (
    SMALLEST_STRETCH,
    cross,
    degenerate_stress,
    dot,
    fast,
    inlined,
    inverse_cube_root,
    may_be_degenerate,
    phi,
    scaled,
    stress,
    stretches,
)
from cortet.folding.patches import SIZE
from cortet.geometry.topology import packed
from cortet.meshes import FloatArray, IntArray

#: pairs of corners of a tetrahedron
_PAIRS = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
#: number of edges of a tetrahedron
PER_ELEMENT = len(_PAIRS)
#: numbers of an element that edges need, and of an edge that elements need: one, and a tensor
TEN = 10


class Edges(NamedTuple):
    """d edges of m elements, in the order of their first elements."""

    #: (6 m,) int, edges of each element
    of_element: NDArray[np.int64]
    #: elements around edge i: around[starts[i]:starts[i + 1]]
    starts: NDArray[np.int64]
    around: NDArray[np.int64]
    #: (10 m,), weight of each element and F times it
    weighted: FloatArray
    #: (10 d,) each, nothing and a tensor of each edge: its stress at the last positions for which forces were computed;
    #: its F at those for which `kernels.energies` ran last
    stress: FloatArray
    deformation: FloatArray


def edges_of(cells: IntArray, *, smoothed: bool = True) -> Edges:
    """The edges of a body with these elements (m, 4); of none if it is not smoothed."""
    if not smoothed:
        none = np.zeros(0, np.int64)
        return Edges(none, np.zeros(1, np.int64), none, *np.zeros((3, 0)))
    _, first, ids = np.unique(packed(cells[:, _PAIRS].reshape(-1, 2)), return_index=True, return_inverse=True)
    place = np.empty(len(first), np.int64)
    place[np.argsort(first, kind="stable")] = np.arange(len(first))
    ids = place[ids]
    return Edges(
        of_element=ids,
        starts=np.append(0, np.cumsum(np.bincount(ids))),
        around=np.argsort(ids, kind="stable") // PER_ELEMENT,
        weighted=np.zeros(len(cells) * TEN),
        stress=np.zeros(len(first) * TEN),
        deformation=np.zeros(len(first) * TEN),
    )


@inlined
def _summed(values, places, first, last):  # type: ignore[no-untyped-def]
    """Sum of the ten numbers at each of places[first:last]."""
    w, a, b, c, d, e, f, g, h, k = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for at in range(first, last):
        t = places[at] * TEN  # one index into a flat array is faster than two
        w += values[t]
        a += values[t + 1]
        b += values[t + 2]
        c += values[t + 3]
        d += values[t + 4]
        e += values[t + 5]
        f += values[t + 6]
        g += values[t + 7]
        h += values[t + 8]
        k += values[t + 9]
    return w, a, b, c, d, e, f, g, h, k


@inlined
def edge_deformation(deformation, i):  # type: ignore[no-untyped-def]
    """Rows of F of edge i, from `Edges.deformation`."""
    f, t = deformation, i * TEN + 1
    return (f[t], f[t + 1], f[t + 2]), (f[t + 3], f[t + 4], f[t + 5]), (f[t + 6], f[t + 7], f[t + 8])


@fast
def _sum_edges(first, last, edges, rows):  # type: ignore[no-untyped-def]
    """Write weight and weighted F of a block of at most SIZE edges to rows, as those of elements are."""
    _of_element, starts, around, weighted, _stress, _deformation = edges
    for i in range(first, last):
        w, a, b, c, d, e, f, g, h, k = _summed(weighted, around, starts[i], starts[i + 1])
        rows[MEAN * SIZE + i - first] = w
        put_tensor(rows, EDGES, i - first, (a, b, c), (d, e, f), (g, h, k))


@inlined
def _deformation(rows, o):  # type: ignore[no-untyped-def]
    """Rows of F from those of weighted F."""
    r, (f0, f1, f2) = 1 / rows[MEAN * SIZE + o], tensor(rows, EDGES, o)
    return scaled(r, f0), scaled(r, f1), scaled(r, f2)


@fast
def stress_edges(first, last, edges, part, rows):  # type: ignore[no-untyped-def]
    """Stress of a block of at most SIZE edges, for a modulus of `part`; return how many are degenerate."""
    _sum_edges(first, last, edges, rows)
    for o in range(SIZE):
        f0, f1, f2 = _deformation(rows, o)
        p0, p1, p2, j, trace = stress(f0, f1, f2, part, 0.0)
        put_tensor(rows, SMOOTHED, o, p0, p1, p2)
        rows[J * SIZE + o] = j
        rows[GROWN * SIZE + o] = trace
    degenerate = 0
    for i in range(first, last):
        o = i - first
        if may_be_degenerate(rows[J * SIZE + o], rows[GROWN * SIZE + o]):
            degenerate += _open(rows, o, part)
        for k in range(9):
            Edges(*edges).stress[i * TEN + 1 + k] = rows[(SMOOTHED + k) * SIZE + o]
    return degenerate


@fast
def energy_of_edges(first, last, edges, rows, energy):  # type: ignore[no-untyped-def]
    """Shear energy (d,) of a block of at most SIZE edges, whose F stays in `edges.deformation`."""
    _sum_edges(first, last, edges, rows)
    energy_of_rows(first, last, rows, energy)
    for i in range(first, last):
        r = 1 / rows[MEAN * SIZE + i - first]
        for k in range(9):
            Edges(*edges).deformation[i * TEN + 1 + k] = r * rows[(EDGES + k) * SIZE + i - first]


@fast
def energy_of_rows(first, last, rows, energy):  # type: ignore[no-untyped-def]
    """Shear energy of elements or edges from their weights and weighted F: w (I - 3) / 2."""
    for o in range(SIZE):
        f0, f1, f2 = _deformation(rows, o)
        j, trace = dot(f0, cross(f1, f2)), dot(f0, f0) + dot(f1, f1) + dot(f2, f2)
        y = inverse_cube_root(j)
        rows[J * SIZE + o], rows[GROWN * SIZE + o] = j, trace
        rows[SMOOTHED * SIZE + o] = rows[MEAN * SIZE + o] / 2 * (y * y * trace - 3)
    for i in range(first, last):
        o = i - first
        energy[i] = rows[SMOOTHED * SIZE + o]
        if may_be_degenerate(rows[J * SIZE + o], rows[GROWN * SIZE + o]):
            stretch = stretches(*_deformation(rows, o))[1]
            factor = phi(stretch[0])[0] * phi(stretch[1])[0] * phi(stretch[2])[0]
            energy[i] = rows[MEAN * SIZE + o] / 2 * (factor * rows[GROWN * SIZE + o] - 3)


@fast
def put_weighted(patch, elements, edges, rows):  # type: ignore[no-untyped-def]
    """Write weight and weighted F of the elements of a patch, from its rows, to where edges find them."""
    weighted, first = edges[3], patch * SIZE
    for e in range(min(SIZE, elements - first)):
        t = (first + e) * TEN
        weighted[t] = rows[MEAN * SIZE + e]
        for k in range(9):
            weighted[t + 1 + k] = rows[(EDGES + k) * SIZE + e]


@fast
def add_edges(patch, count, of_element, tensors, rows):  # type: ignore[no-untyped-def]
    """Write the sum of the tensors of the six edges of each element of a patch, stresses or F, to its rows SMOOTHED."""
    for e in range(count):
        first = (patch * SIZE + e) * PER_ELEMENT
        _, a, b, c, d, f, g, h, i, j = _summed(tensors, of_element, first, first + PER_ELEMENT)
        put_tensor(rows, SMOOTHED, e, (a, b, c), (d, f, g), (h, i, j))


@numba.njit(cache=True, error_model="numpy")
def _open(rows, o, part):  # type: ignore[no-untyped-def]
    """Write the stress of an edge that may be in the degenerate branch; return whether it is."""
    left, stretch, right = stretches(*_deformation(rows, o))
    if not stretch[2] < SMALLEST_STRETCH:
        return False
    put_tensor(rows, SMOOTHED, o, *degenerate_stress(left, stretch, right, part))
    return True
