"""Tissue that yields: the core grows where it is pulled (Bayly et al., Physical Biology 10, 2013).

As a Maxwell body, tissue relaxes its deviatoric elastic strain in a time tau. The deformation is F = Fe Fv Fg: growth,
then viscous flow, then elastic strain. In a time dt, Fv becomes exp(p dev log Ce / 2) Fv with p = 1 - exp(-dt / tau).
The determinant of Fv stays 1: tissue yields in shape, not in volume. An element that is partly cortex yields in
proportion to its part of the core.

The gradients of the reference state are replaced between steps, so the kernels of the steps know nothing of this. A
reference follows its element and may become as flat, and then as stiff. An element no longer yields where its reference
would become flatter than `FLATTEST`.
"""

from __future__ import annotations

import math
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
    own_growth,
    vector,
)
from cortet.folding.smoothing import PER_ELEMENT, deformations
from cortet.meshes import FloatArray, IntArray

#: part of tau after which tissue yields again
PART = 0.25
#: quality of a reference, 1 for a regular tetrahedron and 0 for a flat one, below which its element no longer yields
FLATTEST = 0.1
#: stretch of an element below which its reference stays as it is
_SMALLEST = 0.02
#: sweeps over all three pairs of columns; 5 are enough for most matrices
_SWEEPS = 12
#: cosine of the angle between two columns below which they are orthogonal to rounding
_ORTHOGONAL = 1e-16


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
            _yield(Body(*base), Body(*body), _mean_of_edges(edges, means, e), growth, thickening, parts[e], e)


@fast
def _mean_of_edges(edges, means, e):  # type: ignore[no-untyped-def]
    """Rows of the mean F of the edges of element e."""
    mean = np.zeros(9)
    for k in range(PER_ELEMENT):
        mean += means[edges[0][e * PER_ELEMENT + k]] / PER_ELEMENT
    return (mean[0], mean[1], mean[2]), (mean[3], mean[4], mean[5]), (mean[6], mean[7], mean[8])


@fast
def _yield(base, body, deformation, growth, thickening, part, e):  # type: ignore[no-untyped-def]
    """Let element e yield by a part of the strain of a deformation."""
    share = growth_share(body.depth[e], body.thickness[e] + thickening, body.mask[e])
    part *= 1 - share
    along, across, core = vector(growth, body.label[e])
    alpha, beta = own_growth(share, body.amount[e], along, across, core)
    n, (f0, f1, f2) = vector(body.normals, e), deformation
    isotropic = 1 - dot(n, n)
    (p, q, r), axes = squared_stretches(f0, f1, f2)
    if not (min(p, q, r) > _SMALLEST * _SMALLEST and dot(f0, cross(f1, f2)) > 0):
        return
    mean = (p * q * r) ** (1 / 3)
    p, q, r = p / mean, q / mean, r / mean
    factors = math.exp(-part / 2 * math.log(p)), math.exp(-part / 2 * math.log(q)), math.exp(-part / 2 * math.log(r))
    own = base.gradients[e]
    a, b, c = vector(own, 0), vector(own, 1), vector(own, 2)
    before = quality(a, b, c)
    a, b, c = grown_gradients(a, b, c, n, isotropic, alpha, beta)
    a = _before_growth(_yielded(a, axes, factors), n, alpha, beta)
    b = _before_growth(_yielded(b, axes, factors), n, alpha, beta)
    c = _before_growth(_yielded(c, axes, factors), n, alpha, beta)
    after = quality(a, b, c)
    if after < FLATTEST and after < before:
        return
    for k in range(3):
        own[0, k], own[1, k], own[2, k] = a[k], b[k], c[k]


@inlined
def _before_growth(g, n, alpha, beta):  # type: ignore[no-untyped-def]
    """The gradient that growth makes the gradient g of: the inverse of `law.grown_gradients`."""
    return combined(1 + alpha, g, (beta - alpha) * dot(g, n), n)


@inlined
def _yielded(g, axes, factors):  # type: ignore[no-untyped-def]
    """A gradient whose components along three axes are multiplied by factors."""
    u, v, w = axes
    return combined(1.0, combined(factors[0] * dot(g, u), u, factors[1] * dot(g, v), v), factors[2] * dot(g, w), w)


@inlined
def quality(a, b, c):  # type: ignore[no-untyped-def]
    """Mean ratio of the tetrahedron whose shape functions have the gradients a, b and c: 1 if regular, 0 if flat."""
    u, v, w = cross(b, c), cross(c, a), cross(a, b)  # its edges times the determinant
    squares = dot(u, u) + dot(v, v) + dot(w, w)
    # |u - v|^2 + |v - w|^2 + |w - u|^2 = 2 squares - 2 (u v + v w + w u)
    squares = 3 * squares - 2 * (dot(u, v) + dot(v, w) + dot(w, u))
    determinant = dot(a, u)
    return 12 * (abs(determinant * determinant) / 2) ** (2 / 3) / squares


@fast
def squared_stretches(f0, f1, f2):  # type: ignore[no-untyped-def]
    """Squares of the stretches of F, and their axes: the columns of V, for which those of F V are orthogonal.

    Pairs of columns are rotated in their plane until all are (Hestenes, Journal of the Society for Industrial and
    Applied Mathematics 6, 1958).
    """
    x, y, z = (f0[0], f1[0], f2[0]), (f0[1], f1[1], f2[1]), (f0[2], f1[2], f2[2])
    u, v, w = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    for _ in range(_SWEEPS):
        first, x, y, u, v = _rotated(x, y, u, v)
        second, x, z, u, w = _rotated(x, z, u, w)
        third, y, z, v, w = _rotated(y, z, v, w)
        if not (first or second or third):
            break
    return (dot(x, x), dot(y, y), dot(z, z)), (u, v, w)


@inlined
def _rotated(x, y, u, v):  # type: ignore[no-untyped-def]
    """Whether two columns were not orthogonal; then both, and those of V, after the rotation that makes them so."""
    xx, yy, xy = dot(x, x), dot(y, y), dot(x, y)
    if not abs(xy) > _ORTHOGONAL * math.sqrt(xx * yy):
        return False, x, y, u, v
    half = (yy - xx) / (2 * xy)
    tangent = (1.0 if half >= 0 else -1.0) / (abs(half) + math.sqrt(1 + half * half))
    cosine = 1 / math.sqrt(1 + tangent * tangent)
    sine = tangent * cosine
    return (
        True,
        combined(cosine, x, -sine, y),
        combined(sine, x, cosine, y),
        combined(cosine, u, -sine, v),
        combined(sine, u, cosine, v),
    )
