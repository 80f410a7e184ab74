"""Who takes the steps of a run: a CPU, or a GPU with its own memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from cortet.mesh import FloatArray
from cortet.simulation.contact import listed_at
from cortet.simulation.kernels import Motion, advance, elastic_energy, elastic_forces, kinetic_energy

if TYPE_CHECKING:
    from cortet.simulation.run import Moment, Run


class Stepper(Protocol):
    """Steps of a moment; between `begin` and `finish` the moment itself may be behind."""

    @property
    def state(self) -> Motion:
        """Where the body is, in the memory of the device."""

    def begin(self) -> None:
        """Take the moment as it is."""

    def finish(self) -> None:
        """Bring the moment up to date."""

    def copy(self) -> Motion:
        """Where the body is, kept until the next copy."""

    def advance(self, alphas: FloatArray, thickening: FloatArray, dt: float) -> tuple[int, int]:
        """As many steps as `alphas` has rows, as `kernels.advance`: steps taken, and how it ended."""

    def list_contacts(self) -> None:
        """Make the list of contacts anew."""

    def energies(self, state: Motion, alphas: FloatArray, thickening: float) -> tuple[float, float]:
        """Kinetic and elastic energy of a state with some growth of each label, and of the thickness."""


class OnCpu:
    """The steps of a moment, in place."""

    def __init__(self, run: Run, moment: Moment) -> None:
        self._run, self._moment = run, moment

    @property
    def state(self) -> Motion:
        """Where the body is."""
        return self._moment.state

    def begin(self) -> None:
        """Nothing: the moment is the memory."""

    def finish(self) -> None:
        """Nothing."""

    def copy(self) -> Motion:
        """Where the body is."""
        return Motion(self.state.x.copy(), self.state.v.copy())

    def advance(self, alphas: FloatArray, thickening: FloatArray, dt: float) -> tuple[int, int]:
        """`kernels.advance` for this moment."""
        run, moment = self._run, self._moment
        steps, how = advance(run.body, run.material, moment.state, moment.work, moment.contact, alphas, thickening, dt)
        return int(steps), int(how)

    def list_contacts(self) -> None:
        """Make the list of contacts anew."""
        self._moment.contact = listed_at(self._moment.contact, self.state.x)

    def energies(self, state: Motion, alphas: FloatArray, thickening: float) -> tuple[float, float]:
        """Kinetic and elastic energy of a state; the work of the moment is left with J and growth there."""
        run, work = self._run, self._moment.work
        elastic_forces(run.material, state.x, work, alphas, thickening)
        return kinetic_energy(run.material, state.v, work), elastic_energy(
            run.body, run.material, state.x, work, alphas
        )
