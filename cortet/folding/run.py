"""A run in memory: its preparation, its beginning, and its steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from cortet.errors import InputError
from cortet.folding.altitude import smallest_altitude
from cortet.folding.body import (
    Body,
    Material,
    amount_of_growth,
    body_of,
    default_mask,
    growth_mask,
    largest_time_step,
    require_positive,
    scale_of,
    stable_time_step,
)
from cortet.folding.contact import contact_of, listed_at
from cortet.folding.convex import planes_of
from cortet.folding.growth import age_of, check_age, time_of
from cortet.folding.kernels import (
    INVERTED,
    LIST_OUTDATED,
    Motion,
    advance,
    elastic_energy,
    elastic_forces,
    kinetic_energy,
    workspace,
)
from cortet.folding.measurements import Measurements, shape
from cortet.folding.medial_wall import medial_wall
from cortet.folding.models import check_model, constants, labels_of, model_of, stiffness_of, thickness_at_start
from cortet.folding.patches import renew
from cortet.folding.section import Settings
from cortet.folding.state import Moment, Run
from cortet.geometry.filling import require_body
from cortet.geometry.ordering import curve_order
from cortet.geometry.topology import boundary_faces
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import REGION, FloatArray, MeshSets, TetMesh

#: steps for which growth is computed at once; then its work is added up
_CHUNK = 100
#: the same for the first `_EARLY_STEPS`, in which the work of growth changes fast; a multiple of `_ALIKE`
_EARLY_CHUNK, _EARLY_STEPS = 20, 1000
#: steps during which the growth of a map is constant: that in the middle of them
_ALIKE = 20
#: medial plane of the reference
_REFERENCE_PLANE = {"gap": 0.004, "plane": 1.0}
#: hemisphere -> side of the medial plane in RAS coordinates
_SIDE = {"L": -1.0, "R": 1.0, None: 0.0}


def prepared(mesh: TetMesh, settings: Settings) -> Run:
    """The run of a mesh in mm and RAS coordinates.

    Raises
    ------
    InputError : nothing grows; the tetrahedra fill no body, or one is inverted;
        a field is missing or has impossible values; or the time step is not stable
    """
    check_age(settings.gestational_age)
    check_model(settings)
    if not settings.gestational_age < settings.end:
        raise InputError(
            f"nothing grows from {settings.gestational_age:g} to {settings.end:g} weeks", remedy="set a later end"
        )
    require_positive(signed_volumes(mesh.points, mesh.cells))
    require_body(mesh)
    mesh, node, cell = _ordered(mesh)
    scale = scale_of(mesh, settings.hemisphere, reference=settings.reference)
    material, start = Material(mu_core=constants(settings).core_stiffness), time_of(settings.gestational_age)
    labels, regions = labels_of(mesh, settings)
    wall = None
    if settings.hemisphere is not None and not settings.reference:
        wall = medial_wall(mesh, settings.hemisphere, scale.origin, scale.length)
    held = None if wall is None else wall.nodes
    mask, amount = growth_mask(mesh, scale, held, reference=settings.reference), None
    if settings.model == "growing":  # growth and stiffness of a spot are independent
        mask, amount = default_mask(mesh, scale, held), amount_of_growth(mesh)
    thickness = thickness_at_start(settings, scale)
    body = body_of(mesh, scale, thickness=thickness, mask=mask, amount=amount, labels=labels, held=held)
    if regions is not None:
        body = body._replace(label=body.label * (len(settings.core_regions) + 1) + regions)
    if settings.region_stiffness:
        body = body._replace(stiffness=stiffness_of(mesh, settings))
    altitude, bound = smallest_altitude(mesh.points, mesh.cells) / scale.length, settings.time_step
    limit = largest_time_step(altitude, _stiffest(material, body))
    if bound is not None and not 0 < bound <= limit:
        raise InputError(
            f"time step {bound:g} is not above 0 and at most {limit:.3g}, the limit of stability",
            remedy="leave time_step out, or choose a smaller one",
        )
    side = _SIDE[settings.hemisphere]
    faces, end = boundary_faces(mesh), time_of(settings.end)
    return Run(
        mesh,
        node,
        cell,
        scale,
        body,
        wall,
        faces,
        side,
        settings.reference,
        material,
        model_of(body, mesh, settings),
        constants(settings).envelope,
        start,
        end,
        bound,
    )


def _stiffest(material: Material, body: Body) -> Material:
    """The material of the stiffest core, which limits the time step."""
    return material._replace(mu_core=material.mu_core * float(body.stiffness.max()))


def described(run: Run) -> list[str]:
    """The assumptions of a run, in sentences."""
    share = thickness_mm(run) / run.scale.length
    sentences = [
        f"the growing cortex is {thickness_mm(run):.2f} mm thick at the start: "
        f"{share:.3f} of the unit of length, {run.scale.length:.1f} mm"
    ]
    if run.wall is not None:
        sentences.append(
            f"medial wall: {run.wall.area_mm2:.0f} mm2, {run.wall.share:.1%} of the surface; {run.wall.found}"
        )
    course, stretch = run.growth.at(np.array([run.end]), 0.0), run.growth.frame(run.end)
    along, across, _ = (1 + course.growth[0, 0]).tolist()
    core = f"lengths of the core grow by {stretch:.2f}" if stretch != 1 else "the core does not grow"
    if run.growth.mapped:
        grown = run.growth.body(run.body, run.end)
        cortex = run.body.depth < run.body.thickness
        along = 1 + float(np.average(grown.amount[cortex], weights=run.body.mask[cortex] * run.body.volumes[cortex]))
    sentences.append(
        f"until {age_of(run.end):g} weeks {core}; beside it the cortex grows by {along:.2f} along the surface"
        f"{', on average, as it was measured,' if run.growth.mapped else ''} and by {across:.2f} across"
        + (f"; an envelope grows by {float(course.envelope[0]) * stretch:.2f}" if run.enveloped else "")
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
    x = (run.mesh.points - run.scale.origin) / run.scale.length
    plane = _REFERENCE_PLANE if run.reference else {}
    contact = contact_of(
        x,
        run.faces,
        bulk=run.material.bulk,
        side=run.side,
        planes=planes_of(ConvexHull(x)) if run.enveloped else None,
        **plane,
    )
    return Moment(0, run.start, Motion(x, np.zeros_like(x)), run.body, workspace(run.body), contact)


def advance_to(run: Run, moment: Moment, target: float) -> bool:
    """Step until the time `target`; True if the run ended before, at an inverted element.

    The time step is that for the present body (`time_step_of`), or a little less, so that all steps are equal.
    """
    begin = moment.time
    steps = max(int(np.ceil((target - begin) / time_step_of(run, moment) - 1e-9)), 1)
    dt = (target - begin) / steps
    length = _CHUNK if moment.step >= _EARLY_STEPS else _EARLY_CHUNK
    chunks = (np.arange(first, min(steps, first + length)).astype(float) for first in range(0, steps, length))
    energy = sum(_energies(run, moment, moment.state, begin, dt))
    inverted = False
    for chunk in chunks:
        inverted, energy = _advance_over(run, moment, begin + dt * chunk, dt, energy)
        if inverted:
            break
    if not inverted:
        moment.time = target
    return inverted


def time_step_of(run: Run, moment: Moment) -> float:
    """Time step for the present body: growth and folding flatten elements, and flat ones require small steps.

    A time step that the user has chosen holds until the limit of stability falls below it.
    """
    altitude = smallest_altitude(moment.state.x, run.mesh.cells)
    material = _stiffest(run.material, run.body)
    if run.time_step is not None:
        return min(run.time_step, largest_time_step(altitude, material))
    return stable_time_step(altitude, material)


def _advance_over(run: Run, moment: Moment, times: FloatArray, dt: float, energy: float) -> tuple[bool, float]:
    """Take one step at each of `times`; `energy` is the energy before them.

    Also adds up the energy that growth brings into the body. At a fixed shape, only growth changes the energy, from
    that with the earlier growth to that with the later one. The work of growth is the mean of this change over the
    shapes at both ends (trapezoidal rule).

    Returns
    -------
    whether the run ended at an inverted element; the energy after the steps
    """
    before = Motion(moment.state.x.copy(), moment.state.v.copy())
    course = run.growth.at(times, dt)
    alike = _ALIKE if run.growth.mapped else len(times)
    done, how = 0, LIST_OUTDATED
    while done < len(times) and how != INVERTED:
        first = done - done % alike
        _take(moment, run.growth.body(run.body, float(times[first]) + dt * alike / 2))
        part = course.part(done, first + alike)
        steps, how = advance(moment.body, run.material, moment.state, moment.work, moment.contact, part, dt)
        done += int(steps)
        if how == LIST_OUTDATED:
            moment.contact = listed_at(moment.contact, moment.state.x, float(course.envelope[done]))
    now = float(times[0]) + dt * done
    held = sum(_energies(run, moment, before, now, dt))
    moved = sum(_energies(run, moment, moment.state, moment.time, dt))
    after = sum(_energies(run, moment, moment.state, now, dt))
    moment.growth_work += (held - energy + after - moved) / 2
    moment.step, moment.time = moment.step + done, now
    return bool(how == INVERTED), after


def _take(moment: Moment, body: Body) -> None:
    """Continue with a body whose `amount`, `gradients` and `volumes` may have changed."""
    if body is not moment.body:
        renew(moment.work.patches, body)
        moment.body = body


def _energies(run: Run, moment: Moment, state: Motion, time: float, dt: float) -> tuple[float, float]:
    """Kinetic and elastic energy of a state with the growth at a time; J and growth there stay in `moment.work`."""
    course, work = run.growth.at(np.array([time]), dt), moment.work
    _take(moment, run.growth.body(run.body, time))
    elastic_forces(run.material, state.x, work, course.growth[0], float(course.thickening[0]))
    kinetic = kinetic_energy(run.material, state.v, work)
    return kinetic, elastic_energy(moment.body, run.material, state.x, work, course.growth[0])


def millimetres(run: Run, moment: Moment) -> FloatArray:
    """Positions of the nodes: (n, 3) mm."""
    return run.scale.origin + run.scale.length * run.growth.frame(moment.time) * moment.state.x


def measured(run: Run, moment: Moment) -> Measurements:
    """Measure the body in its present state; its J and growth are left in `moment.work`."""
    work = moment.work
    kinetic, elastic = _energies(run, moment, moment.state, moment.time, 0.0)
    dissipated, pushed = work.energy.tolist()
    missing = kinetic + elastic + dissipated - moment.growth_work - pushed
    flow = abs(moment.growth_work) + abs(pushed)
    inverted = int((~(work.current > 0)).sum())
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
        min_j=min(float((work.current / work.grown).min()), float(work.min_j[0])),
        inverted=inverted,
        degenerate=int(work.counts[0]),
        contacts=int(work.counts[1]),
        q_max=float(quality(moment.state.x, run.mesh.cells).max()),
        **shape(points, run.faces, run.body.held, cortex),
    )
