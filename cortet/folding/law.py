"""The law of one element, on plain numbers.

Constitutive law, per unit of grown volume, with F the elastic deformation gradient and B = F F^T:

    W = mu / 2 (J^(-2/3) tr B - 3) + K / 2 (J_node - 1)^2,    P = mu J^(-2/3) (F - tr B / 3 F^-T) + K (J~ - 1) J F^-T

J_node is the ratio of a node's current to its grown volume; J~ is its mean over an element's nodes. This averaging
removes the locking of linear tetrahedra, and the forces are still the gradient of the energy.

W grows without limit as an element becomes flat, so no time step could follow it there. In the stretches s of F,
J^(-2/3) is the product of phi(s) = s^(-2/3). Below a stretch of 0.1, phi is replaced by its second-order Taylor
polynomial there, which also covers the negative stretch of an inverted element (after Stomakhin et al., SCA 2012). The
energy stays smooth, and the flatter the element, the harder it is pushed open. Every entry into this branch is counted.

Vectors are tuples of three floats; matrices are tuples of three vectors, their rows. Numba keeps both in registers.
"""

from __future__ import annotations

import numba
import numpy as np

#: columns of growth, by label: that of the cortex along the surface and across it, and of the core in all directions
ALONG, ACROSS, CORE = 0, 1, 2

#: how sharply the share of the cortex falls at its lower side, per thickness
_SHARPNESS = 10.0

#: stretch below which the law is continued by a polynomial
SMALLEST_STRETCH = 0.1

#: compilation of functions of single elements and nodes
fast = numba.njit(fastmath={"contract"}, error_model="numpy", cache=True)
#: compilation of functions in a loop that must become vector instructions: a call left in the loop would prevent this
inlined = numba.njit(fastmath={"contract"}, error_model="numpy", cache=True, forceinline=True)


@inlined
def dot(a, b):  # type: ignore[no-untyped-def]
    """The dot product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):  # type: ignore[no-untyped-def]
    """The cross product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def combined(p, a, q, b):  # type: ignore[no-untyped-def]
    """p a + q b."""
    return p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2]


@inlined
def scaled(p, a):  # type: ignore[no-untyped-def]
    """p a."""
    return p * a[0], p * a[1], p * a[2]


@inlined
def vector(a, i):  # type: ignore[no-untyped-def]
    """Row i of an array (n, 3) as a vector."""
    return a[i, 0], a[i, 1], a[i, 2]


@inlined
def growth_share(depth, thickness, mask):  # type: ignore[no-untyped-def]
    """Share of the growth of the surface that an element takes part in, from 0 to 1."""
    return mask / (1 + exponential(_SHARPNESS * (depth / thickness - 1)))


@fast
def depth_of_share(share, thickness):  # type: ignore[no-untyped-def]
    """Depth at which the share of the cortex is `share`, at the mask 1."""
    return thickness * (1 + np.log(max(1 / share - 1, 1e-12)) / _SHARPNESS)


@inlined
def own_growth(share, amount, along, across, core):  # type: ignore[no-untyped-def]
    """Growth of an element along the surface and across it.

    Parameters
    ----------
    share : share of the element that is cortex, from 0 to 1
    amount : share of the tangential growth that the cortex takes part in
    along, across, core : growth of the cortex, tangential and radial, and of the core, in all directions
    """
    inside = (1 - share) * core
    return share * amount * along + inside, share * across + inside


@inlined
def grown_volume(volume, alpha, beta, isotropic):  # type: ignore[no-untyped-def]
    """Volume after growth by alpha along the surface and by beta across it, or by alpha in all directions."""
    return volume * (1 + alpha) * (1 + alpha) * (1 + (beta + (alpha - beta) * isotropic))


@inlined
def volume_between(u, v, w):  # type: ignore[no-untyped-def]
    """Volume of the tetrahedron with three edges from one corner."""
    return dot(u, cross(v, w)) / 6


@inlined
def grown_gradients(a, b, c, n, isotropic, alpha, beta):  # type: ignore[no-untyped-def]
    """Gradients of the shape functions after growth Fg = (1 + alpha) (I - n n^T) + (1 + beta) n n^T: A_r^-1 Fg^-1.

    `isotropic` is 1 - n n: 0, or 1 if an element has no direction n and grows by alpha in all of them.
    """
    s = 1 / (1 + alpha)
    t = s * (alpha - beta) / (1 + (beta + (alpha - beta) * isotropic))
    return combined(s, a, t * dot(a, n), n), combined(s, b, t * dot(b, n), n), combined(s, c, t * dot(c, n), n)


@inlined
def deformation(u, v, w, a, b, c):  # type: ignore[no-untyped-def]
    """Rows of F = u a^T + v b^T + w c^T from current edges and grown gradients."""
    return (
        combined(1.0, combined(u[0], a, v[0], b), w[0], c),
        combined(1.0, combined(u[1], a, v[1], b), w[1], c),
        combined(1.0, combined(u[2], a, v[2], b), w[2], c),
    )


