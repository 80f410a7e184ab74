"""Steps in time on a GPU: the loops of `kernels`, by a grid of blocks of threads that wait for each other.

Each block takes a patch of elements at a time, and its threads the elements. The contributions of elements to the
patch's own nodes stay in the block's shared memory until each of these nodes has added them up: element after element,
in the same order as on a CPU. Everything else belongs to a single node: it gathers its slots, and the contacts around
it, from lists of fixed order. There are no atomic sums, and no sum depends on the number of blocks, so a device makes
the same bits in every run.

One kernel does many steps. The whole grid waits between the phases of a step (a cooperative launch), so nothing returns
to the host and nothing is launched per step. All threads read the same verdict on a step before any node moves. So all
stop at the same step, with everything that moves as it was when that step began.

`gpu_elements` has the computations in an element. The computations at a node are those of `contact` and `kernels`,
compiled for the device.
"""
# This module is imported only if a GPU is asked for: it makes Numba look for CUDA.

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numba import cuda

from cortet.folding import contact as contacts
from cortet.folding import kernels, law
from cortet.folding.device import is_simulated
from cortet.folding.gpu_elements import deviatoric_energy, edges, growth_of, on_device, put_degenerate, put_element
from cortet.folding.kernels import DONE, INVERTED, LIST_OUTDATED
from cortet.folding.patches import SIZE
from cortet.meshes import FloatArray, IntArray

#: threads of a block, a power of two; also the number of nodes whose energies are added up at a time
THREADS = 128
#: indices in `Tallies.flags`: how the batch ended, steps taken, whether some node has moved too far
HOW, TAKEN, OUTDATED = 0, 1, 2
#: indices in `Tallies.counts`: entries into the degenerate branch, nodes in contact at the last step
DEGENERATE, TOUCHED = 0, 1
#: most registers of a thread, so that three blocks fit on a multiprocessor of 65,536: the compiler would take 194, and
#: only two would fit. This costs 56 bytes on the stack. The simulator has neither registers nor this option
_LIMITS = {} if is_simulated() else {"max_registers": 168}
#: shared memory of a block, in rows of SIZE values: forces on the corners 1, 2 and 3 of each element
_SHARED = 9 * SIZE


class Gathered(NamedTuple):
    """Who adds what, in which order; s slots, m elements, n nodes, k triangles of the surface."""

    #: the contributions that slot i of a patch adds up: members[begins[i]:begins[i + 1]], each SIZE times a corner,
    #: plus the element in the patch; (s + 1,) int32 and (4 m,) uint16
    begins: IntArray
    members: Any
    #: (n,) int32, index of a node among the surface nodes, or -1
    place: IntArray
    #: triangles around surface node i: around[starts[i]:starts[i + 1]], each three times the triangle, plus the corner
    starts: IntArray
    around: IntArray
    #: surface nodes that might touch triangle f: touching[first[f]:first[f + 1]], ascending
    first: IntArray
    touching: IntArray


class Tallies(NamedTuple):
    """The counts of a batch of steps; b blocks of THREADS nodes, p patches."""

    #: (3,) int32, see HOW
    flags: IntArray
    #: (2,) int64, see DEGENERATE
    counts: Any
    #: (1,), smallest J of all steps
    least: FloatArray
    #: per patch, for the step: smallest J, and elements in the degenerate branch; or their elastic energy
    patch_least: FloatArray
    patch_count: FloatArray
    #: per THREADS surface nodes, for the step: how many are in contact
    block_touched: FloatArray
    #: (b, 2), for all steps: energy dissipated, work of the contact; or kinetic and volumetric energy
    block_energy: FloatArray


class Scratch(NamedTuple):
    """Intermediate results of a step, as in `kernels.Work`."""

    slot_volumes: FloatArray
    slot_forces: FloatArray
    node_grown: FloatArray
    ratio: FloatArray
    external: FloatArray


_vector, _dot, _volume_between = on_device(law.vector), on_device(law.dot), on_device(law.volume_between)
_least = on_device(kernels.least)
_ratios, _move = on_device(kernels.ratios), on_device(kernels.move)
_has_moved_too_far, _touch = on_device(contacts.has_moved_too_far), on_device(contacts.touch)
_plane_force, _envelope_force = on_device(contacts.plane_force), on_device(contacts.envelope_force)


