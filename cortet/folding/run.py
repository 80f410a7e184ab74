"""A run in memory: its constants, its present state, and its steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.body import (
    Body,
    Material,
    Scale,
    amount_of_growth,
    body_of,
    default_mask,
    growth_mask,
    require_positive,
    scale_of,
)
from cortet.folding.contact import REFERENCE_PENALTY, Contact, contact_of, listed_at, planes_of
from cortet.folding.growth import age_of, check_age, time_of
from cortet.folding.kernels import DONE, INVERTED, LIST_OUTDATED, Motion, Work, advance, energies, workspace
from cortet.folding.measurements import COMPRESSED, DISTORTED, Measurements, shape
from cortet.folding.medial_wall import Wall, medial_wall
from cortet.folding.models import (
    Growth,
    check_model,
    constants,
    labels_of,
    model_of,
    relaxation_of,
    stiffness_of,
    thickness_at_start,
)
from cortet.folding.patches import renew
from cortet.folding.relaxation import PART, Relaxation, relax
from cortet.folding.ripples import without_ripples
from cortet.folding.stability import longest_step
from cortet.geometry.filling import require_body
from cortet.geometry.ordering import curve_order
from cortet.geometry.topology import boundary_faces
from cortet.measure.quality import signed_volumes
from cortet.meshes import REGION, FloatArray, IntArray, MeshSets, TetMesh

#: steps for which growth is computed at once; then its work is added up
_CHUNK = 25
#: the same for the first `_EARLY_STEPS`, in which the work of growth changes fast; a multiple of `_ALIKE`
_EARLY_CHUNK, _EARLY_STEPS = 5, 250
#: steps during which the growth of a map is constant: that in the middle of them
_ALIKE = 5
#: longest step, a hundred in the shortest week: cells large enough for longer ones do not resolve growth
_LONGEST_STEP = 4e-4
#: how many times shorter than the longest step a chosen one may be
_SHORTER = 1000
#: contact and medial plane of the reference
_REFERENCE = {"gap": 0.004, "plane": 1.0, "penalty": REFERENCE_PENALTY}
#: hemisphere -> side of the medial plane in RAS coordinates
_SIDE = {"L": -1.0, "R": 1.0, None: 0.0}


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


def prepared(mesh: TetMesh, settings: Settings) -> Run:
    """The run of a mesh in mm and RAS coordinates."""
    check_age(settings.gestational_age)
    check_model(settings)
    if not settings.gestational_age < settings.end:
        raise InputError(
            f"the fold would end at {settings.end:g} weeks, but the mesh is {settings.gestational_age:g} weeks old",
            remedy="set a later fold.end",
        )
    require_positive(signed_volumes(mesh.points, mesh.cells))
    require_body(mesh)
    mesh, node, cell = _ordered(mesh)
    scale = scale_of(mesh, settings.hemisphere, reference=settings.reference)
    chosen, start = constants(settings), time_of(settings.gestational_age)
    material = Material(mu_core=chosen.core_stiffness, damping=chosen.damping, own=chosen.own)
    labels, regions = labels_of(mesh, settings)
    wall = None
    if settings.hemisphere is not None and not settings.reference:
        wall = medial_wall(mesh, settings.hemisphere, scale.origin, scale.length)
    held = None if wall is None else wall.nodes
    mask, amount = growth_mask(mesh, scale, held, reference=settings.reference), None
    if settings.model == "growing":  # growth and stiffness of a spot are independent
        mask, amount = default_mask(mesh, scale, held), amount_of_growth(mesh)
    thickness = thickness_at_start(settings, scale)
    points = without_ripples(mesh, chosen.smoothing, held) if chosen.smoothing else mesh.points
    body = body_of(
        replace(mesh, points=points),
        scale,
        thickness=thickness,
        mask=mask,
        amount=amount,
        labels=labels,
        held=held,
        reference=settings.reference,
    )
    if regions is not None:
        body = body._replace(label=body.label * (len(settings.core_regions) + 1) + regions)
    if settings.region_stiffness:
        body = body._replace(stiffness=stiffness_of(mesh, settings))
    side = _SIDE[settings.hemisphere]
    faces, end = boundary_faces(mesh), time_of(settings.end)
    return Run(
        mesh=mesh,
        node=node,
        cell=cell,
        points=points,
        scale=scale,
        body=body,
        wall=wall,
        faces=faces,
        side=side,
        reference=settings.reference,
        material=material,
        growth=model_of(body, mesh, settings),
        relaxation=relaxation_of(mesh, settings),
        enveloped=chosen.envelope,
        start=start,
        end=end,
        time_step=settings.time_step,
    )


def described(run: Run) -> list[str]:
    """The assumptions of a run, in sentences."""
    sentences = [f"the growing cortex is {thickness_mm(run):.2f} mm thick at the start"]
    if run.wall is not None:
        sentences.append(
            f"medial wall: {run.wall.area_mm2:.0f} mm2, {run.wall.share:.1%} of the surface; {run.wall.found}"
        )
    course, stretch = run.growth.at(np.array([run.end]), 0.0), run.growth.frame(run.end)
    along, across, _ = (1 + course.growth[0, 0]).tolist()
    core = f"lengths of the core grow by a factor of {stretch:.2f}" if stretch != 1 else "the core does not grow"
    if run.growth.mapped:
        grown = run.growth.body(run.body, run.end)
        cortex = run.body.depth < run.body.thickness
        along = 1 + float(np.average(grown.amount[cortex], weights=run.body.mask[cortex] * run.body.volumes[cortex]))
    sentences.append(
        f"until {age_of(run.end):g} weeks {core}; relative to the core the cortex grows by a factor of {along:.2f} "
        f"along the surface{', on average, as it was measured,' if run.growth.mapped else ''} and {across:.2f} across"
        + (f"; the envelope grows by a factor of {float(course.envelope[0]) * stretch:.2f}" if run.enveloped else "")
    )
    return sentences


def thickness_mm(run: Run) -> float:
    """Mean thickness of the growing cortex at the start, mm."""
    return float(run.body.thickness.mean()) * run.scale.length


def _ordered(mesh: TetMesh) -> tuple[TetMesh, NDArray[np.int64], NDArray[np.int64]]:
    """The mesh along a space-filling curve, and the number of each node and cell in the given mesh."""
    node = curve_order(mesh.points)
    cells = np.argsort(node).astype(np.int32)[mesh.cells]
    cell = np.argsort(cells.min(axis=1), kind="stable")
    fields = {name: values[node] for name, values in mesh.point_data.items()}
    number = np.argsort(node).astype(np.int32)
    place = np.argsort(cell).astype(np.int32)
    sets = MeshSets(
        faces={name: number[faces] for name, faces in mesh.sets.faces.items()},
        cells={name: np.sort(place[chosen]) for name, chosen in mesh.sets.cells.items()},
    )
    of_cells = {name: values[cell] for name, values in mesh.cell_data.items() if name == REGION}
    return TetMesh(mesh.points[node], cells[cell], fields, of_cells, sets=sets), node, cell


def beginning(run: Run) -> Moment:
    """The undeformed body at rest."""
    x = (run.points - run.scale.origin) / run.scale.length
    body, volumes = run.body, np.repeat(run.body.volumes / 4, 4)
    if run.relaxation:
        body = body._replace(gradients=body.gradients.copy())
    weighted = {"volumes": np.bincount(body.cells.ravel(), volumes)}
    contact = contact_of(
        x,
        run.faces,
        bulk=run.material.bulk,
        side=run.side,
        planes=planes_of(ConvexHull(x)) if run.enveloped else None,
        **(_REFERENCE if run.reference else weighted),
    )
    work = workspace(body, smoothed=run.material.own < 1)
    moment = Moment(0, run.start, Motion(x, np.zeros_like(x)), body, body, work, contact)
    if run.time_step is not None:
        limit = _longest_step(run, moment)
        if not limit / _SHORTER <= run.time_step <= limit:
            raise InputError(
                f"time step {run.time_step:g} is not between {limit / _SHORTER:.3g} and {limit:.3g}, "
                "the longest that is stable for this mesh",
                remedy="leave time_step out, or choose one in this range",
            )
    return moment


def advance_to(run: Run, moment: Moment, target: float) -> bool:
    """Step until the time `target`; True if the run ended before, at an inverted element.

    The time step is that for the present body (`time_step_of`), or a little less, so that all steps are equal.
    """
    begin = moment.time
    steps = max(int(np.ceil((target - begin) / time_step_of(run, moment) - 1e-9)), 1)
    dt = (target - begin) / steps
    length = _CHUNK if moment.step >= _EARLY_STEPS else _EARLY_CHUNK
    chunks = (np.arange(first, min(steps, first + length)).astype(float) for first in range(0, steps, length))
    energy = sum(_energies(run, moment, begin - moment.dt / 2))
    inverted = False
    for chunk in chunks:
        inverted, energy = _advance_over(run, moment, begin + dt * chunk, dt, energy)
        if inverted:
            break
    if not inverted:
        moment.time = target
    return inverted


def time_step_of(run: Run, moment: Moment) -> float:
    """Time step for the present body; one that the user has chosen holds as long as it is not too long."""
    return min(run.time_step or np.inf, _longest_step(run, moment))


def _longest_step(run: Run, moment: Moment) -> float:
    """The longest step for the present body; the moment keeps the mode that limits it."""
    course = run.growth.at(np.array([moment.time]), 0.0)
    _take(moment, run.growth.body(moment.base, moment.time))
    step, moment.mode = longest_step(
        run.material,
        moment.state.x,
        moment.work,
        moment.contact,
        course.growth[0],
        thickening=float(course.thickening[0]),
        mode=moment.mode,
    )
    return min(step, _LONGEST_STEP)


def _advance_over(run: Run, moment: Moment, times: FloatArray, dt: float, energy: float) -> tuple[bool, float]:
    """Take one step at each of `times`; `energy` is the energy before them.

    Also adds up the energy that growth brings into the body. At a fixed shape, only growth changes the energy, from
    that with the earlier growth to that with the later one. The work of growth is the mean of this change over the
    shapes at both ends (trapezoidal rule). All are taken half a step ago, where the velocities are.

    Returns
    -------
    whether the run ended at an inverted element; the energy after the steps
    """
    course, begin, count = run.growth.at(times, dt), float(times[0]), len(times)
    before, after = begin - moment.dt / 2, begin + dt * (count - 0.5)
    held = sum(_energies(run, moment, after))
    alike = _alike(run, begin, dt, count)
    done, how = 0, LIST_OUTDATED
    _relax(run, moment, before, dt * min(alike, count) / 2)
    while done < count and how != INVERTED:
        first = done - done % alike
        middle = begin + dt * (first + (min(alike, count - first) - 1) / 2)
        _take(moment, run.growth.body(moment.base, middle))
        part = course.part(done, first + alike)
        steps, how = advance(moment.body, run.material, moment.state, moment.work, moment.contact, part, dt)
        done, moment.dt = done + int(steps), dt
        if how == LIST_OUTDATED:
            moment.contact = listed_at(moment.contact, moment.state.x, float(course.envelope[done]))
        elif how == DONE:  # half of this part, and half of the next
            _relax(run, moment, begin + dt * (done - 0.5), dt * (done - first + min(alike, count - done)) / 2)
    moved, end = sum(_energies(run, moment, before)), sum(_energies(run, moment, after))
    moment.growth_work += (held - energy + end - moved) / 2
    moment.step, moment.time = moment.step + done, begin + dt * done
    return bool(how == INVERTED), end


def _alike(run: Run, time: float, dt: float, steps: int) -> int:
    """Steps during which the reference state is the same, for a map of growth and tissue that yields."""
    alike = _ALIKE if run.growth.mapped else steps
    if run.relaxation and (fastest := float(run.relaxation.rates(age_of(time)).max())) > 0:
        alike = min(alike, max(int(PART / fastest / (age_of(time + dt) - age_of(time))), 1))
    return alike


def _relax(run: Run, moment: Moment, time: float, duration: float) -> None:
    """Let tissue yield for a duration around a time; the energy that this takes is dissipated."""
    if not run.relaxation:
        return
    age, course = age_of(time), run.growth.at(np.array([time]), moment.dt)
    parts = 1 - np.exp(-run.relaxation.rates(age) * (age_of(time + duration) - age))
    _, before = _energies(run, moment, time)
    thickening = float(course.thickening[0])
    relax(moment.base.gradients, moment.work, course.growth[0], thickening, parts[run.relaxation.law])
    moment.body = run.growth.body(moment.base, time)
    renew(moment.work.patches, moment.body)
    moment.work.energy[0] += before - _energies(run, moment, time)[1]


def _take(moment: Moment, body: Body) -> None:
    """Continue with a body whose `amount`, `gradients` and `volumes` may have changed."""
    if body is not moment.body:
        renew(moment.work.patches, body)
        moment.body = body


def _energies(run: Run, moment: Moment, time: float) -> tuple[float, float]:
    """Kinetic and elastic energy half a step ago, with the growth at a time."""
    return _energies_at(run, moment, moment.state.x - moment.dt / 2 * moment.state.v, time)


def _energies_at(run: Run, moment: Moment, x: FloatArray, time: float) -> tuple[float, float]:
    """The same at positions x (n, 3), whose growth and volumes stay in `moment.work`."""
    course = run.growth.at(np.array([time]), moment.dt)
    _take(moment, run.growth.body(moment.base, time))
    state = Motion(x, moment.state.v)
    return energies(run.material, state, moment.work, course.growth[0], float(course.thickening[0]))


def millimetres(run: Run, moment: Moment) -> FloatArray:
    """Positions of the nodes: (n, 3) mm."""
    return run.scale.origin + run.scale.length * run.growth.frame(moment.time) * moment.state.x


def measured(run: Run, moment: Moment, distortion: FloatArray) -> Measurements:
    """Measure the body in its present state; its J and growth are left in `moment.work`.

    Parameters
    ----------
    distortion : (m,), of each element, as `mechanics.distortion` gives it
    """
    work = moment.work
    kinetic, elastic = _energies(run, moment, moment.time - moment.dt / 2)
    _energies_at(run, moment, moment.state.x, moment.time)  # volumes are those of now
    dissipated, pushed = work.energy.tolist()
    missing = kinetic + elastic + dissipated - moment.growth_work - pushed
    flow = abs(moment.growth_work) + abs(pushed)
    inverted = int((~(work.current > 0)).sum())
    j = work.current / work.grown
    points = millimetres(run, moment)
    cortex = float(work.share @ work.current) * (run.scale.length * run.growth.frame(moment.time)) ** 3
    return Measurements(
        step=moment.step,
        time=moment.time,
        gestational_age=age_of(moment.time),
        kinetic_energy=kinetic,
        elastic_energy=elastic,
        dissipated_energy=dissipated,
        growth_work=moment.growth_work,
        contact_work=pushed,
        energy_error=None if inverted else missing / flow if flow else 0.0,
        min_j=min(float(j.min()), float(work.min_j[0])),
        inverted=inverted,
        degenerate=int(work.counts[0]),
        contacts=int(work.counts[1]),
        distortion=None if inverted else float(np.average(distortion, weights=work.grown)),
        distortion_max=None if inverted else float(distortion.max()),
        distorted_share=float((distortion > DISTORTED).mean()),
        compressed_share=float((j < COMPRESSED).mean()),
        gyrification_index_error=None,
        fold_spacing_error_mm=None,
        **shape(points, run.faces, run.body.held, cortex),
    )
