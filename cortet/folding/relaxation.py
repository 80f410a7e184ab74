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

from cortet.folding.body import Body
from cortet.folding.kernels import Work
from cortet.folding.law import (
    combined,
    cross,
    dot,
    fast,
    grown_gradients,
    growth_share,
    inlined,
    inverse_cube_root,
    own_growth,
    scaled,
    vector,
)
from cortet.folding.smoothing import deformations, mean_deformation
from cortet.meshes import FloatArray, IntArray

#: part of tau after which tissue yields again
PART = 0.25
#: quality of a reference, 1 for a regular tetrahedron and 0 for a flat one, below which its element no longer yields
FLATTEST = 0.1


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


def relax(
    base: Body,
    body: Body,
    work: Work,
    growth: FloatArray,
    thickening: float,
    parts: FloatArray,
) -> None:
    """Let elements yield at the positions for which `kernels.energies` ran last: change gradients of `base` in place.

    The strain that relaxes is that of the edges of an element. What only the element has stays, so that it returns to
    the shape that its neighbours want.

    Parameters
    ----------
    base : the reference state
    body : the same as it has grown where growth was measured, else `base`
    growth, thickening : as for `kernels.elastic_forces`
    parts : (m,), 1 - exp(-dt / tau) of the core of each element
    """
    _relax(tuple(base), tuple(body), tuple(work.edges), growth, thickening, parts)


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _relax(base, body, edges, growth, thickening, parts):  # type: ignore[no-untyped-def]
    means = deformations(edges)
    for e in numba.prange(len(parts)):
        if parts[e] > 0:
            _yield(Body(*base), Body(*body), mean_deformation(edges, means, e), growth, thickening, parts[e], e)


@fast
def _yield(base, body, deformation, growth, thickening, part, e):  # type: ignore[no-untyped-def]
    """Let element e yield by a part of the strain of a deformation."""
    share = growth_share(body.depth[e], body.thickness[e] + thickening, body.mask[e])
    f0, f1, f2 = deformation
    j = dot(f0, cross(f1, f2))
    if not j > 0:
        return
    flow = _flow(f0, f1, f2, j, part * (1 - share))
    along, across, core = vector(growth, body.label[e])
    alpha, beta = own_growth(share, body.amount[e], along, across, core)
    own, n = base.gradients[e], vector(body.normals, e)
    isotropic = 1 - dot(n, n)
    a, b, c = vector(own, 0), vector(own, 1), vector(own, 2)
    before = quality(a, b, c)
    a, b, c = grown_gradients(a, b, c, n, isotropic, alpha, beta)
    a = _before_growth(_times(flow, a), n, alpha, beta)
    b = _before_growth(_times(flow, b), n, alpha, beta)
    c = _before_growth(_times(flow, c), n, alpha, beta)
    after = quality(a, b, c)
    if after < FLATTEST and after < before:
        return
    for k in range(3):
        own[0, k], own[1, k], own[2, k] = a[k], b[k], c[k]


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
