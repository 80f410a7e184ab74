"""A run in memory: what stays the same, where it is, and how it goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.ordering import curve_order
from cortet.geometry.topology import boundary_faces
from cortet.mesh import FloatArray, IntArray, TetMesh
from cortet.simulation.body import (
    LABEL_FIELD,
    THICKENING,
    THICKNESS,
    Body,
    Material,
    Scale,
    body_of,
    growth_mask,
    largest_time_step,
    scale_of,
    smallest_altitude,
    stable_time_step,
)
from cortet.simulation.contact import Contact, contact_of, listed_at
from cortet.simulation.growth import Gompertz, Law, Linear, age_of, growth_since, time_of
from cortet.simulation.kernels import (
    INVERTED,
    LIST_OUTDATED,
    Motion,
    Work,
    advance,
    elastic_energy,
    elastic_forces,
    workspace,
)
from cortet.simulation.measurements import Measurements, shape

#: steps for which growth is computed at a time
_CHUNK = 500
#: hemisphere -> side of the medial plane in RAS coordinates
_SIDE = {"L": -1.0, "R": 1.0, None: 0.0}


@dataclass(frozen=True)
class Settings:
    """What a run depends on besides its mesh."""

    #: of the mesh, weeks; growth is relative to it
    gestational_age: float
    #: "L" or "R" for half a brain, held back by the medial plane; None for a whole one
    hemisphere: str | None = None
    #: gestational age at which the run ends, weeks
    end: float = 40.0
    #: tangential growth per unit of time
    growth_rate: float = 1.829
    #: label -> amplitude, rate and latency of a Gompertz law, which replaces `growth_rate` there
    regions: Mapping[int, Sequence[float]] = field(default_factory=dict)
    #: of the cortex at the start, mm; None takes 0.042 + 0.01 t of the unit of length; a field of the mesh replaces it
    thickness: float | None = None
    #: dimensionless; None takes it from the smallest altitude of the mesh
    time_step: float | None = None
    #: weeks between two rows of the table, and between two frames
    record_interval: float = 0.1
    frame_interval: float = 1.0


class Run(NamedTuple):
    """What stays the same during a run; nodes and elements are in the order of a space-filling curve."""

    mesh: TetMesh
    #: (n,) and (m,), number in the user's mesh
    node: NDArray[np.int64]
    cell: NDArray[np.int64]
    scale: Scale
    body: Body
    #: (k, 3) int32, boundary
    faces: IntArray
    #: of the plane x = 0 on which the body stays, or 0
    side: float
    material: Material
    laws: Sequence[Law]
    #: time of the simulation at the start
    start: float
    time_step: float
    steps: int


@dataclass
class Moment:
    """Where a run is."""

    step: int
    state: Motion
    work: Work
    contact: Contact


def prepared(mesh: TetMesh, settings: Settings) -> Run:
    """The run of a mesh in mm and RAS coordinates.

    Raises
    ------
    InputError : nothing to grow, an inverted element, a field with impossible values or one that is missing, or a time
        step that is not stable
    """
    if not settings.gestational_age < settings.end:
        raise InputError(
            f"nothing grows from {settings.gestational_age:g} to {settings.end:g} weeks", remedy="set a later end"
        )
    mesh, node, cell = _ordered(mesh)
    scale, material, start = scale_of(mesh, settings.hemisphere), Material(), time_of(settings.gestational_age)
    laws, labels = _laws(mesh, settings.growth_rate, settings.regions)
    thickness = THICKNESS + THICKENING * start if settings.thickness is None else settings.thickness / scale.length
    mask = growth_mask(mesh, scale, settings.hemisphere)
    body = body_of(mesh, scale, thickness=thickness, mask=mask, labels=labels)
    altitude = smallest_altitude(mesh.points, mesh.cells) / scale.length
    duration = time_of(settings.end) - start
    bound = largest_time_step(altitude, material)
    if settings.time_step is not None and not 0 < settings.time_step <= bound:
        raise InputError(
            f"time step {settings.time_step:g} is not above 0 and at most {bound:.3g}, the limit of stability",
            remedy="leave time_step out, or choose a smaller one",
        )
    steps = int(np.ceil(duration / (settings.time_step or stable_time_step(altitude, material))))
    side = _SIDE[settings.hemisphere]
    return Run(
        mesh, node, cell, scale, body, boundary_faces(mesh), side, material, laws, start, duration / steps, steps
    )


def _ordered(mesh: TetMesh) -> tuple[TetMesh, NDArray[np.int64], NDArray[np.int64]]:
    """The mesh along a space-filling curve, and the number of each node and cell in the one given."""
    node = curve_order(mesh.points)
    cells = np.argsort(node).astype(np.int32)[mesh.cells]
    cell = np.argsort(cells.min(axis=1), kind="stable")
    fields = {name: values[node] for name, values in mesh.point_data.items()}
    return TetMesh(mesh.points[node], cells[cell], fields), node, cell


def _laws(
    mesh: TetMesh, growth_rate: float, regions: Mapping[int, Sequence[float]]
) -> tuple[list[Law], IntArray | None]:
    """The growth laws, and which of them holds at each node: the first one where no region says otherwise."""
    if not regions:
        return [Linear(growth_rate)], None
    if LABEL_FIELD not in mesh.point_data:
        raise InputError(
            f"growth differs by region, but the mesh has no field {LABEL_FIELD}",
            remedy="carry one to the mesh, or leave the regions out",
        )
    law = np.zeros(len(mesh.points), np.int32)
    for number, label in enumerate(regions, start=1):
        law[mesh.point_data[LABEL_FIELD] == int(label)] = number
    return [Linear(growth_rate), *(Gompertz(*values) for values in regions.values())], law


def beginning(run: Run) -> Moment:
    """The undeformed body at rest."""
    x = (run.mesh.points - run.scale.origin) / run.scale.length
    contact = contact_of(x, run.faces, bulk=run.material.bulk, side=run.side)
    return Moment(0, Motion(x, np.zeros_like(x)), workspace(run.body), contact)


def advance_to(run: Run, moment: Moment, target: int) -> bool:
    """Step until `target`; True when it ended before, at an inverted element."""
    while moment.step < target:
        steps = np.arange(moment.step, min(target, moment.step + _CHUNK))
        done, how = advance(
            run.body, run.material, moment.state, moment.work, moment.contact, *_growth(run, steps), run.time_step
        )
        moment.step += done
        if how == LIST_OUTDATED:
            moment.contact = listed_at(moment.contact, moment.state.x)
        elif how == INVERTED:
            return True
    return False


def _growth(run: Run, steps: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Growth of each label (k, labels) and thickening (k,) at some steps."""
    times: FloatArray = run.start + run.time_step * steps.astype(float)
    alphas = np.stack([growth_since(law, run.start, times) for law in run.laws], axis=1)
    return alphas, THICKENING * (times - run.start)


def millimetres(run: Run, moment: Moment) -> FloatArray:
    """Where the nodes are: (n, 3) mm."""
    return run.scale.origin + run.scale.length * moment.state.x


def measured(run: Run, moment: Moment) -> Measurements:
    """Measure the body as it is; its J and growth are left in `moment.work`."""
    x, v, work = moment.state.x, moment.state.v, moment.work
    time = run.start + run.time_step * moment.step
    (alphas,), (thickening,) = _growth(run, np.array([moment.step]))
    smallest = elastic_forces(run.body, run.material, x, work, alphas, thickening)
    return Measurements(
        step=moment.step,
        time=time,
        gestational_age=age_of(time),
        kinetic_energy=run.material.density / 2 * float((run.body.node_volumes[:, None] * v**2).sum()),
        elastic_energy=elastic_energy(run.body, run.material, x, work, alphas),
        min_j=float(min(smallest, work.min_j[0])),
        inverted=int((~(work.current > 0)).sum()),
        degenerate=int(work.counts[0]),
        contacts=int(work.counts[1]),
        **shape(millimetres(run, moment), run.mesh.cells, run.faces),
    )