# --- a block of threads ----------------------------------------------------------------------------------------------


def _reduction(combined: Any) -> Any:
    """A function that combines a value over the threads of a block, by halves, and returns it in all of them."""

    @cuda.jit(device=True)
    def reduced(shared, value):  # type: ignore[no-untyped-def]
        t, half = cuda.threadIdx.x, THREADS // 2
        cuda.syncthreads()
        shared[t] = value
        cuda.syncthreads()
        while half > 0:
            if t < half:
                shared[t] = combined(shared[t], shared[t + half])
            cuda.syncthreads()
            half //= 2
        return shared[0]

    return reduced


@cuda.jit(device=True)
def _sum(a, b):  # type: ignore[no-untyped-def]
    return a + b


#: the sum of a value over the threads of a block, and the smallest one, NaN if any is NaN
_total, _smallest = _reduction(_sum), _reduction(_least)


# --- the phases of a step, by all blocks -----------------------------------------------------------------------------


@cuda.jit(device=True)
def _add_volumes(shared, patches, lists, x, growth, thickening, elements, slot_volumes):  # type: ignore[no-untyped-def]
    """Add the current and grown volumes of the elements of a patch to its own nodes."""
    for patch in range(cuda.blockIdx.x, len(patches.corners), cuda.gridDim.x):
        cuda.syncthreads()  # until all threads have used the results of the patch before
        for e in range(cuda.threadIdx.x, min(SIZE, elements - patch * SIZE), THREADS):
            _, u, v, w = edges(patches, patch, e, x)
            shared[e] = _volume_between(u, v, w)
            shared[SIZE + e] = growth_of(patches, patch, e, growth, thickening)[3]
        cuda.syncthreads()
        for slot in range(patches.offsets[patch] + cuda.threadIdx.x, patches.offsets[patch + 1], THREADS):
            current, grown = 0.0, 0.0
            for k in range(lists.begins[slot], lists.begins[slot + 1]):
                e = lists.members[k] % SIZE
                current += shared[e]
                grown += shared[SIZE + e]
            slot_volumes[slot, 0] = current
            slot_volumes[slot, 1] = grown


@cuda.jit(device=True)
def _find_ratios(patches, scratch):  # type: ignore[no-untyped-def]
    """Grown volume of every node, and the ratio of current to grown volume."""
    for i in range(cuda.grid(1), len(scratch.ratio), cuda.gridsize(1)):
        _ratios(i, i + 1, patches, scratch.slot_volumes, scratch.node_grown, scratch.ratio)


@cuda.jit(device=True)
def _look(contact, x, flags):  # type: ignore[no-untyped-def]
    """Whether some surface node has moved so far that the list may lack a contact."""
    for i in range(cuda.grid(1), len(contact.nodes), cuda.gridsize(1)):
        if _has_moved_too_far(contact, x, i):
            flags[OUTDATED] = 1


@cuda.jit(device=True)
def _add_forces(shared, patches, lists, x, material, growth, thickening, elements, scratch, tallies):  # type: ignore[no-untyped-def]
    """Forces of a patch on its own nodes, its smallest J, and the number of its degenerate elements."""
    for patch in range(cuda.blockIdx.x, len(patches.corners), cuda.gridDim.x):
        cuda.syncthreads()
        least, flat, degenerate = np.inf, False, 0.0
        for e in range(cuda.threadIdx.x, min(SIZE, elements - patch * SIZE), THREADS):
            j, doubtful = put_element(shared, patches, patch, e, x, scratch.ratio, material, growth, thickening)
            least, flat = _least(least, j), flat or doubtful
        if flat:  # rare; kept apart, because it takes many registers, which would leave room for fewer blocks
            for e in range(cuda.threadIdx.x, min(SIZE, elements - patch * SIZE), THREADS):
                if put_degenerate(shared, patches, patch, e, x, scratch.ratio, material, growth, thickening):
                    degenerate += 1.0
        cuda.syncthreads()
        for slot in range(patches.offsets[patch] + cuda.threadIdx.x, patches.offsets[patch + 1], THREADS):
            fx, fy, fz = _forces_on_slot(shared, lists, slot)
            scratch.slot_forces[slot, 0] = fx
            scratch.slot_forces[slot, 1] = fy
            scratch.slot_forces[slot, 2] = fz
        least, degenerate = _smallest(shared, least), _total(shared, degenerate)
        if cuda.threadIdx.x == 0:
            tallies.patch_least[patch] = least
            tallies.patch_count[patch] = degenerate


