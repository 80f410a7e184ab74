"""The settings of a run, what stays the same during it, and its present state.

The steppers of CPU and GPU both know these, and not each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cortet.meshes import FloatArray, IntArray, TetMesh
from cortet.simulation.body import Body, Material, Scale
from cortet.simulation.contact import Contact
from cortet.simulation.growth import ByAge, Course, Growth
from cortet.simulation.kernels import Motion, Work
from cortet.simulation.medial_wall import Wall
from cortet.simulation.section import DEFAULT, Model


@dataclass(frozen=True)
class Settings:
    """What a run depends on besides its mesh."""

    #: of the mesh, weeks; growth is relative to it
    gestational_age: float
    #: "L" or "R" for half a brain, held back by the medial plane; None for a whole one
    hemisphere: str | None = None
    #: gestational age at which the run ends, weeks
    end: float = DEFAULT.end
    #: "growing": the whole does; "braingrowth": only the cortex
    model: Model = DEFAULT.model
    #: tangential growth of the cortex, relative to the core per week or by age, or per unit of time; None: the model's
    growth_rate: ByAge | None = DEFAULT.growth_rate
    #: change of the thickness without stress; None: the model's
    thickness_rate: ByAge | None = DEFAULT.thickness_rate
    #: age -> volume, mL; None: the model's
    volume: Mapping[float, float] | None = DEFAULT.volume
    #: whether the growth before the age of the mesh, as far as its shape does not show it, comes in the first week
    start: Literal["stressed", "free"] = DEFAULT.start
    #: whether an envelope holds the crowns; None: if the model has one
    envelope: bool | None = DEFAULT.envelope
    #: age -> volume of the convex hull, mL; None: the model's
    hull: Mapping[float, float] | None = DEFAULT.hull
    #: region of the mesh, or set of tetrahedra -> how much more than the rest of the core its lengths grow
    core_regions: Mapping[int | str, ByAge] = field(default_factory=dict)
    #: shear modulus of the core over that of the cortex; None: the model's
    core_stiffness: float | None = DEFAULT.core_stiffness
    #: region of the mesh, or set of tetrahedra -> shear modulus of its core over that of the cortex
    region_stiffness: Mapping[int | str, float] = field(default_factory=dict)
    #: label -> amplitude, rate and latency of a Gompertz law, which replaces `growth_rate` there
    regions: Mapping[int, Sequence[float]] = field(default_factory=dict)
    #: of the cortex at the start, mm; None takes the model's; a field of the mesh replaces it
    thickness: float | None = DEFAULT.thickness
    #: dimensionless; None takes it from the smallest altitude of the body as it is at each row of the table
    time_step: float | None = DEFAULT.time_step
    #: centre, mask, medial plane, start of growth and lag of one step as in the reference, for comparison with it
    reference: bool = DEFAULT.reference
    #: weeks between two rows of the table, and between two frames
    record_interval: float = DEFAULT.record_interval
    frame_interval: float = DEFAULT.frame_interval
    #: what takes the steps
    device: Literal["cpu", "cuda"] = DEFAULT.device


class Run(NamedTuple):
    """What stays the same during a run; nodes and elements are in the order of a space-filling curve."""

    mesh: TetMesh
    #: (n,) and (m,), number in the user's mesh
    node: NDArray[np.int64]
    cell: NDArray[np.int64]
    scale: Scale
    body: Body
    #: of half a brain
    wall: Wall | None
    #: (k, 3) int32, boundary
    faces: IntArray
    #: of the medial plane on which the body stays, or 0
    side: float
    #: whether the choices of the reference hold
    reference: bool
    material: Material
    growth: Growth
    #: whether an envelope holds the crowns
    enveloped: bool
    #: times of the simulation at the start and at the end
    start: float
    end: float
    #: that the user has chosen
    time_step: float | None
    #: "cpu", or what the GPU is called that takes the steps
    device: str


class Stepper(Protocol):
    """Takes the steps of a run from a moment on; between `begin` and `finish` the moment itself may lag behind."""

    @property
    def state(self) -> Motion:
        """Where the body is, in the memory of the device."""

    def begin(self) -> None:
        """Take the moment as it is."""

    def finish(self) -> None:
        """Bring the moment up to date."""

    def copy(self) -> Motion:
        """Where the body is, kept until the next copy."""

    def advance(self, course: Course, dt: float) -> tuple[int, int]:
        """As many steps as a course has, as `kernels.advance`: steps taken, and how it ended."""

    def take(self, body: Body) -> None:
        """Go on with a body whose `amount`, `gradients` and `volumes` may be others than before."""

    def list_contacts(self, envelope: float) -> None:
        """Make the list of contacts anew for a size of the envelope."""

    def energies(self, state: Motion, growth: FloatArray, thickening: float) -> tuple[float, float]:
        """Kinetic and elastic energy of a state with some growth of each label, and of the thickness."""


@dataclass
class Moment:
    """The present state of a run."""

    step: int
    time: float
    state: Motion
    work: Work
    contact: Contact
    #: energy that growth has brought into the body since the start
    growth_work: float = 0.0
    #: that takes the steps from here on, once it has begun
    stepper: Stepper | None = None
