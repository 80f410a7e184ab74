"""The computations in an element on a GPU: `law` and `elements`, compiled for the device.

Only the stretches of degenerate elements are found in another way, because a GPU has no LAPACK.
"""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import Any

from numba import cuda
from numba.core.dispatcher import Dispatcher

from cortet.folding import elements, law
from cortet.folding.patches import AMOUNT, DEPTH, ISOTROPIC, MASK, SIZE, THICKNESS, VOLUME


@cache
def on_device(function: Dispatcher) -> Any:
    """Compile a function for the device that is compiled for CPUs, with those that it calls.

    If it were called directly, Numba would compile it with all of `fastmath`, while the CPU has the contraction of
    multiply-adds alone. That would assume that there is no NaN, and optimise away the rounding in `law.exponential`.
    The device contracts multiply-adds by default.
    """
    plain = function.py_func
    callees = {
        name: on_device(value)
        for name, value in plain.__globals__.items()
        if name in plain.__code__.co_names and isinstance(value, Dispatcher)
    }
    own = FunctionType(plain.__code__, {**plain.__globals__, **callees}, plain.__name__, plain.__defaults__)
    return cuda.jit(device=True)(own)


_combined, _vector = on_device(law.combined), on_device(law.vector)
_dot, _cross, _deformation = on_device(law.dot), on_device(law.cross), on_device(law.deformation)
_growth_share, _grown_volume = on_device(law.growth_share), on_device(law.grown_volume)
_own_growth, _stress = on_device(law.own_growth), on_device(law.stress)
_may_be_degenerate, _phi = on_device(law.may_be_degenerate), on_device(law.phi)
_stretches, _degenerate_stress = on_device(law.turned_stretches), on_device(law.turned_stress)
_forces_on_corners, _own_modulus = on_device(law.forces_on_corners), on_device(elements.own_modulus)
_own_gradients, _put_forces = on_device(elements.own_gradients), on_device(elements.put_forces)


@cuda.jit(device=True)
def edges(patches, patch, e, x):  # type: ignore[no-untyped-def]
    """The nodes of an element of a patch, and its three edges from corner 0."""
    first = patches.offsets[patch]
    a = patches.nodes[first + patches.corners[patch, e]]
    b = patches.nodes[first + patches.corners[patch, SIZE + e]]
    c = patches.nodes[first + patches.corners[patch, 2 * SIZE + e]]
    d = patches.nodes[first + patches.corners[patch, 3 * SIZE + e]]
    origin = _vector(x, a)
    return (
        (a, b, c, d),
        _combined(1.0, _vector(x, b), -1.0, origin),
        _combined(1.0, _vector(x, c), -1.0, origin),
        _combined(1.0, _vector(x, d), -1.0, origin),
    )


@cuda.jit(device=True)
def growth_of(patches, patch, e, growth, thickening):  # type: ignore[no-untyped-def]
    """Share of the cortex, growth along and across it, and grown volume of an element of a patch."""
    constants = patches.constants[patch]
    thickness = constants[THICKNESS * SIZE + e] + thickening
    share = _growth_share(constants[DEPTH * SIZE + e], thickness, constants[MASK * SIZE + e])
    along, across, core = _vector(growth, patches.label[patch, e])
    alpha, beta = _own_growth(share, constants[AMOUNT * SIZE + e], along, across, core)
    grown = _grown_volume(constants[VOLUME * SIZE + e], alpha, beta, constants[ISOTROPIC * SIZE + e])
    return share, alpha, beta, grown


@cuda.jit(device=True)
def _stretched(patches, patch, e, x, ratio, material, growth, thickening):  # type: ignore[no-untyped-def]
    """Rows of F of an element, its grown gradients, and its moduli for `law.stress`."""
    nodes, u, v, w = edges(patches, patch, e, x)
    share, alpha, beta, grown = growth_of(patches, patch, e, growth, thickening)
    gradients = _own_gradients(patches.constants[patch], e, alpha, beta)
    mean = (ratio[nodes[0]] + ratio[nodes[1]] + ratio[nodes[2]] + ratio[nodes[3]]) / 4
    shear = _own_modulus(patches.constants[patch], material, e, share)
    moduli = grown * shear, grown * material.bulk * (mean - 1)
    return _deformation(u, v, w, gradients[0], gradients[1], gradients[2]), gradients, moduli


@cuda.jit(device=True)
def put_element(shared, patches, patch, e, x, ratio, material, growth, thickening):  # type: ignore[no-untyped-def]
    """Write the forces of an element as if it were not degenerate; return its J, and whether it may be degenerate."""
    f, gradients, moduli = _stretched(patches, patch, e, x, ratio, material, growth, thickening)
    p0, p1, p2, j, trace = _stress(f[0], f[1], f[2], moduli[0], moduli[1])
    _put_forces(shared, e, _forces_on_corners(p0, p1, p2, gradients[0], gradients[1], gradients[2]))
    return j, _may_be_degenerate(j, trace)


@cuda.jit(device=True)
def put_degenerate(shared, patches, patch, e, x, ratio, material, growth, thickening):  # type: ignore[no-untyped-def]
    """Write the forces of an element that may be in the degenerate branch; return whether it is."""
    f, gradients, moduli = _stretched(patches, patch, e, x, ratio, material, growth, thickening)
    left, stretch, right = _stretches(f[0], f[1], f[2])
    if not stretch[2] < law.SMALLEST_STRETCH:
        return False
    s0, s1, s2 = _degenerate_stress(left, stretch, right, moduli[0])
    p0 = _combined(1.0, s0, moduli[1], _cross(f[1], f[2]))
    p1 = _combined(1.0, s1, moduli[1], _cross(f[2], f[0]))
    p2 = _combined(1.0, s2, moduli[1], _cross(f[0], f[1]))
    _put_forces(shared, e, _forces_on_corners(p0, p1, p2, gradients[0], gradients[1], gradients[2]))
    return True


@cuda.jit(device=True)
def deviatoric_energy(patches, patch, e, x, material, growth, thickening):  # type: ignore[no-untyped-def]
    """mu / 2 (J^(-2/3) tr B - 3) times the grown volume of an element."""
    _, u, v, w = edges(patches, patch, e, x)
    share, alpha, beta, grown = growth_of(patches, patch, e, growth, thickening)
    a, b, c = _own_gradients(patches.constants[patch], e, alpha, beta)
    f0, f1, f2 = _deformation(u, v, w, a, b, c)
    j, trace = _dot(f0, _cross(f1, f2)), _dot(f0, f0) + _dot(f1, f1) + _dot(f2, f2)
    if _may_be_degenerate(j, trace):
        stretch = _stretches(f0, f1, f2)[1]
        factor = _phi(stretch[0])[0] * _phi(stretch[1])[0] * _phi(stretch[2])[0]
    else:
        factor = j ** (-2 / 3)
    return grown * _own_modulus(patches.constants[patch], material, e, share) / 2 * (factor * trace - 3)
