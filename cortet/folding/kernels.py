"""One step in time, in compiled loops: over patches of elements, nodes, edges, patches again, and nodes again.

No loop adds to what another iteration writes: see `patches`. Loops run over blocks of fixed size, so the code that the
compiler makes for the end of a block cannot depend on the number of threads: the bits are the same for any number.

`advance` is the interface: arrays in, arrays changed in place. The loop in time calls nothing else of the package.
The computations in the elements of a patch are in `elements`.
"""
# Numba's parallel loops take no named tuples: these are passed as plain tuples and get their names back in each block.

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from cortet.folding.body import Body, Material
from cortet.folding.contact import contact_forces, moved_too_far
from cortet.folding.elements import (
    CURRENT,
    GROWN,
    MEAN,
    OWN_ROWS,
    SHARE,
    SMOOTHED,
    TRACE,
    J,
    edges_of_elements,
    grow_elements,
    mean_ratio,
    open_degenerate,
    stress_elements,
    weigh_elements,
)
from cortet.folding.law import dot, fast, grown_volume, growth_share, inlined, may_be_degenerate, own_growth, vector
from cortet.folding.patches import SIZE, Patches, patches_of
from cortet.folding.smoothing import (
    PER_ELEMENT,
    Edges,
    add_edges,
    edges_of,
    energy_of_edges,
    energy_of_rows,
    put_weighted,
    stress_edges,
)
from cortet.meshes import FloatArray

#: results of `advance`
DONE, INVERTED, LIST_OUTDATED = 0, 1, 2
#: number of nodes in a block
_BLOCK = 256


class Motion(NamedTuple):
    """The moving state, (n, 3) each, dimensionless."""

    x: FloatArray
    v: FloatArray


class Work(NamedTuple):
    """Intermediate results of a step."""

    patches: Patches
    edges: Edges
    #: (m,), growth g of each element between 0 and 1; current volume; volume after growth alone: at the last positions
    #: for which `elastic_forces` was called
    share: FloatArray
    current: FloatArray
    grown: FloatArray
    #: (n,), a quarter of the grown volumes around each node, and the ratio of current to grown volume there
    node_grown: FloatArray
    ratio: FloatArray
    #: per slot, current and grown volumes of the patch's elements around it (s, 2), and their forces on it (s, 3)
    slot_volumes: FloatArray
    slot_forces: FloatArray
    #: (n, 3), contact forces
    external: FloatArray
    #: memory of each thread for its patch: rows of its elements; and position, ratio and sums of the patch's own nodes
    own_rows: FloatArray
    own_nodes: FloatArray
    #: per patch: smallest J, and number of elements in the degenerate branch
    block_min: FloatArray
    block_degenerate: NDArray[np.int64]
    #: (1,), smallest J of all steps since it was last set to infinity
    min_j: FloatArray
    #: (2,), entries into the degenerate branch since the start; nodes in contact at the last step
    counts: NDArray[np.int64]
    #: per block of nodes (b, 2), and of all steps since the start (2,): energy dissipated, and work of the contact
    block_energy: FloatArray
    energy: FloatArray


