"""A run on a GPU: which data stay on the device, and which are transferred.

The body, its motion, and its contacts stay on the device. If growth is a map, the host recomputes the body every few
steps. After a hundred steps, the host receives the number of steps taken and the sums of the energies. It receives the
positions when the body is measured, and when the list of contacts must be renewed, which the host does.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import fsum
from typing import TYPE_CHECKING, Any

import numpy as np

from cortet.errors import StageError
from cortet.folding.body import Body, Material
from cortet.folding.contact import Contact, listed_at
from cortet.folding.device import ON_CPU, is_simulated
from cortet.folding.growth import Course
from cortet.folding.kernels import Motion
from cortet.folding.patches import SIZE, Patches, renew
from cortet.folding.state import Moment, Run
from cortet.meshes import FloatArray, IntArray

if TYPE_CHECKING:
    from cortet.folding.gpu_kernels import Gathered

#: bytes on the device per tetrahedron, for the message when memory is short
_BYTES_PER_TET = 210


class OnGpu:
    """The steps of a moment of a run, on a GPU; a `state.Stepper`."""

    def __init__(self, run: Run, moment: Moment) -> None:
        from cortet.folding import gpu_kernels

        self._gpu, self._moment = gpu_kernels, moment
        self._body = run.body
        self._material, self._elements = Material(*map(float, run.material)), len(run.body.cells)
        #: kernels that have run, with their number of blocks
        self._ready: dict[Any, Any] = {}
        work = moment.work
        with self._told():
            self._patches = Patches(*map(_sent, work.patches))
            self._held = _sent(run.body.held)
            self._lists = gpu_kernels.Gathered(*map(_sent, gathered(run.body, work.patches, moment.contact)))
            self._contact = _on_device(moment.contact)
            self.state, self._before = (Motion(*map(_sent, moment.state)) for _ in range(2))
            scratch = (work.slot_volumes, work.slot_forces, work.node_grown, work.ratio, np.zeros_like(moment.state.x))
            self._scratch = gpu_kernels.Scratch(*map(_sent, scratch))
            self._tallies = self._no_tallies()
            self._energy_tallies = self._no_tallies()

    def begin(self) -> None:
        """Copy the moment from the host."""
        with self._told():
            _overwrite(self.state, self._moment.state)
            self._tallies = self._no_tallies()

    def finish(self) -> None:
        """Copy the present moment back to the host."""
        work = self._moment.work
        with self._told():
            self._moment.state.x[:], self._moment.state.v[:] = map(_fetched, self.state)
            counts, least = _fetched(self._tallies.counts), _fetched(self._tallies.least)
            energy = _fetched(self._tallies.block_energy)
        work.counts[0] += counts[self._gpu.DEGENERATE]
        work.counts[1] = counts[self._gpu.TOUCHED]
        work.min_j[0] = min(work.min_j[0], least[0])
        work.energy[:] += [fsum(energy[:, 0]), fsum(energy[:, 1])]

    def copy(self) -> Motion:
        """The motion of the body, kept until the next copy."""
        with self._told():
            _overwrite(self._before, self.state)
        return self._before

    def advance(self, course: Course, dt: float) -> tuple[int, int]:
        """`kernels.advance` for this moment."""
        with self._told():
            self._tallies.flags.copy_to_device(np.zeros(3, np.int32))
            self._launch(
                self._gpu.advance,
                self._patches,
                self._held,
                self._material,
                self.state,
                self._contact,
                self._lists,
                _sent(course.growth),
                _sent(course.thickening),
                _sent(course.envelope),
                float(dt),
                self._elements,
                self._scratch,
                self._tallies,
            )
            flags = _fetched(self._tallies.flags)
        return int(flags[self._gpu.TAKEN]), int(flags[self._gpu.HOW])

    def take(self, body: Body) -> None:
        """Continue with a body whose `amount`, `gradients` and `volumes` may have changed."""
        if body is not self._body:
            patches = self._moment.work.patches
            renew(patches, body)
            with self._told():
                _put(self._patches.constants, patches.constants)
            self._body = body

    def list_contacts(self, envelope: float) -> None:
        """Renew the list of contacts for a size of the envelope, on the host."""
        with self._told():
            contact = listed_at(self._moment.contact, _fetched(self.state.x), envelope)
            first, touching = _touching(contact)
            self._contact = self._contact._replace(
                offsets=_sent(contact.offsets),
                candidates=_sent(contact.candidates),
                listed=_sent(contact.listed),
                plane=_sent(contact.plane),
            )
            self._lists = self._lists._replace(first=_sent(first), touching=_sent(touching))
        self._moment.contact = contact

    def energies(self, state: Motion, growth: FloatArray, thickening: float) -> tuple[float, float]:
        """Kinetic and elastic energy of a state on the device."""
        tallies = self._energy_tallies
        with self._told():
            self._launch(
                self._gpu.energies,
                self._patches,
                self._material,
                state,
                self._lists,
                _sent(growth),
                float(thickening),
                self._elements,
                self._scratch,
                tallies,
            )
            deviatoric, nodal = _fetched(tallies.patch_least), _fetched(tallies.block_energy)
        elastic = fsum(deviatoric) + self._material.bulk / 2 * fsum(nodal[:, 1])
        return self._material.density / 2 * fsum(nodal[:, 0]), elastic

    def _no_tallies(self) -> Any:
        """Tallies on the device, with all counts at zero."""
        patches, threads = len(self._moment.work.patches.corners), self._gpu.THREADS
        blocks, surface = -(-len(self._moment.state.x) // threads), -(-len(self._moment.contact.nodes) // threads)
        return self._gpu.Tallies(
            flags=_sent(np.zeros(3, np.int32)),
            counts=_sent(np.array([0, self._moment.work.counts[1]], np.int64)),
            least=_sent(np.full(1, np.inf)),
            patch_least=_sent(np.zeros(patches)),
            patch_count=_sent(np.zeros(patches)),
            block_touched=_sent(np.zeros(surface)),
            block_energy=_sent(np.zeros((blocks, 2))),
        )

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Run a kernel with as many blocks as the device holds at a time, because the blocks wait for each other."""
        if kernel not in self._ready:
            self._ready[kernel] = kernel[1, self._gpu.THREADS] if is_simulated() else self._fitted(kernel, arguments)
        self._ready[kernel](*arguments)

    def _fitted(self, kernel: Any, arguments: Sequence[Any]) -> Any:
        """A kernel compiled for its arguments, so that no call checks their types, with its number of blocks."""
        compiled = kernel.specialize(*arguments)
        (overload,) = compiled.overloads.values()
        most = overload.max_cooperative_grid_blocks(self._gpu.THREADS)
        useful = max(len(self._moment.work.patches.corners), -(-len(self._moment.state.x) // self._gpu.THREADS))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the warning that blocks are few: a small mesh or device has no more
            return compiled[min(most, useful), self._gpu.THREADS]

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Translate errors of the device for the user."""
        try:
            yield
        except Exception as error:  # the driver's errors have several classes
            if "CUDA_ERROR" not in str(error):
                raise
            size = f"{self._elements:,} tetrahedra take {self._elements * _BYTES_PER_TET / 1e9:.1f} GB there"
            raise StageError(
                f"the GPU has failed: {' '.join(str(error).split())}", remedy=f"{size}; {ON_CPU}"
            ) from error


def _sent(array: Any) -> Any:
    """A copy of an array on the device; an empty one, which drivers refuse, gets an entry that is never read."""
    from numba import cuda

    return cuda.to_device(np.ascontiguousarray(array if array.size else np.zeros((1, *array.shape[1:]), array.dtype)))


def _fetched(array: Any) -> Any:
    """A copy on the host, once all launched kernels are done."""
    return array.copy_to_host()


def _put(there: Any, values: Any) -> None:
    """Set the values of an array on the device."""
    there.copy_to_device(values)


def _overwrite(state: Any, values: Motion) -> None:
    """Set a state on the device to one on the device or on the host."""
    state.x.copy_to_device(values.x)
    state.v.copy_to_device(values.v)


def _on_device(contact: Contact) -> Contact:
    values: Any = (_sent(value) if isinstance(value, np.ndarray) else float(value) for value in contact)
    return Contact(*values)


def gathered(body: Body, patches: Patches, contact: Contact) -> Gathered:
    """Lists of who adds what: for the nodes of each patch, and for the surface nodes in contact."""
    from cortet.folding.gpu_kernels import Gathered

    m, count = len(body.cells), len(patches.corners)
    slots = (patches.offsets[:-1, None, None] + patches.corners.reshape(count, 4, SIZE)).transpose(0, 2, 1)
    members = np.broadcast_to(SIZE * np.arange(4) + np.arange(SIZE)[:, None], (count, SIZE, 4))
    slot, member = slots.reshape(-1, 4)[:m].ravel(), members.reshape(-1, 4)[:m].ravel()
    place = np.full(len(body.held), -1, np.int32)
    place[contact.nodes] = np.arange(len(contact.nodes))
    corner = place[contact.faces].ravel()
    return Gathered(
        begins=_starts(slot, len(patches.nodes)),
        members=member[np.argsort(slot, kind="stable")].astype(np.uint16),
        place=place,
        starts=_starts(corner, len(contact.nodes)),
        around=np.argsort(corner, kind="stable").astype(np.int32),
        **dict(zip(("first", "touching"), _touching(contact), strict=True)),
    )


def _touching(contact: Contact) -> tuple[IntArray, IntArray]:
    """Surface nodes that might touch each triangle: where those of each triangle begin, and all of them, ascending."""
    nodes = np.repeat(np.arange(len(contact.nodes), dtype=np.int32), np.diff(contact.offsets))
    order = np.argsort(contact.candidates, kind="stable")
    return _starts(contact.candidates, len(contact.faces)), nodes[order]


def _starts(places: IntArray, count: int) -> IntArray:
    """Where the entries of each place begin in a list sorted by place: (count + 1,) int32."""
    return np.append(0, np.cumsum(np.bincount(places, minlength=count))).astype(np.int32)
