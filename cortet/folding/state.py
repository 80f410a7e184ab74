"""The constants of a run, and its present state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.folding.body import Body, Material, Scale
from cortet.folding.contact import Contact
from cortet.folding.growth import Growth
from cortet.folding.kernels import Motion, Work
from cortet.folding.medial_wall import Wall
from cortet.folding.relaxation import Relaxation
from cortet.meshes import FloatArray, IntArray, TetMesh


class Run(NamedTuple):
    """The constants of a run; nodes and elements are in the order of a space-filling curve."""

    mesh: TetMesh
    #: (n,) and (m,), numbers in the user's mesh
    node: NDArray[np.int64]
    cell: NDArray[np.int64]
    #: (n, 3), mm: the nodes of the body at the start, which has no ripples
    points: FloatArray
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
    #: how fast the core yields; None: it is elastic
    relaxation: Relaxation | None
    #: whether an envelope confines the crowns
    enveloped: bool
    #: times of the simulation at the start and at the end
    start: float
    end: float
    #: time step chosen by the user
    time_step: float | None


@dataclass
class Moment:
    """The present state of a run."""

    step: int
    time: float
    state: Motion
    #: the reference state: `run.body`, but for the gradients of elements that have yielded
    base: Body
    #: the body that `work` holds: `base` as it has grown, where growth was measured
    body: Body
    work: Work
    contact: Contact
    #: energy that growth has brought into the body since the start
    growth_work: float = 0.0
    #: length of the last step: velocities are those half a step ago
    dt: float = 0.0
    #: (n, 3), the mode of the body that limits the time step; None before the first step
    mode: FloatArray | None = None
