"""The steps of a run on a CPU."""

from __future__ import annotations

from cortet.folding.body import Body
from cortet.folding.contact import listed_at
from cortet.folding.growth import Course
from cortet.folding.kernels import Motion, advance, elastic_energy, elastic_forces, kinetic_energy
from cortet.folding.patches import renew
from cortet.folding.state import Moment, Run
from cortet.meshes import FloatArray


class OnCpu:
    """Takes the steps of a moment in place; a `state.Stepper`."""

    def __init__(self, run: Run, moment: Moment) -> None:
        self._run, self._moment, self._body = run, moment, run.body

    @property
    def state(self) -> Motion:
        """The motion of the body."""
        return self._moment.state

    def begin(self) -> None:
        """Do nothing: the state is that of the moment itself."""

    def finish(self) -> None:
        """Do nothing."""

    def copy(self) -> Motion:
        """A copy of the motion of the body."""
        return Motion(self.state.x.copy(), self.state.v.copy())

    def advance(self, course: Course, dt: float) -> tuple[int, int]:
        """`kernels.advance` for this moment."""
        run, moment = self._run, self._moment
        steps, how = advance(self._body, run.material, moment.state, moment.work, moment.contact, course, dt)
        return int(steps), int(how)

    def take(self, body: Body) -> None:
        """Continue with a body whose `amount`, `gradients` and `volumes` may have changed."""
        if body is not self._body:
            renew(self._moment.work.patches, body)
            self._body = body

    def list_contacts(self, envelope: float) -> None:
        """Renew the list of contacts for a size of the envelope."""
        self._moment.contact = listed_at(self._moment.contact, self.state.x, envelope)

    def energies(self, state: Motion, growth: FloatArray, thickening: float) -> tuple[float, float]:
        """Kinetic and elastic energy of a state; the work of the moment is left with J and growth there."""
        run, work = self._run, self._moment.work
        elastic_forces(run.material, state.x, work, growth, thickening)
        return kinetic_energy(run.material, state.v, work), elastic_energy(
            self._body, run.material, state.x, work, growth
        )