@cuda.jit(device=True)
def _forces_on_slot(shared, lists, slot):  # type: ignore[no-untyped-def]
    """Force of the elements of a patch on one of its own nodes; that on corner 0 balances the other three."""
    fx, fy, fz = 0.0, 0.0, 0.0
    for k in range(lists.begins[slot], lists.begins[slot + 1]):
        corner, e = lists.members[k] // SIZE, lists.members[k] % SIZE
        if corner == 0:
            fx -= shared[e] + shared[3 * SIZE + e] + shared[6 * SIZE + e]
            fy -= shared[SIZE + e] + shared[4 * SIZE + e] + shared[7 * SIZE + e]
            fz -= shared[2 * SIZE + e] + shared[5 * SIZE + e] + shared[8 * SIZE + e]
        else:
            fx += shared[(3 * corner - 3) * SIZE + e]
            fy += shared[(3 * corner - 2) * SIZE + e]
            fz += shared[(3 * corner - 1) * SIZE + e]
    return fx, fy, fz


@cuda.jit(device=True)
def _touch_all(shared, contact, x, block_touched):  # type: ignore[no-untyped-def]
    """The contact of every surface node, and how many are in contact; nodes at the medial plane count once more."""
    for block in range(cuda.blockIdx.x, len(block_touched), cuda.gridDim.x):
        i, count = block * THREADS + cuda.threadIdx.x, 0.0
        if i < len(contact.nodes):
            _touch(contact, x, i)
            count += 1.0 if contact.touched[i] >= 0 else 0.0
            if contact.side != 0:
                count += 1.0 if _plane_force(contact, x[contact.nodes[i], 0]) != 0 else 0.0
        count = _total(shared, count)
        if cuda.threadIdx.x == 0:
            block_touched[block] = count


@cuda.jit(device=True)
def _check(shared, tallies):  # type: ignore[no-untyped-def]
    """Decide whether a step may be taken; one block does this, while all others wait."""
    t, least, degenerate, touched = cuda.threadIdx.x, np.inf, 0.0, 0.0
    for patch in range(t, len(tallies.patch_least), THREADS):
        least = _least(least, tallies.patch_least[patch])
        degenerate += tallies.patch_count[patch]
    for block in range(t, len(tallies.block_touched), THREADS):
        touched += tallies.block_touched[block]
    least, degenerate, touched = _smallest(shared, least), _total(shared, degenerate), _total(shared, touched)
    if t != 0:
        return
    if tallies.flags[OUTDATED] != 0:
        tallies.flags[HOW] = LIST_OUTDATED
        return
    if least < tallies.least[0]:
        tallies.least[0] = least
    if not least > 0:
        tallies.flags[HOW] = INVERTED
        return
    tallies.flags[TAKEN] += 1
    tallies.counts[DEGENERATE] += np.int64(degenerate)
    tallies.counts[TOUCHED] = np.int64(touched)


@cuda.jit(device=True)
def _contact_force(contact, lists, x, place, envelope):  # type: ignore[no-untyped-def]
    """Force of all contacts on a surface node: its own, those of the triangles around it, medial plane, envelope."""
    fx, fy, fz = 0.0, 0.0, 0.0
    if contact.touched[place] >= 0:
        fx, fy, fz = contact.force[place, 0], contact.force[place, 1], contact.force[place, 2]
    for k in range(lists.starts[place], lists.starts[place + 1]):
        face, corner = lists.around[k] // 3, lists.around[k] % 3
        for m in range(lists.first[face], lists.first[face + 1]):
            other = lists.touching[m]
            if contact.touched[other] == face:
                weight = contact.weights[other, corner]
                fx -= weight * contact.force[other, 0]
                fy -= weight * contact.force[other, 1]
                fz -= weight * contact.force[other, 2]
    if contact.side != 0:
        fx += _plane_force(contact, x[contact.nodes[place], 0])
    if contact.plane[place] >= 0:
        push = _envelope_force(contact, x, place, envelope)
        fx, fy, fz = fx + push[0], fy + push[1], fz + push[2]
    return fx, fy, fz


