"""The computations in the elements of a patch: compiled loops over the rows of the patch's own memory.

The loops have the same arithmetic for every element and no branch, so the compiler makes vector instructions of them
(`docs/notes/design.md` gives their timings). Elements in the degenerate branch are rare, so they are computed again,
one by one. The mathematics is in `law`.
"""
# Rows of a patch lie in one array at constant offsets, so that the compiler sees that they do not overlap.

from __future__ import annotations

import numba

from cortet.folding.law import (
    ACROSS,
    ALONG,
    CORE,
    SMALLEST_STRETCH,
    combined,
    cross,
    deformation,
    degenerate_stress,
    fast,
    forces_on_corners,
    grown_gradients,
    grown_volume,
    growth_share,
    inlined,
    own_growth,
    scaled,
    shear_modulus,
    stress,
    stretches,
    vector,
    volume_between,
)
from cortet.folding.patches import AMOUNT, DEPTH, GRADIENTS, ISOTROPIC, MASK, NORMAL, SIZE, STIFFNESS, THICKNESS, VOLUME

#: rows of a patch's own memory, few, so that they fit in the cache: edges from corner 0, later replaced by the forces
#: on the corners 1, 2 and 3; share of the cortex, growth along and across it, grown volume; current volume, later
#: replaced by J; the mean ratio of the nodal volumes, which replaces the growth of the core and gives way to tr B; and
#: the sum of the stresses of its six edges (`smoothing`). For `relaxation`, gradients in place of edges, F of stresses
EDGES, SHARE, ALPHA, BETA, GROWN, CURRENT, MEAN, SMOOTHED, OWN_ROWS = 0, 9, 10, 11, 12, 13, 14, 15, 24
J, TRACE = CURRENT, MEAN


@inlined
def at(rows, row, e):  # type: ignore[no-untyped-def]
    """The vector of element e of a patch whose components are in the three rows from `row` on."""
    return rows[row * SIZE + e], rows[(row + 1) * SIZE + e], rows[(row + 2) * SIZE + e]


@inlined
def put(rows, row, e, a):  # type: ignore[no-untyped-def]
    """Write the vector a to these rows."""
    rows[row * SIZE + e], rows[(row + 1) * SIZE + e], rows[(row + 2) * SIZE + e] = a


@inlined
def tensor(rows, row, e):  # type: ignore[no-untyped-def]
    """The tensor of element e of a patch whose components are in the nine rows from `row` on."""
    return at(rows, row, e), at(rows, row + 3, e), at(rows, row + 6, e)


@inlined
def put_tensor(rows, row, e, f0, f1, f2):  # type: ignore[no-untyped-def]
    """Write the rows of a tensor to these rows."""
    put(rows, row, e, f0)
    put(rows, row + 3, e, f1)
    put(rows, row + 6, e, f2)


@fast
def edges_of_elements(rows, corners, x):  # type: ignore[no-untyped-def]
    """The three edges from corner 0 of each element of a patch, from the positions of its own nodes."""
    for e in range(SIZE):
        origin = vector(x, corners[e])
        for k in range(3):
            put(rows, EDGES + 3 * k, e, combined(1.0, vector(x, corners[(k + 1) * SIZE + e]), -1.0, origin))


@fast
def grow_elements(rows, constants, label, growth, thickening):  # type: ignore[no-untyped-def]
    """Growth, grown and current volume of each element of a patch."""
    for e in range(SIZE):
        rows[ALPHA * SIZE + e] = growth[label[e], ALONG]
        rows[BETA * SIZE + e] = growth[label[e], ACROSS]
        rows[MEAN * SIZE + e] = growth[label[e], CORE]
    for e in range(SIZE):
        thickness = constants[THICKNESS * SIZE + e] + thickening
        share = growth_share(constants[DEPTH * SIZE + e], thickness, constants[MASK * SIZE + e])
        along, across, core = rows[ALPHA * SIZE + e], rows[BETA * SIZE + e], rows[MEAN * SIZE + e]
        alpha, beta = own_growth(share, constants[AMOUNT * SIZE + e], along, across, core)
        rows[SHARE * SIZE + e] = share
        rows[ALPHA * SIZE + e] = alpha
        rows[BETA * SIZE + e] = beta
        volume, isotropic = constants[VOLUME * SIZE + e], constants[ISOTROPIC * SIZE + e]
        rows[GROWN * SIZE + e] = grown_volume(volume, alpha, beta, isotropic)
        rows[CURRENT * SIZE + e] = volume_between(at(rows, EDGES, e), at(rows, EDGES + 3, e), at(rows, EDGES + 6, e))