def workspace(body: Body, *, smoothed: bool = True) -> Work:
    """Arrays for the steps of a body; without `smoothed`, those of edges are empty, as `Material.own` 1 needs none."""
    m, n, patches = len(body.cells), len(body.held), patches_of(body)
    # this starts Numba's threads. A cached kernel compiled around a cached parallel loop does not; without the threads
    # it would end the process
    numba.get_num_threads()
    threads: int = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    return Work(
        patches=patches,
        edges=edges_of(body.cells, smoothed=smoothed),
        share=np.zeros(m),
        current=np.zeros(m),
        grown=np.zeros(m),
        node_grown=np.zeros(n),
        ratio=np.ones(n),
        slot_volumes=np.zeros((len(patches.nodes), 2)),
        slot_forces=np.zeros((len(patches.nodes), 3)),
        external=np.zeros((n, 3)),
        own_rows=np.zeros((threads, OWN_ROWS * SIZE)),
        own_nodes=np.zeros((threads, int(np.diff(patches.offsets).max()), 8)),
        block_min=np.full(len(patches.corners), np.inf),
        block_degenerate=np.zeros(len(patches.corners), np.int64),
        min_j=np.full(1, np.inf),
        counts=np.zeros(2, np.int64),
        block_energy=np.zeros((-(-n // _BLOCK), 2)),
        energy=np.zeros(2),
    )


@fast
def _fetch(patches, patch, x, own):  # type: ignore[no-untyped-def]
    """Copy the positions of a patch's own nodes, and set their sums to 0."""
    first = patches.offsets[patch]
    for i in range(patches.offsets[patch + 1] - first):
        node = patches.nodes[first + i]
        own[i, 0], own[i, 1], own[i, 2] = x[node, 0], x[node, 1], x[node, 2]
        own[i, 4] = own[i, 5] = own[i, 6] = 0.0


@fast
def _volumes(patch, patches, x, growth, thickening, elements, slot_volumes, rows, own):  # type: ignore[no-untyped-def]
    """Add the current and grown volumes of the elements of a patch to its own nodes."""
    patches = Patches(*patches)
    corners, slot = patches.corners[patch], patches.offsets[patch]
    _fetch(patches, patch, x, own)
    edges_of_elements(rows, corners, own)
    grow_elements(rows, patches.constants[patch], patches.label[patch], growth, thickening)
    for e in range(min(SIZE, elements - patch * SIZE)):
        current, grown = rows[CURRENT * SIZE + e], rows[GROWN * SIZE + e]
        for k in range(4):
            corner = corners[k * SIZE + e]
            own[corner, 4] += current
            own[corner, 5] += grown
    for i in range(patches.offsets[patch + 1] - slot):
        slot_volumes[slot + i, 0], slot_volumes[slot + i, 1] = own[i, 4], own[i, 5]


@fast
def ratios(first, last, patches, slot_volumes, node_grown, ratio):  # type: ignore[no-untyped-def]
    """Grown volume of a block of nodes, and the ratio of current to grown volume."""
    patches = Patches(*patches)
    for i in range(first, last):
        current, grown = 0.0, 0.0
        for k in range(patches.starts[i], patches.starts[i + 1]):
            slot = patches.around[k]
            current += slot_volumes[slot, 0]
            grown += slot_volumes[slot, 1]
        node_grown[i] = grown / 4
        ratio[i] = current / grown


@fast
def _forces(patch, patches, edges, material, x, growth, thickening, elements, ratio, slot_forces, rows, own):  # type: ignore[no-untyped-def]
    """Forces of a patch on its own nodes; return its smallest J, NaN if any is, and how many are degenerate."""
    patches, material = Patches(*patches), Material(*material)
    corners, constants = patches.corners[patch], patches.constants[patch]
    slot, nodes = patches.offsets[patch], patches.offsets[patch + 1] - patches.offsets[patch]
    count = min(SIZE, elements - patch * SIZE)
    _fetch(patches, patch, x, own)
    for i in range(nodes):
        own[i, 3] = ratio[patches.nodes[slot + i]]
    edges_of_elements(rows, corners, own)
    grow_elements(rows, constants, patches.label[patch], growth, thickening)
    for e in range(SIZE):
        rows[MEAN * SIZE + e] = mean_ratio(own, corners, e)
    if material.own < 1:
        add_edges(patch, count, Edges(*edges).of_element, Edges(*edges).stress, rows)
    else:
        rows[SMOOTHED * SIZE :] = 0.0
    stress_elements(rows, constants, material)
    smallest, degenerate = np.inf, 0
    for e in range(count):
        j = rows[J * SIZE + e]
        if may_be_degenerate(j, rows[TRACE * SIZE + e]):
            degenerate += open_degenerate(rows, constants, material, e, own, corners)
        smallest = least(smallest, j)
    _add_forces(rows, corners, count, own)
    for i in range(nodes):
        for k in range(3):
            slot_forces[slot + i, k] = own[i, 4 + k]
    return smallest, degenerate


@inlined
def least(smallest, j):  # type: ignore[no-untyped-def]
    """The smaller of two numbers; NaN if one is NaN."""
    return j if j < smallest or j != j else smallest


@fast
def _add_forces(rows, corners, count, own):  # type: ignore[no-untyped-def]
    """Add the forces of each element to its nodes; the force on corner 0 balances the other three."""
    for e in range(count):
        corner0, corner1, corner2, corner3 = corners[e], corners[SIZE + e], corners[2 * SIZE + e], corners[3 * SIZE + e]
        for k in range(3):
            a, b, c = rows[k * SIZE + e], rows[(k + 3) * SIZE + e], rows[(k + 6) * SIZE + e]
            own[corner0, 4 + k] -= a + b + c
            own[corner1, 4 + k] += a
            own[corner2, 4 + k] += b
            own[corner3, 4 + k] += c


@fast
def _gathered(patches, slot_forces, i):  # type: ignore[no-untyped-def]
    """Elastic force on node i."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(patches.starts[i], patches.starts[i + 1]):
        slot = patches.around[k]
        x += slot_forces[slot, 0]
        y += slot_forces[slot, 1]
        z += slot_forces[slot, 2]
    return x, y, z


@fast
def move(first, last, patches, held, material, state, slot_forces, external, node_grown, dt):  # type: ignore[no-untyped-def]
    """Step a block of nodes: v += dt (f - gamma V v) / (rho V), x += dt v, with the grown volume V around each.

    A held node does not move along x. Returns the energy dissipated and the work of the contact. Work is force times dt
    times the mean of the velocities before and after the step. So the work of all forces together is exactly the gain
    of kinetic energy.
    """
    patches, material, state = Patches(*patches), Material(*material), Motion(*state)
    dissipated, pushed = 0.0, 0.0
    for i in range(first, last):
        force, volume = _gathered(patches, slot_forces, i), node_grown[i]
        per_mass = dt / (material.density * volume)
        for k in range(3):
            before, resistance = state.v[i, k], material.damping * volume * state.v[i, k]
            after = before + per_mass * (force[k] + external[i, k] - resistance)
            if k == 0 and held[i]:
                after = 0.0
            way = dt * (before + after) / 2
            dissipated += resistance * way
            pushed += external[i, k] * way
            state.v[i, k] = after
            state.x[i, k] += dt * after
    return dissipated, pushed


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _elastic_forces(  # type: ignore[no-untyped-def]
    patches, edges, material, x, growth, thickening, elements, node_grown, ratio, slots, own, block_min, degenerate
):
    (slot_volumes, slot_forces), (rows, nodes), part = slots, own, (1 - Material(*material).own) / PER_ELEMENT
    for patch in numba.prange(len(block_min)):
        t = numba.get_thread_id()  # type: ignore[attr-defined]
        _volumes(patch, patches, x, growth, thickening, elements, slot_volumes, rows[t], nodes[t])
        if part > 0:
            weigh_elements(rows[t], Patches(*patches).constants[patch], Material(*material))
            put_weighted(patch, elements, edges, rows[t])
    for block in numba.prange((len(ratio) + _BLOCK - 1) // _BLOCK):
        first, last = block * _BLOCK, min(len(ratio), (block + 1) * _BLOCK)
        ratios(first, last, patches, slot_volumes, node_grown, ratio)
    count = len(Edges(*edges).starts) - 1 if part > 0 else 0
    found = np.zeros((count + SIZE - 1) // SIZE, np.int64)
    for block in numba.prange(len(found)):
        t = numba.get_thread_id()  # type: ignore[attr-defined]
        found[block] = stress_edges(block * SIZE, min(count, (block + 1) * SIZE), edges, part, rows[t])
    for patch in numba.prange(len(block_min)):
        t = numba.get_thread_id()  # type: ignore[attr-defined]
        block_min[patch], degenerate[patch] = _forces(
            patch, patches, edges, material, x, growth, thickening, elements, ratio, slot_forces, rows[t], nodes[t]
        )
    degenerate[0] += found.sum()


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _move_all(patches, held, material, state, slot_forces, external, node_grown, dt, block_energy):  # type: ignore[no-untyped-def]
    for block in numba.prange(len(block_energy)):
        first, last = block * _BLOCK, min(len(node_grown), (block + 1) * _BLOCK)
        block_energy[block, 0], block_energy[block, 1] = move(
            first, last, patches, held, material, state, slot_forces, external, node_grown, dt
        )


@numba.njit(cache=True, error_model="numpy")
def elastic_forces(material, x, work, growth, thickening):  # type: ignore[no-untyped-def]
    """Compute forces and nodal volumes in `work` for positions x; return the smallest J, NaN if any is.

    Parameters
    ----------
    growth : (labels, 3), growth of each label: ALONG, ACROSS and CORE
    thickening : gain of the cortex in thickness
    """
    _elastic_forces(
        tuple(work.patches),
        tuple(work.edges),
        tuple(material),
        x,
        growth,
        thickening,
        len(work.share),
        work.node_grown,
        work.ratio,
        (work.slot_volumes, work.slot_forces),
        (work.own_rows, work.own_nodes),
        work.block_min,
        work.block_degenerate,
    )
    return work.block_min.min()


@fast
def grown_volume_of(body, growth):  # type: ignore[no-untyped-def]
    """Volume of a body without stress, for growth (labels, 3) of each label."""
    total = 0.0
    for e in range(len(body.volumes)):
        share = growth_share(body.depth[e], body.thickness[e], body.mask[e])
        along, across, core = vector(growth, body.label[e])
        alpha, beta = own_growth(share, body.amount[e], along, across, core)
        n = vector(body.normals, e)
        total += grown_volume(body.volumes[e], alpha, beta, 1 - dot(n, n))
    return total


@numba.njit(cache=True, error_model="numpy")
def advance(body, material, state, work, contact, course, dt):  # type: ignore[no-untyped-def]
    """Take the steps of a course, unless an element inverts or the contact list is outdated.

    Parameters
    ----------
    body, material, state, work, contact, course : `Body`, `Material`, `Motion`, `Work`, `Contact`, `Course`
    dt : time step

    Returns
    -------
    steps taken, and DONE, INVERTED (`state` is the one with an inverted element) or LIST_OUTDATED
    """
    steps = len(course.thickening)
    for step in range(steps):
        if moved_too_far(contact, state.x):
            return step, LIST_OUTDATED
        smallest = elastic_forces(material, state.x, work, course.growth[step], course.thickening[step])
        if smallest < work.min_j[0]:
            work.min_j[0] = smallest
        if not smallest > 0:
            return step, INVERTED
        work.counts[0] += work.block_degenerate.sum()
        work.counts[1] = contact_forces(contact, state.x, work.external, course.envelope[step])
        _move_all(
            tuple(work.patches),
            body.held,
            tuple(material),
            tuple(state),
            work.slot_forces,
            work.external,
            work.node_grown,
            dt,
            work.block_energy,
        )
        for block in range(len(work.block_energy)):  # in order: the sum has the same bits for any number of threads
            work.energy[:] += work.block_energy[block]
    return steps, DONE


@numba.njit(cache=True, error_model="numpy")
def nodal_forces(work):  # type: ignore[no-untyped-def]
    """Elastic force on every node, from the last `elastic_forces`: (n, 3)."""
    result = np.empty((len(work.ratio), 3))
    for i in range(len(result)):
        result[i] = np.array(_gathered(work.patches, work.slot_forces, i))
    return result


def energies(
    material: Material, state: Motion, work: Work, growth: FloatArray, thickening: float
) -> tuple[float, float]:
    """Kinetic and elastic energy of a state, whose growth and volumes stay in `work`; see `elastic_forces`."""
    deviatoric, of_edges = np.empty(len(work.share)), np.empty(len(work.edges.starts) - 1)
    _measure(
        tuple(work.patches),
        tuple(work.edges),
        tuple(material),
        state.x,
        growth,
        thickening,
        of_edges,
        (deviatoric, work.share, work.current, work.grown),
        (work.slot_volumes, work.node_grown, work.ratio),
        (work.own_rows, work.own_nodes),
    )
    kinetic = material.density / 2 * (work.node_grown[:, None] * state.v**2).sum()
    volumetric = material.bulk / 2 * (work.node_grown * (work.ratio - 1) ** 2).sum()
    shear = material.own * deviatoric.sum() + (1 - material.own) / PER_ELEMENT * of_edges.sum()
    return float(kinetic), float(shear + volumetric)


@numba.njit(parallel=True, cache=True, error_model="numpy")
def _measure(patches, edges, material, x, growth, thickening, of_edges, of_elements, of_nodes, own):  # type: ignore[no-untyped-def]
    (deviatoric, share, current, grown), (slot_volumes, node_grown, ratio), (rows, nodes) = of_elements, of_nodes, own
    elements = len(share)
    for patch in numba.prange((elements + SIZE - 1) // SIZE):
        t = numba.get_thread_id()  # type: ignore[attr-defined]
        _volumes(patch, patches, x, growth, thickening, elements, slot_volumes, rows[t], nodes[t])
        first, last = patch * SIZE, min(elements, (patch + 1) * SIZE)
        for i in range(first, last):
            share[i], current[i], grown[i] = (
                rows[t, SHARE * SIZE + i - first],
                rows[t, CURRENT * SIZE + i - first],
                rows[t, GROWN * SIZE + i - first],
            )
        weigh_elements(rows[t], Patches(*patches).constants[patch], Material(*material))
        if len(of_edges):
            put_weighted(patch, elements, edges, rows[t])
        energy_of_rows(first, last, rows[t], deviatoric)
    for block in numba.prange((len(of_edges) + SIZE - 1) // SIZE):
        t = numba.get_thread_id()  # type: ignore[attr-defined]
        energy_of_edges(block * SIZE, min(len(of_edges), (block + 1) * SIZE), edges, rows[t], of_edges)
    for block in numba.prange((len(ratio) + _BLOCK - 1) // _BLOCK):
        ratios(block * _BLOCK, min(len(ratio), (block + 1) * _BLOCK), patches, slot_volumes, node_grown, ratio)