@cuda.jit(device=True)
def _move_all(shared, patches, lists, held, material, state, contact, envelope, dt, scratch, block_energy):  # type: ignore[no-untyped-def]
    """Step every node; add the energy dissipated and the work of the contact, block by block."""
    for block in range(cuda.blockIdx.x, len(block_energy), cuda.gridDim.x):
        i, dissipated, pushed = block * THREADS + cuda.threadIdx.x, 0.0, 0.0
        if i < len(held):
            if lists.place[i] >= 0:
                fx, fy, fz = _contact_force(contact, lists, state.x, lists.place[i], envelope)
                scratch.external[i, 0] = fx
                scratch.external[i, 1] = fy
                scratch.external[i, 2] = fz
            dissipated, pushed = _move(
                i,
                i + 1,
                patches,
                held,
                material,
                state,
                scratch.slot_forces,
                scratch.external,
                scratch.node_grown,
                dt,
            )
        dissipated, pushed = _total(shared, dissipated), _total(shared, pushed)
        if cuda.threadIdx.x == 0:
            block_energy[block, 0] += dissipated
            block_energy[block, 1] += pushed


# --- kernels ---------------------------------------------------------------------------------------------------------


@cuda.jit(**_LIMITS)
def advance(  # type: ignore[no-untyped-def]
    patches, held, material, state, contact, lists, growth, thickening, envelope, dt, elements, scratch, tallies
):
    """`kernels.advance` on the device: as many steps as `growth` has rows, unless one of them cannot be taken.

    `tallies.flags` must be 0 before; afterwards they say how many steps were taken and why no more.
    """
    grid, shared = cuda.cg.this_grid(), cuda.shared.array(_SHARED, numba.float64)
    x = state.x
    for step in range(len(growth)):
        now, thicker = growth[step], thickening[step]
        _add_volumes(shared, patches, lists, x, now, thicker, elements, scratch.slot_volumes)
        grid.sync()
        _find_ratios(patches, scratch)
        _look(contact, x, tallies.flags)
        grid.sync()
        _add_forces(shared, patches, lists, x, material, now, thicker, elements, scratch, tallies)
        _touch_all(shared, contact, x, tallies.block_touched)
        grid.sync()
        if cuda.blockIdx.x == 0:
            _check(shared, tallies)
        grid.sync()
        if tallies.flags[HOW] != DONE:
            break
        size = envelope[step]
        _move_all(shared, patches, lists, held, material, state, contact, size, dt, scratch, tallies.block_energy)
        grid.sync()


@cuda.jit(**_LIMITS)
def energies(patches, material, state, lists, growth, thickening, elements, scratch, tallies):  # type: ignore[no-untyped-def]
    """Elastic energy of the elements of each patch, without that of the nodal volumes; sums for each block of nodes.

    The sums are V |v|^2 and V (J - 1)^2 with the grown volume V and the ratio J of each node.
    """
    grid, shared = cuda.cg.this_grid(), cuda.shared.array(_SHARED, numba.float64)
    _add_volumes(shared, patches, lists, state.x, growth, thickening, elements, scratch.slot_volumes)
    grid.sync()
    _find_ratios(patches, scratch)
    grid.sync()
    for patch in range(cuda.blockIdx.x, len(tallies.patch_least), cuda.gridDim.x):
        energy = 0.0
        for e in range(cuda.threadIdx.x, min(SIZE, elements - patch * SIZE), THREADS):
            energy += deviatoric_energy(patches, patch, e, state.x, material, growth, thickening)
        energy = _total(shared, energy)
        if cuda.threadIdx.x == 0:
            tallies.patch_least[patch] = energy
    for block in range(cuda.blockIdx.x, len(tallies.block_energy), cuda.gridDim.x):
        i, kinetic, volumetric = block * THREADS + cuda.threadIdx.x, 0.0, 0.0
        if i < len(scratch.ratio):
            volume, v = scratch.node_grown[i], _vector(state.v, i)
            kinetic, volumetric = volume * _dot(v, v), volume * (scratch.ratio[i] - 1) ** 2
        kinetic, volumetric = _total(shared, kinetic), _total(shared, volumetric)
        if cuda.threadIdx.x == 0:
            tallies.block_energy[block, 0] = kinetic
            tallies.block_energy[block, 1] = volumetric