@inlined
def own_gradients(constants, e, alpha, beta):  # type: ignore[no-untyped-def]
    """Grown gradients of element e of a patch."""
    a, b, c = at(constants, GRADIENTS, e), at(constants, GRADIENTS + 3, e), at(constants, GRADIENTS + 6, e)
    return grown_gradients(a, b, c, at(constants, NORMAL, e), constants[ISOTROPIC * SIZE + e], alpha, beta)


@inlined
def own_modulus(constants, material, e, share):  # type: ignore[no-untyped-def]
    """Shear modulus of element e of a patch."""
    return shear_modulus(material, share, constants[STIFFNESS * SIZE + e])


@fast
def weigh_elements(rows, constants, material):  # type: ignore[no-untyped-def]
    """Replace the edges of each element by F times its weight, modulus times grown volume, which replaces the mean."""
    for e in range(SIZE):
        a, b, c = own_gradients(constants, e, rows[ALPHA * SIZE + e], rows[BETA * SIZE + e])
        f0, f1, f2 = deformation(at(rows, EDGES, e), at(rows, EDGES + 3, e), at(rows, EDGES + 6, e), a, b, c)
        weight = rows[GROWN * SIZE + e] * own_modulus(constants, material, e, rows[SHARE * SIZE + e])
        put_tensor(rows, EDGES, e, scaled(weight, f0), scaled(weight, f1), scaled(weight, f2))
        rows[MEAN * SIZE + e] = weight


@fast
def stress_elements(rows, constants, material):  # type: ignore[no-untyped-def]
    """Replace the edges of each element by the forces on its corners 1, 2 and 3, as if none were degenerate."""
    for e in range(SIZE):
        a, b, c = own_gradients(constants, e, rows[ALPHA * SIZE + e], rows[BETA * SIZE + e])
        f0, f1, f2 = deformation(at(rows, EDGES, e), at(rows, EDGES + 3, e), at(rows, EDGES + 6, e), a, b, c)
        grown, mu = rows[GROWN * SIZE + e], own_modulus(constants, material, e, rows[SHARE * SIZE + e])
        pressure = grown * material.bulk * (rows[MEAN * SIZE + e] - 1)
        weight, (s0, s1, s2) = grown * mu, tensor(rows, SMOOTHED, e)
        p0, p1, p2, j, trace = stress(f0, f1, f2, material.own * weight, pressure)
        p0, p1, p2 = combined(1.0, p0, weight, s0), combined(1.0, p1, weight, s1), combined(1.0, p2, weight, s2)
        put_tensor(rows, EDGES, e, *forces_on_corners(p0, p1, p2, a, b, c))
        rows[J * SIZE + e] = j
        rows[TRACE * SIZE + e] = trace


@numba.njit(cache=True, error_model="numpy")
def open_degenerate(rows, constants, material, e, x, corners):  # type: ignore[no-untyped-def]
    """Write the forces of an element that may be in the degenerate branch; return whether it is."""
    origin = vector(x, corners[e])
    u = combined(1.0, vector(x, corners[SIZE + e]), -1.0, origin)
    v = combined(1.0, vector(x, corners[2 * SIZE + e]), -1.0, origin)
    w = combined(1.0, vector(x, corners[3 * SIZE + e]), -1.0, origin)
    a, b, c = own_gradients(constants, e, rows[ALPHA * SIZE + e], rows[BETA * SIZE + e])
    f0, f1, f2 = deformation(u, v, w, a, b, c)
    left, stretch, right = stretches(f0, f1, f2)
    if not stretch[2] < SMALLEST_STRETCH:
        return False
    grown = rows[GROWN * SIZE + e]
    mu = own_modulus(constants, material, e, rows[SHARE * SIZE + e])
    weight, (s0, s1, s2) = grown * mu, tensor(rows, SMOOTHED, e)
    p0, p1, p2 = degenerate_stress(left, stretch, right, material.own * weight)
    p0, p1, p2 = combined(1.0, p0, weight, s0), combined(1.0, p1, weight, s1), combined(1.0, p2, weight, s2)
    q = grown * material.bulk * (mean_ratio(x, corners, e) - 1)
    p0, p1, p2 = (
        combined(1.0, p0, q, cross(f1, f2)),
        combined(1.0, p1, q, cross(f2, f0)),
        combined(1.0, p2, q, cross(f0, f1)),
    )
    put_tensor(rows, EDGES, e, *forces_on_corners(p0, p1, p2, a, b, c))
    return True


@inlined
def mean_ratio(own, corners, e):  # type: ignore[no-untyped-def]
    """Mean, over the corners of an element, of the ratio of current to grown volume around them."""
    a, b, c, d = corners[e], corners[SIZE + e], corners[2 * SIZE + e], corners[3 * SIZE + e]
    return (own[a, 3] + own[b, 3] + own[c, 3] + own[d, 3]) / 4
