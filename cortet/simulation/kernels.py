"""One step in time, in compiled loops: first over elements, then over nodes.

No loop adds into what another iteration writes: an element stores its forces, a node gathers those around it in a fixed
order. Loops run over blocks of fixed size, so that what the compiler makes of a block's end cannot depend on the number
of threads either: the bits of a result are the same for any.

`advance` is the seam: arrays in, arrays changed in place, nothing else of the package is called from the loop in time.

Constitutive law, per unit of grown volume, with F the elastic deformation gradient and B = F F^T:

    W = mu / 2 (J^(-2/3) tr B - 3) + K / 2 (J_node - 1)^2,    P = mu J^(-2/3) (F - tr B / 3 F^-T) + K (J~ - 1) J F^-T

J_node is the ratio of a node's current to its grown volume, J~ the mean over an element's nodes: this averaging removes
the locking of linear tetrahedra, and the forces are still the gradient of the energy.

No time step could follow W where an element is nearly flat, for it grows without limit there. Written in the stretches
s of F, J^(-2/3) is the product of phi(s) = s^(-2/3); below a stretch of 0.1, phi is replaced by its second-order Taylor
polynomial there, which also takes the negative stretch of an inverted element (after Stomakhin et al., SCA 2012). The
energy stays smooth, and the flatter the element, the harder it is pushed open. Every entry into this branch is counted.
"""
# Vectors are tuples of three floats; matrices are three of them, rows first. Numba keeps both in registers.
# Its parallel loops take no named tuples: these become plain ones on the way in and get their names back in each block.

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.mesh import FloatArray
from cortet.simulation.body import Body, Material
from cortet.simulation.contact import contact_forces, moved_too_far

#: how `advance` ended
DONE, INVERTED, LIST_OUTDATED = 0, 1, 2
#: stretch below which the law is continued by a polynomial
SMALLEST_STRETCH = 0.1

_BLOCK = 256


class Motion(NamedTuple):
    """What moves, (n, 3) each, dimensionless."""

    x: FloatArray
    v: FloatArray


class Work(NamedTuple):
    """What a step computes on its way."""

    #: (m,), growth g of each element between 0 and 1; current volume; volume after growth alone
    share: FloatArray
    current: FloatArray
    grown: FloatArray
    #: (n,), a quarter of the grown volumes around each node, and the ratio of current to grown volume there
    node_grown: FloatArray
    ratio: FloatArray
    #: (m, 3, 3), forces on the nodes 1, 2 and 3 of each element
    forces: FloatArray
    #: (n, 3), contact forces
    external: FloatArray
    #: per block of elements: smallest J, and elements in the degenerate branch
    block_min: FloatArray
    block_degenerate: NDArray[np.int64]
    #: (1,), smallest J of all steps since it was last set to infinity
    min_j: FloatArray
    #: (2,), entries into the degenerate branch since the start; nodes in contact at the last step
    counts: NDArray[np.int64]
    #: per block of nodes (b, 2), and of all steps since the start (2,): energy dissipated, and work of the contact
    block_energy: FloatArray
    energy: FloatArray


