"""Tissue that yields: the core grows where it is pulled (Bayly et al., Physical Biology 10, 2013).

As a Maxwell body, tissue flows in proportion to its shear stress, so that strain relaxes in a time tau. The deformation
is F = Fe Fv Fg: growth, then viscous flow, then elastic strain. With C = J^(-2/3) Fe^T Fe, which is proportional to the
stress of the neo-Hookean law, Fv becomes, in a time dt,

    ((1 - p / 2) I + p / 2 C) Fv, divided by the cube root of its determinant,    p = 1 - exp(-dt / tau)

This is exact where strains are small, and of first order in dt beyond. The determinant of Fv stays 1: tissue yields in
shape, not in volume. An element that is partly cortex yields in proportion to its part of the core.

The gradients of the reference state are replaced between steps, so the kernels of the steps know nothing of this. A
reference follows its element and may become as flat, and then as stiff. An element no longer yields where its reference
would become flatter than `FLATTEST`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numba
import numpy as np

from cortet.folding.elements import ALPHA, BETA, CURRENT, EDGES, SHARE, SMOOTHED, at, grow_elements, put, tensor
from cortet.folding.kernels import Work
from cortet.folding.law import combined, cross, dot, fast, grown_gradients, inlined, inverse_cube_root, scaled
from cortet.folding.patches import ISOTROPIC, NORMAL, SIZE, Patches
from cortet.folding.smoothing import PER_ELEMENT, Edges, add_edges
from cortet.meshes import FloatArray, IntArray

#: part of tau after which tissue yields again
PART = 0.25
#: quality of a reference, 1 for a regular tetrahedron and 0 for a flat one, below which its element no longer yields
FLATTEST = 0.1
#: row of a patch's own memory for the part of its strain by which an element yields; `grow_elements` writes to it first
_PART = CURRENT


class Relaxation(NamedTuple):
    """How fast the core yields."""

    #: (m,), number of the law of each element
    law: IntArray
    #: relaxation time of each law, weeks, at ages; "elastic": it does not relax
    times: Sequence[Mapping[float, float] | float | Literal["elastic"]]

    def rates(self, age: float) -> FloatArray:
        """1 / tau of each law at an age, 1 / week: (k,)."""
        return np.array([_rate(time, age) for time in self.times])


def _rate(time: Mapping[float, float] | float | Literal["elastic"], age: float) -> float:
    if isinstance(time, str):
        return 0.0
    if isinstance(time, Mapping):
        time = float(np.interp(age, sorted(time), [time[known] for known in sorted(time)]))
    return 1 / time


def relax(gradients: FloatArray, work: Work, growth: FloatArray, thickening: float, parts: FloatArray) -> None:
    """Let elements yield at the positions for which `kernels.energies` ran last: change their gradients in place.

    The strain that relaxes is that of the edges of an element. What only the element has stays, so that it returns to
    the shape that its neighbours want.

    Parameters
    ----------
    gradients : (m, 3, 3), of the reference state, without growth that was measured
    work : its patches have the body, as it has grown where growth was measured (`patches.renew`)
    growth, thickening : as for `kernels.elastic_forces`
    parts : (m,), 1 - exp(-dt / tau) of the core of each element
    """
    _relax(gradients, tuple(work.patches), tuple(work.edges), growth, thickening, parts, work.own_rows)


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _relax(gradients, patches, edges, growth, thickening, parts, own_rows):  # type: ignore[no-untyped-def]
    for patch in numba.prange((len(parts) + SIZE - 1) // SIZE):
        rows, constants = own_rows[numba.get_thread_id()], Patches(*patches).constants[patch]  # type: ignore[attr-defined]
        first, last = patch * SIZE, min(len(parts), (patch + 1) * SIZE)
        add_edges(patch, last - first, Edges(*edges).of_element, Edges(*edges).deformation, rows)
        grow_elements(rows, constants, Patches(*patches).label[patch], growth, thickening)
        for i in range(first, last):
            rows[_PART * SIZE + i - first] = parts[i]
            for k in range(9):
                rows[(EDGES + k) * SIZE + i - first] = gradients[i, k // 3, k % 3]
        _yield(rows, constants)
        for i in range(first, last):
            for k in range(9):
                gradients[i, k // 3, k % 3] = rows[(EDGES + k) * SIZE + i - first]


@fast
def _yield(rows, constants):  # type: ignore[no-untyped-def]
    """Let each element of a patch yield: change its gradients, in the rows EDGES; SMOOTHED has six times F."""
    for e in range(SIZE):
        f0, f1, f2 = tensor(rows, SMOOTHED, e)
        f0, f1, f2 = scaled(1 / PER_ELEMENT, f0), scaled(1 / PER_ELEMENT, f1), scaled(1 / PER_ELEMENT, f2)
        j, part = dot(f0, cross(f1, f2)), rows[_PART * SIZE + e]
        flow = _flow(f0, f1, f2, j, part * (1 - rows[SHARE * SIZE + e]))
        alpha, beta = rows[ALPHA * SIZE + e], rows[BETA * SIZE + e]
        n, isotropic = at(constants, NORMAL, e), constants[ISOTROPIC * SIZE + e]
        a, b, c = tensor(rows, EDGES, e)
        u, v, w = grown_gradients(a, b, c, n, isotropic, alpha, beta)
        u = _before_growth(_times(flow, u), n, alpha, beta)
        v = _before_growth(_times(flow, v), n, alpha, beta)
        w = _before_growth(_times(flow, w), n, alpha, beta)
        after = quality(u, v, w)  # NaN, of an inverted element, compares as false
        yields = (part > 0) & (j > 0) & ((after >= FLATTEST) | (after >= quality(a, b, c)))
        put(rows, EDGES, e, _chosen(yields, u, a))
        put(rows, EDGES + 3, e, _chosen(yields, v, b))
        put(rows, EDGES + 6, e, _chosen(yields, w, c))


@inlined
def _chosen(first, a, b):  # type: ignore[no-untyped-def]
    """One of two vectors, without a branch."""
    return a[0] if first else b[0], a[1] if first else b[1], a[2] if first else b[2]


@inlined
def _flow(f0, f1, f2, j, part):  # type: ignore[no-untyped-def]
    """Rows of the inverse of the flow in which a part of the strain of F relaxes; j is the determinant of F."""
    s = inverse_cube_root(j)
    x, y, z = (s * f0[0], s * f1[0], s * f2[0]), (s * f0[1], s * f1[1], s * f2[1]), (s * f0[2], s * f1[2], s * f2[2])
    xx, yy, zz, xy, xz, yz = dot(x, x), dot(y, y), dot(z, z), dot(x, y), dot(x, z), dot(y, z)
    p = min(part / 2, 1 / (1 + xx + yy + zz))  # more would turn the strain around where it is largest
    a, b, c, d, e, f = 1 - p + p * xx, 1 - p + p * yy, 1 - p + p * zz, p * xy, p * xz, p * yz
    first = (b * c - f * f, e * f - d * c, d * f - e * b)  # cofactors of (1 - p) I + p C
    second, third = (first[1], a * c - e * e, d * e - a * f), (first[2], d * e - a * f, a * b - d * d)
    s = inverse_cube_root(a * first[0] + d * first[1] + e * first[2])
    return scaled(s * s, first), scaled(s * s, second), scaled(s * s, third)


@inlined
def _times(m, a):  # type: ignore[no-untyped-def]
    """The product of a matrix, three rows, and a vector."""
    return dot(m[0], a), dot(m[1], a), dot(m[2], a)


@inlined
def _before_growth(g, n, alpha, beta):  # type: ignore[no-untyped-def]
    """The gradient that growth makes the gradient g of: the inverse of `law.grown_gradients`."""
    return combined(1 + alpha, g, (beta - alpha) * dot(g, n), n)


@inlined
def quality(a, b, c):  # type: ignore[no-untyped-def]
    """Mean ratio of the tetrahedron whose shape functions have the gradients a, b and c: 1 if regular, 0 if flat."""
    u, v, w = cross(b, c), cross(c, a), cross(a, b)  # its edges times the determinant
    squares = dot(u, u) + dot(v, v) + dot(w, w)
    # |u - v|^2 + |v - w|^2 + |w - u|^2 = 2 squares - 2 (u v + v w + w u)
    squares = 3 * squares - 2 * (dot(u, v) + dot(v, w) + dot(w, u))
    s = inverse_cube_root(dot(a, u) * dot(a, u) / 2)
    return 12 / (s * s * squares)
