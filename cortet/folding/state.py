"""The settings of a run, its constants, and its present state.

The steppers of CPU and GPU both use these, and do not know each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cortet.folding.body import Body, Material, Scale
from cortet.folding.contact import Contact
from cortet.folding.growth import ByAge, Course, Growth
from cortet.folding.kernels import Motion, Work
from cortet.folding.medial_wall import Wall
from cortet.folding.section import DEFAULT, Model
from cortet.meshes import FloatArray, IntArray, TetMesh


@dataclass(frozen=True)
class Settings:
    """The inputs of a run besides its mesh."""

    #: age of the mesh, weeks; growth is relative to it
    gestational_age: float
    #: "L" or "R" for half a brain, which the medial plane confines; None for a whole one
    hemisphere: str | None = None
    #: gestational age at which the run ends, weeks
    end: float = DEFAULT.end
    #: "growing": the whole brain grows; "braingrowth": only the cortex
    model: Model = DEFAULT.model
    #: tangential growth of the cortex, relative to the core per week or by age, or per unit of time; None: the model's
    growth_rate: ByAge | None = DEFAULT.growth_rate
    #: change of the thickness without stress; None: the model's
    thickness_rate: ByAge | None = DEFAULT.thickness_rate
    #: age -> volume, mL; None: the model's
    volume: Mapping[float, float] | None = DEFAULT.volume
    #: whether the growth before the age of the mesh comes in the first week, as far as its shape does not show it
    start: Literal["stressed", "free"] = DEFAULT.start
    #: whether an envelope confines the crowns; None: if the model has one
    envelope: bool | None = DEFAULT.envelope
    #: age -> volume of the convex hull, mL; None: the model's
    hull: Mapping[float, float] | None = DEFAULT.hull
    #: region of the mesh, or set of tetrahedra -> growth of its lengths relative to the rest of the core
    core_regions: Mapping[int | str, ByAge] = field(default_factory=dict)
    #: shear modulus of the core over that of the cortex; None: the model's
    core_stiffness: float | None = DEFAULT.core_stiffness
    #: region of the mesh, or set of tetrahedra -> shear modulus of its core over that of the cortex
    region_stiffness: Mapping[int | str, float] = field(default_factory=dict)
    #: label -> amplitude, rate and latency of a Gompertz law, which replaces `growth_rate` there
    regions: Mapping[int, Sequence[float]] = field(default_factory=dict)
    #: thickness of the cortex at the start, mm; None: the model's; a field of the mesh replaces it
    thickness: float | None = DEFAULT.thickness
    #: dimensionless; None: from the smallest altitude of the body in its state at each row of the table
    time_step: float | None = DEFAULT.time_step
    #: centre, mask, medial plane, start of growth and lag of one step as in the reference, for comparison with it
    reference: bool = DEFAULT.reference
    #: weeks between two rows of the table, and between two frames
    record_interval: float = DEFAULT.record_interval
    frame_interval: float = DEFAULT.frame_interval
    #: device that takes the steps
    device: Literal["cpu", "cuda"] = DEFAULT.device


class Run(NamedTuple):
    """The constants of a run; nodes and elements are in the order of a space-filling curve."""

    mesh: TetMesh
    #: (n,) and (m,), numbers in the user's mesh
    node: NDArray[np.int64]
    cell: NDArray[np.int64]
    scale: Scale
    body: Body
    #: the medial wall of half a brain
    wall: Wall | None
    #: (k, 3) int32, boundary
    faces: IntArray
    #: side of the medial plane on which the body stays, or 0
    side: float
    #: whether the run follows the reference
    reference: bool
    material: Material
    growth: Growth
    #: whether an envelope confines the crowns
    enveloped: bool
    #: times of the simulation at the start and at the end
    start: float
    end: float
    #: time step chosen by the user
    time_step: float | None
    #: "cpu", or the name of the GPU that takes the steps
    device: str


class Stepper(Protocol):
    """Takes the steps of a run from a moment on; between `begin` and `finish` the moment itself may be out of date."""

    @property
    def state(self) -> Motion:
        """The motion of the body, in the memory of the device."""

    def begin(self) -> None:
        """Start from the moment."""

    def finish(self) -> None:
        """Bring the moment up to date."""

    def copy(self) -> Motion:
        """The motion of the body, kept until the next copy."""

    def advance(self, course: Course, dt: float) -> tuple[int, int]:
        """Take the steps of a course, as `kernels.advance`; return the steps taken, and how it ended."""

    def take(self, body: Body) -> None:
        """Continue with a body whose `amount`, `gradients` and `volumes` may have changed."""

    def list_contacts(self, envelope: float) -> None:
        """Renew the list of contacts for a size of the envelope."""

    def energies(self, state: Motion, growth: FloatArray, thickening: float) -> tuple[float, float]:
        """Kinetic and elastic energy of a state, for growth of each label and a gain in thickness."""


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
    #: takes the steps from here on, once it has begun
    stepper: Stepper | None = None