@inlined
def exponential(x):  # type: ignore[no-untyped-def]
    """e^x to rounding, between e^-300 and e^300, without a call, so that the compiler can vectorise a loop with it."""
    x = min(max(x, -300.0), 300.0)
    # x = n ln 2 + r: adding 1.5 2^52 rounds to a whole number n, which is then in the last bits
    shifted = x * 1.4426950408889634 + 6755399441055744.0
    n = shifted - 6755399441055744.0
    r = (x - n * 6.93145751953125e-1) - n * 1.42860682030941723212e-6
    series = 1 / 362880 + r * (1 / 3628800 + r * (1 / 39916800 + r * (1 / 479001600)))
    series = 1 / 24 + r * (1 / 120 + r * (1 / 720 + r * (1 / 5040 + r * (1 / 40320 + r * series))))
    series = 1 + r * (1 + r * (1 / 2 + r * (1 / 6 + r * series)))
    return series * np.int64((np.float64(shifted).view(np.int64) + 1023) << 52).view(np.float64)


@inlined
def inverse_cube_root(j):  # type: ignore[no-untyped-def]
    """j^(-1/3) of a positive number, to rounding, without a call."""
    # the bits of a float, read as an integer, rise with its logarithm; this gives j^(-1/3) within some per cent.
    # Newton's iteration with two more terms of the series of (1 - r)^(-1/3) does the rest
    y = np.int64(6.142909891733356e18 - np.float64(np.float64(j).view(np.int64)) / 3).view(np.float64)
    for _ in range(3):
        r = 1 - j * (y * y * y)
        y += y * r * (1 / 3 + r * (2 / 9 + r * (14 / 81)))
    return y


@inlined
def shear_modulus(material, share, stiffness):  # type: ignore[no-untyped-def]
    """Shear modulus of an element: cortex by `share`, and the rest core, `stiffness` times as stiff as usual."""
    return material.mu_core * stiffness * (1 - share) + material.mu_cortex * share


@inlined
def stress(f0, f1, f2, mu, bulk):  # type: ignore[no-untyped-def]
    """Rows of P as if the element were not degenerate, its J, and tr B.

    Parameters
    ----------
    f0, f1, f2 : rows of F
    mu : shear modulus
    bulk : K (J~ - 1); multiply `mu` and `bulk` by the grown volume to get P times it
    """
    c0, c1, c2 = cross(f1, f2), cross(f2, f0), cross(f0, f1)  # cofactors: J F^-T
    j = dot(f0, c0)
    trace = dot(f0, f0) + dot(f1, f1) + dot(f2, f2)
    y = inverse_cube_root(j)
    p = mu * y * y
    r = bulk - p * trace * (y * y * y) * (1 / 3)
    return combined(p, f0, r, c0), combined(p, f1, r, c1), combined(p, f2, r, c2), j, trace


@inlined
def forces_on_corners(p0, p1, p2, a, b, c):  # type: ignore[no-untyped-def]
    """Forces of an element on its corners 1, 2 and 3 from the rows of its stress P and its grown gradients."""
    return (
        (-dot(p0, a), -dot(p1, a), -dot(p2, a)),
        (-dot(p0, b), -dot(p1, b), -dot(p2, b)),
        (-dot(p0, c), -dot(p1, c), -dot(p2, c)),
    )


# --- degenerate elements ---------------------------------------------------------------------------------------------


@fast
def may_be_degenerate(j, trace):  # type: ignore[no-untyped-def]
    """False for nearly all elements, whose stretches are then not needed: the smallest is at least 2 J / tr B."""
    return 2 * j < SMALLEST_STRETCH * trace


@fast
def phi(s):  # type: ignore[no-untyped-def]
    """s^(-2/3), continued below the smallest stretch, and its derivative."""
    if s >= SMALLEST_STRETCH:
        return s ** (-2 / 3), -2 / 3 * s ** (-5 / 3)
    at, r = SMALLEST_STRETCH ** (-2 / 3), s / SMALLEST_STRETCH - 1
    return at * (1 - 2 / 3 * r + 5 / 9 * r * r), at / SMALLEST_STRETCH * (-2 / 3 + 10 / 9 * r)


@numba.njit(cache=True, error_model="numpy")
def stretches(f0, f1, f2):  # type: ignore[no-untyped-def]
    """U, s and V^T of F = U diag(s) V^T, s descending; of an inverted element the last s is negative, not U or V^T."""
    f = np.array([[f0[0], f0[1], f0[2]], [f1[0], f1[1], f1[2]], [f2[0], f2[1], f2[2]]])
    u, s, vt = np.linalg.svd(f)
    if dot(f0, cross(f1, f2)) < 0:
        u[:, 2] *= -1
        s[2] *= -1
    return u, s, vt


@numba.njit(cache=True, error_model="numpy")
def degenerate_stress(u, s, vt, mu):  # type: ignore[no-untyped-def]
    """Rows of the deviatoric P from the stretches of F."""
    (a, da), (b, db), (c, dc) = phi(s[0]), phi(s[1]), phi(s[2])
    principal = mu / 2 * (s**2).sum() * np.array([da * b * c, a * db * c, a * b * dc]) + mu * a * b * c * s
    p = (u * principal) @ vt
    return (p[0, 0], p[0, 1], p[0, 2]), (p[1, 0], p[1, 1], p[1, 2]), (p[2, 0], p[2, 1], p[2, 2])