def workspace(body: Body) -> Work:
    """Arrays for the steps of a body."""
    m, n = len(body.cells), len(body.offsets) - 1
    blocks = -(-m // _BLOCK)
    return Work(
        share=np.zeros(m),
        current=np.zeros(m),
        grown=np.zeros(m),
        node_grown=np.zeros(n),
        ratio=np.ones(n),
        forces=np.zeros((m, 3, 3)),
        external=np.zeros((n, 3)),
        block_min=np.full(blocks, np.inf),
        block_degenerate=np.zeros(blocks, np.int64),
        min_j=np.full(1, np.inf),
        counts=np.zeros(2, np.int64),
        block_energy=np.zeros((-(-n // _BLOCK), 2)),
        energy=np.zeros(2),
    )


_fast = numba.njit(fastmath={"contract"}, error_model="numpy", cache=True)


@_fast
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_fast
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_fast
def _sum(p, a, q, b):  # type: ignore[no-untyped-def]
    """p a + q b."""
    return p * a[0] + q * b[0], p * a[1] + q * b[1], p * a[2] + q * b[2]


@_fast
def _row(a, i):  # type: ignore[no-untyped-def]
    return a[i, 0], a[i, 1], a[i, 2]


@_fast
def _edges(x, cells, e):  # type: ignore[no-untyped-def]
    """The three edges from node 0 of an element."""
    a = _row(x, cells[e, 0])
    b, c, d = _row(x, cells[e, 1]), _row(x, cells[e, 2]), _row(x, cells[e, 3])
    return _sum(1.0, b, -1.0, a), _sum(1.0, c, -1.0, a), _sum(1.0, d, -1.0, a)


@_fast
def _grown_gradients(body, e, alpha):  # type: ignore[no-untyped-def]
    """Gradients of the shape functions after growth Fg = I + (I - n n^T) alpha: A_r^-1 Fg^-1."""
    n = _row(body.normals, e)
    across = alpha / (1 + alpha * (1 - _dot(n, n)))
    a, b, c = _row(body.gradients[e], 0), _row(body.gradients[e], 1), _row(body.gradients[e], 2)
    s = 1 / (1 + alpha)
    return (
        _sum(s, a, s * across * _dot(a, n), n),
        _sum(s, b, s * across * _dot(b, n), n),
        _sum(s, c, s * across * _dot(c, n), n),
    )


@_fast
def _deformation(u, v, w, a, b, c):  # type: ignore[no-untyped-def]
    """Rows of F = u a^T + v b^T + w c^T from current edges and grown gradients."""
    return (
        _sum(1.0, _sum(u[0], a, v[0], b), w[0], c),
        _sum(1.0, _sum(u[1], a, v[1], b), w[1], c),
        _sum(1.0, _sum(u[2], a, v[2], b), w[2], c),
    )


@_fast
def _volumes(first, last, body, x, work, alphas, thickening):  # type: ignore[no-untyped-def]
    """Growth, grown and current volume of a block of elements."""
    body, work = Body(*body), Work(*work)
    for e in range(first, last):
        u, v, w = _edges(x, body.cells, e)
        work.current[e] = _dot(u, _cross(v, w)) / 6
        share = body.mask[e] / (1 + np.exp(10 * (body.depth[e] / (body.thickness[e] + thickening) - 1)))
        alpha = share * alphas[body.label[e]]
        n = _row(body.normals, e)
        work.share[e] = share
        work.grown[e] = body.volumes[e] * (1 + alpha) * (1 + alpha) * (1 + alpha * (1 - _dot(n, n)))


@_fast
def _ratios(first, last, body, work):  # type: ignore[no-untyped-def]
    """Grown volume of a block of nodes, and the ratio of current to grown volume."""
    body, work = Body(*body), Work(*work)
    for i in range(first, last):
        current, grown = 0.0, 0.0
        for k in range(body.offsets[i], body.offsets[i + 1]):
            current += work.current[body.around[k]]
            grown += work.grown[body.around[k]]
        work.node_grown[i] = grown / 4
        work.ratio[i] = current / grown


@_fast
def _forces(first, last, body, material, x, work, alphas):  # type: ignore[no-untyped-def]
    """Forces of a block of elements; returns their smallest J, NaN if there is one, and how many are degenerate."""
    body, material, work = Body(*body), Material(*material), Work(*work)
    smallest, degenerate = np.inf, 0
    for e in range(first, last):
        share = work.share[e]
        mu = material.mu_core * (1 - share) + material.mu_cortex * share
        u, v, w = _edges(x, body.cells, e)
        a, b, c = _grown_gradients(body, e, share * alphas[body.label[e]])
        f0, f1, f2 = _deformation(u, v, w, a, b, c)
        c0, c1, c2 = _cross(f1, f2), _cross(f2, f0), _cross(f0, f1)  # cofactors: J F^-T
        j = _dot(f0, c0)
        trace = _dot(f0, f0) + _dot(f1, f1) + _dot(f2, f2)
        cells = body.cells
        mean = (
            work.ratio[cells[e, 0]] + work.ratio[cells[e, 1]] + work.ratio[cells[e, 2]] + work.ratio[cells[e, 3]]
        ) / 4
        q = work.grown[e] * material.bulk * (mean - 1)
        y = _inverse_cube_root(j)
        p = work.grown[e] * mu * y * y
        r = q - p * trace * (y * y * y) / 3
        p0, p1, p2 = _sum(p, f0, r, c0), _sum(p, f1, r, c1), _sum(p, f2, r, c2)
        if _may_be_degenerate(j, trace):
            left, stretch, right = _stretches(f0, f1, f2)
            if stretch[2] < SMALLEST_STRETCH:
                degenerate += 1
                s0, s1, s2 = _degenerate_stress(left, stretch, right, work.grown[e] * mu)
                p0, p1, p2 = _sum(1.0, s0, q, c0), _sum(1.0, s1, q, c1), _sum(1.0, s2, q, c2)
        forces = work.forces[e]
        forces[0, 0], forces[0, 1], forces[0, 2] = -_dot(p0, a), -_dot(p1, a), -_dot(p2, a)
        forces[1, 0], forces[1, 1], forces[1, 2] = -_dot(p0, b), -_dot(p1, b), -_dot(p2, b)
        forces[2, 0], forces[2, 1], forces[2, 2] = -_dot(p0, c), -_dot(p1, c), -_dot(p2, c)
        if j < smallest or j != j:  # a NaN stays
            smallest = j
    return smallest, degenerate


@_fast
def _inverse_cube_root(j):  # type: ignore[no-untyped-def]
    """j^(-1/3) of a positive number, sooner than the power would have it."""
    # the bits of a float, read as an integer, go with its logarithm: right to some per cent; the rest is Newton's
    y = np.int64(0x553EF0FF289DD796 - np.float64(j).view(np.int64) // 3).view(np.float64)
    for _ in range(5):
        y *= 4 / 3 - j / 3 * (y * y * y)
    return y


@_fast
def _may_be_degenerate(j, trace):  # type: ignore[no-untyped-def]
    """False for nearly all elements, which spares them their stretches: the smallest is at least 2 J / tr B."""
    return 2 * j < SMALLEST_STRETCH * trace


@numba.njit(cache=True)
def _stretches(f0, f1, f2):  # type: ignore[no-untyped-def]
    """U, s and V^T of F = U diag(s) V^T, s falling; of an inverted element the last is negative, not U or V^T."""
    f = np.array([[f0[0], f0[1], f0[2]], [f1[0], f1[1], f1[2]], [f2[0], f2[1], f2[2]]])
    u, s, vt = np.linalg.svd(f)
    if _dot(f0, _cross(f1, f2)) < 0:
        u[:, 2] *= -1
        s[2] *= -1
    return u, s, vt


@_fast
def _phi(s):  # type: ignore[no-untyped-def]
    """s^(-2/3), continued below the smallest stretch, and its derivative."""
    if s >= SMALLEST_STRETCH:
        return s ** (-2 / 3), -2 / 3 * s ** (-5 / 3)
    phi, r = SMALLEST_STRETCH ** (-2 / 3), s / SMALLEST_STRETCH - 1
    return phi * (1 - 2 / 3 * r + 5 / 9 * r * r), phi / SMALLEST_STRETCH * (-2 / 3 + 10 / 9 * r)


@numba.njit(cache=True)
def _degenerate_stress(u, s, vt, mu):  # type: ignore[no-untyped-def]
    """Rows of the deviatoric P from the stretches of F."""
    (a, da), (b, db), (c, dc) = _phi(s[0]), _phi(s[1]), _phi(s[2])
    principal = mu / 2 * (s**2).sum() * np.array([da * b * c, a * db * c, a * b * dc]) + mu * a * b * c * s
    p = (u * principal) @ vt
    return (p[0, 0], p[0, 1], p[0, 2]), (p[1, 0], p[1, 1], p[1, 2]), (p[2, 0], p[2, 1], p[2, 2])


@_fast
def _gathered(body, work, i):  # type: ignore[no-untyped-def]
    """Elastic force on node i; on node 0 of an element acts what its other three leave over."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(body.offsets[i], body.offsets[i + 1]):
        f, corner = work.forces[body.around[k]], body.corners[k]
        if corner == 0:
            x -= f[0, 0] + f[1, 0] + f[2, 0]
            y -= f[0, 1] + f[1, 1] + f[2, 1]
            z -= f[0, 2] + f[1, 2] + f[2, 2]
        else:
            x += f[corner - 1, 0]
            y += f[corner - 1, 1]
            z += f[corner - 1, 2]
    return x, y, z


@_fast
def _move(first, last, body, material, state, work, dt):  # type: ignore[no-untyped-def]
    """Step a block of nodes: v += dt (f - gamma V v) / (rho V), x += dt v, with the grown volume V around each.

    A node that is held does not move along x. Returns the energy dissipated and the work of the contact. Work is force
    times dt times the mean of the velocities before and after the step: so the work of all forces together is exactly
    the gain of kinetic energy.
    """
    body, material, state, work = Body(*body), Material(*material), Motion(*state), Work(*work)
    dissipated, pushed = 0.0, 0.0
    for i in range(first, last):
        force, volume = _gathered(body, work, i), work.node_grown[i]
        for k in range(3):
            before, resistance = state.v[i, k], material.damping * volume * state.v[i, k]
            after = before + dt * (force[k] + work.external[i, k] - resistance) / (material.density * volume)
            if k == 0 and body.held[i]:
                after = 0.0
            way = dt * (before + after) / 2
            dissipated += resistance * way
            pushed += work.external[i, k] * way
            state.v[i, k] = after
            state.x[i, k] += dt * after
    return dissipated, pushed


@numba.njit(parallel=True, cache=True)
def _elastic_forces(body, material, x, work, alphas, thickening, block_min, block_degenerate, nodes):  # type: ignore[no-untyped-def]
    m = len(work[0])
    for block in numba.prange(len(block_min)):
        first, last = block * _BLOCK, min(m, (block + 1) * _BLOCK)
        _volumes(first, last, body, x, work, alphas, thickening)
    for block in numba.prange((nodes + _BLOCK - 1) // _BLOCK):
        _ratios(block * _BLOCK, min(nodes, (block + 1) * _BLOCK), body, work)
    for block in numba.prange(len(block_min)):
        first, last = block * _BLOCK, min(m, (block + 1) * _BLOCK)
        block_min[block], block_degenerate[block] = _forces(first, last, body, material, x, work, alphas)


@numba.njit(parallel=True, cache=True)
def _move_all(body, material, state, work, dt, nodes, block_energy):  # type: ignore[no-untyped-def]
    for block in numba.prange((nodes + _BLOCK - 1) // _BLOCK):
        first, last = block * _BLOCK, min(nodes, (block + 1) * _BLOCK)
        block_energy[block, 0], block_energy[block, 1] = _move(first, last, body, material, state, work, dt)


@numba.njit(cache=True)
def elastic_forces(body, material, x, work, alphas, thickening):  # type: ignore[no-untyped-def]
    """Compute `work.forces` and everything before them for positions x; returns the smallest J, NaN if there is one.

    Parameters
    ----------
    alphas : growth of each label
    thickening : what the cortex has gained in thickness
    """
    plain_body, plain_work, nodes = tuple(body), tuple(work), len(work.ratio)
    _elastic_forces(
        plain_body, tuple(material), x, plain_work, alphas, thickening, work.block_min, work.block_degenerate, nodes
    )
    return work.block_min.min()


@numba.njit(cache=True)
def advance(body, material, state, work, contact, alphas, thickening, dt):  # type: ignore[no-untyped-def]
    """As many steps as `alphas` has rows, unless an element inverts or the contact list is outdated.

    Parameters
    ----------
    body, material, state, work, contact : `Body`, `Material`, `Motion`, `Work`, `Contact`
    alphas : (steps, labels), growth of each label at each step
    thickening : (steps,), what the cortex has gained in thickness
    dt : time step

    Returns
    -------
    steps taken, and DONE, INVERTED (`state` is the one with an inverted element) or LIST_OUTDATED
    """
    for step in range(len(alphas)):
        if moved_too_far(contact, state.x):
            return step, LIST_OUTDATED
        smallest = elastic_forces(body, material, state.x, work, alphas[step], thickening[step])
        if smallest < work.min_j[0]:
            work.min_j[0] = smallest
        if not smallest > 0:
            return step, INVERTED
        work.counts[0] += work.block_degenerate.sum()
        work.counts[1] = contact_forces(contact, state.x, work.external)
        _move_all(tuple(body), tuple(material), tuple(state), tuple(work), dt, len(state.x), work.block_energy)
        for block in range(len(work.block_energy)):  # in order: the sum has the same bits for any number of threads
            work.energy[:] += work.block_energy[block]
    return len(alphas), DONE


def nodal_forces(body: Body, work: Work) -> FloatArray:
    """Elastic force on every node, as the last `elastic_forces` left it: (n, 3)."""
    return _nodal_forces(body, work)


@numba.njit(cache=True)
def _nodal_forces(body, work):  # type: ignore[no-untyped-def]
    result = np.empty((len(work.ratio), 3))
    for i in range(len(result)):
        result[i] = np.array(_gathered(body, work, i))
    return result


def kinetic_energy(material: Material, v: FloatArray, work: Work) -> float:
    """Kinetic energy of velocities v (n, 3), for which `elastic_forces` must have run last."""
    return material.density / 2 * float((work.node_grown[:, None] * v**2).sum())


def elastic_energy(body: Body, material: Material, x: FloatArray, work: Work, alphas: FloatArray) -> float:
    """Elastic energy of positions x (n, 3), for which `elastic_forces` must have run last."""
    volumetric = material.bulk / 2 * (work.node_grown * (work.ratio - 1) ** 2).sum()
    return float(_deviatoric_energy(body, material, x, work, alphas).sum() + volumetric)


@_fast
def _deviatoric_energy(body, material, x, work, alphas):  # type: ignore[no-untyped-def]
    """mu / 2 (J^(-2/3) tr B - 3) times the grown volume of each element: (m,)."""
    energy = np.empty(len(body.cells))
    for e in range(len(energy)):
        share = work.share[e]
        u, v, w = _edges(x, body.cells, e)
        a, b, c = _grown_gradients(body, e, share * alphas[body.label[e]])
        f0, f1, f2 = _deformation(u, v, w, a, b, c)
        j, trace = _dot(f0, _cross(f1, f2)), _dot(f0, f0) + _dot(f1, f1) + _dot(f2, f2)
        factor = j ** (-2 / 3)
        if _may_be_degenerate(j, trace):
            stretch = _stretches(f0, f1, f2)[1]
            factor = _phi(stretch[0])[0] * _phi(stretch[1])[0] * _phi(stretch[2])[0]
        mu = material.mu_core * (1 - share) + material.mu_cortex * share
        energy[e] = work.grown[e] * mu / 2 * (factor * trace - 3)
    return energy
