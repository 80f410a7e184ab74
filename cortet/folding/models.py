"""The two models of growth, and which of them applies to a mesh.

In `Growing`, the whole brain grows. Its lengths are relative to a frame that grows with the core, by s(t). In this
frame the core does not grow, and the cortex grows by 1 + alpha along the surface and by 1 + beta = g_r / s across it.
In `BrainGrowth`, the model of the solver of that name, only the cortex grows, and the frame stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from cortet.config.fold import Settings, Time
from cortet.errors import InputError
from cortet.folding.body import THICKENING, THICKNESS, Body, Material, Scale
from cortet.folding.fields import LABEL_FIELD, MASK_FIELD, node_field
from cortet.folding.growth import (
    ByAge,
    Course,
    Gompertz,
    Law,
    Linear,
    age_of,
    ages_of,
    by_age,
    growth_since,
    time_of,
    times_of,
)
from cortet.folding.growth_map import GrowthMap, ages_of_maps, grown_body, map_of
from cortet.folding.kernels import grown_volume_of
from cortet.folding.law import ACROSS, ALONG, CORE
from cortet.folding.relaxation import Relaxation
from cortet.measure.usual_size import HULL, VOLUME, usual
from cortet.meshes import REGION, FloatArray, IntArray, TetMesh

#: weeks between the ages at which the stretch of the core is solved for, most rounds, and largest change in the last
_KNOTS, _ROUNDS, _SETTLED = 0.5, 50, 1e-12
#: weeks within which the hidden growth of a mesh of later than 22 weeks comes
_RELAXATION = 1.0
#: growth that the shape of a hemisphere shows, by age: its area^(1/2) / volume^(1/3) over that at 22 weeks, less 1.
#: Means of fetuses and, at 40 weeks, of newborns of 38 to 42 (`data/real_brains.tsv`). Newborns of earlier weeks show
#: more than fetuses
SHOWN = {22: 0.0, 25: 0.005, 28: 0.056, 30: 0.082, 33.5: 0.213, 40: 0.308}
#: number of ages at which laws of growth are checked
_CHECKED = 101
#: labels that a message lists
_MOST_LABELS = 10

#: values at ages, weeks (k,), or at times of the simulation
Curve = Callable[[FloatArray], FloatArray]


class Constants(NamedTuple):
    """The constants of a model where the settings leave them out."""

    growth_rate: ByAge
    core_stiffness: float
    thickness_rate: ByAge = 0.0
    #: mm
    thickness: float | None = None
    envelope: bool = False
    core_relaxation: Time = "elastic"
    #: mm
    smoothing: float = 0.0
    #: see `Material`; no settings
    damping: float = Material().damping
    own: float = Material().own


#: `growing`: calibrated on fetuses of 22 to 34 weeks (docs/notes/folding.md); BrainGrowth: Wang et al. 2021
CONSTANTS = {
    "growing": Constants(
        growth_rate={22: 0.0, 28: 0.108, 30: 0.154, 32: 0.254, 34: 0.325, 38: 0.378, 42: 0.402},
        core_stiffness=1.0,
        thickness_rate=-0.02,
        thickness=1.25,
        envelope=True,
        core_relaxation=0.1,
        smoothing=1.0,
    ),
    "braingrowth": Constants(growth_rate=1.829, core_stiffness=1.167, damping=0.5, own=1.0),
}


def tangential(alphas: ArrayLike) -> FloatArray:
    """Growth of each label (..., labels, 3), only along the surface, from alphas (..., labels)."""
    growth = np.zeros((*np.shape(alphas), 3))
    growth[..., ALONG] = alphas
    return growth


def course(alphas: ArrayLike) -> Course:
    """A course of growth along the surface alone, from alphas (k, labels)."""
    growth = tangential(alphas)
    return Course(growth, np.zeros(len(growth)), np.ones(len(growth)))


class BrainGrowth(NamedTuple):
    """The cortex grows, and the core does not (Tallinen et al. 2016, Wang et al. 2021)."""

    #: one for each label
    laws: Sequence[Law]
    #: time of the simulation at the start
    start: float
    #: as the reference: growth counts from t = 0 on, and forces are computed from that of the step before
    reference: bool = False

    def at(self, times: FloatArray, dt: float) -> Course:
        """The course of growth at times (k,), for steps of `dt`."""
        if self.reference:
            times = np.maximum(times - dt, self.start)
        alphas = [law(times) if self.reference else growth_since(law, self.start, times) for law in self.laws]
        return course(np.stack(alphas, axis=1))._replace(thickening=THICKENING * (times - self.start))

    def frame(self, time: float) -> float:  # noqa: ARG002
        """1: the core does not grow."""
        return 1.0

    @property
    def mapped(self) -> bool:
        """False: no element has a growth of its own."""
        return False

    def body(self, body: Body, time: float) -> Body:  # noqa: ARG002
        """The same body."""
        return body


class Growing(NamedTuple):
    """The whole brain grows: the core by s(t) in all directions, and the cortex more along the surface."""

    #: for each label, growth of the cortex relative to the core since the start, at ages
    along: Sequence[Curve]
    #: for each label, growth of its part of the core relative to the frame since the start, at ages
    core: Sequence[Curve]
    #: thickness of cortex without stress, and s, each over its value at the start, at ages
    thickness: Curve
    stretch: Curve
    #: size of the envelope over that at the start, at ages
    envelope: Curve
    #: measured growth of the cortex along the surface, which replaces `along`
    map: GrowthMap | None = None

    def at(self, times: FloatArray, dt: float) -> Course:  # noqa: ARG002
        """The course of growth at times (k,)."""
        ages = ages_of(times)
        stretch = self.stretch(ages)
        return Course(self.grown(ages, stretch), np.zeros(len(times)), self.envelope(ages) / stretch)

    def frame(self, time: float) -> float:
        """The unit of length at a time, over that at the start: s(t)."""
        return float(self.stretch(ages_of(np.array([time])))[0])

    @property
    def mapped(self) -> bool:
        """Whether there is a map, so that the body changes as it grows."""
        return self.map is not None

    def body(self, body: Body, time: float) -> Body:
        """The body with the own growth of its elements at a time; the same body if they have none."""
        return self.body_at(body, age_of(time), self.frame(time)) if self.mapped else body

    def body_at(self, body: Body, age: float, stretch: float) -> Body:
        """The body at an age, for a `stretch` of the core then."""
        return body if self.map is None else grown_body(body, self.map, age, stretch)

    def grown(self, ages: FloatArray, stretch: FloatArray) -> FloatArray:
        """Growth of each label at ages (k,), for a `stretch` of the core at each: (k, labels, 3)."""
        growth = np.empty((len(ages), len(self.along), 3))
        growth[:, :, ACROSS] = (self.thickness(ages) / stretch - 1)[:, None]
        for label, (along, core) in enumerate(zip(self.along, self.core, strict=True)):
            growth[:, label, ALONG], growth[:, label, CORE] = along(ages), core(ages)
        return growth


Growth = BrainGrowth | Growing


def constants(settings: Settings) -> Constants:
    """The constants of the model; those in the settings replace its own."""
    usual = CONSTANTS[settings.model]
    given = {name: value for name in usual._fields if (value := getattr(settings, name, None)) is not None}
    return usual._replace(**given)


def check_model(settings: Settings) -> None:
    """Raise InputError for a law of growth that leaves nothing of the body."""
    if settings.model != "growing":
        return
    chosen = constants(settings)
    ages = np.linspace(settings.gestational_age, settings.end, _CHECKED)
    laws: dict[str, ByAge] = {"growth_rate": chosen.growth_rate, "thickness_rate": chosen.thickness_rate}
    laws |= {f"core_regions[{region}]": law for region, law in settings.core_regions.items()}
    for name in ("volume", "hull"):
        _check_course(f"fold.{name}", getattr(settings, name) or {})
    for name, law in laws.items():
        left = 1 + by_age(law)(ages)
        if not left.min() > 0:
            raise InputError(
                f"{name} shrinks tissue to nothing at {ages[left.argmin()]:g} weeks",
                remedy=f"correct fold.{name}: growth since 22 weeks must stay above -1",
            )


def _check_course(setting: str, table: Mapping[float, float]) -> None:
    """Raise InputError for volumes at ages that change as no brain does."""
    course = sorted((float(age), value) for age, value in table.items())  # a workflow rule passes ages as text
    for (age, value), (later, after) in pairwise(course):
        if abs(np.log2(after / value)) > max(later - age, 1):
            raise InputError(
                f"{setting} goes from {value:g} at {age:g} weeks to {after:g} at {later:g}: more than a factor of two "
                "per week",
                remedy="give volumes of one unit at gestational ages in weeks",
            )


def thickness_at_start(settings: Settings, scale: Scale) -> float:
    """Thickness of the cortex at the start, dimensionless."""
    thickness = constants(settings).thickness
    if thickness is None:
        return THICKNESS + THICKENING * time_of(settings.gestational_age)
    return thickness / scale.length


def labels_of(mesh: TetMesh, settings: Settings) -> tuple[IntArray | None, IntArray | None]:
    """The growth law of each node, and the number of the core law of each tetrahedron; None: all the first."""
    laws = regions = None
    if settings.regions:
        values = _named(node_field(mesh, LABEL_FIELD), settings.regions, f"field {LABEL_FIELD}", "fold.regions")
        laws = _numbered(values, settings.regions)
    if settings.core_regions:
        regions = _places(mesh, list(settings.core_regions), "fold.core_regions")
    return laws, regions


def stiffness_of(mesh: TetMesh, settings: Settings) -> FloatArray:
    """Shear modulus of the core of each tetrahedron over the usual one: (m,)."""
    usual, chosen = constants(settings).core_stiffness, settings.region_stiffness
    moduli = np.array([usual, *chosen.values()])
    return moduli[_places(mesh, list(chosen), "fold.region_stiffness")] / usual


def relaxation_of(mesh: TetMesh, settings: Settings) -> Relaxation | None:
    """How fast the core of each tetrahedron yields; None: all of it is elastic."""
    chosen = settings.region_relaxation
    law = _places(mesh, list(chosen), "fold.region_relaxation")
    times = [constants(settings).core_relaxation, *chosen.values()]
    return Relaxation(law, times) if any(time != "elastic" for time in times) else None


def _places(mesh: TetMesh, keys: Sequence[int | str], setting: str) -> IntArray:
    """Which of the regions `keys` (numbers, or names of sets) each tetrahedron is in, from 1 on; else 0."""
    places = np.zeros(len(mesh.cells), np.int32)
    numbers = [key for key in keys if str(key).lstrip("-").isdecimal()]
    if numbers:
        of_cell = mesh.cell_data.get(REGION)
        _named(of_cell, dict.fromkeys(map(int, numbers)), f"cell data {REGION}", setting)
    for place, key in enumerate(keys, start=1):
        if key in numbers:
            places[mesh.cell_data[REGION] == int(key)] = place
        elif key in mesh.sets.cells:
            places[mesh.sets.cells[str(key)]] = place
        else:
            sets = ", ".join(mesh.sets.cells)
            raise InputError(
                f"{setting} names {key}, but the mesh has no such set of tetrahedra",
                remedy=(f"name one of {sets}" if sets else "use an exported mesh, which has sets")
                + ", or name a region by its number",
            )
    for place, key in enumerate(keys, start=1):
        if not (places == place).any():
            mine = mesh.cell_data[REGION] == int(key) if key in numbers else mesh.sets.cells[str(key)]
            others = ", ".join(str(keys[one - 1]) for one in np.unique(places[mine]))
            what = f"{setting} names {key}, but all its tetrahedra belong to {others}"
            raise InputError(
                what,
                remedy="name each region once, and name a part of a region after that region, because later entries "
                "take precedence",
            )
    return places


def _named(values: FloatArray | None, labels: Mapping[int, object], what: str, key: str) -> FloatArray:
    """The values, if they contain all `labels`; InputError if there are no values, or a label is missing."""
    if values is None:
        raise InputError(
            f"{key} names regions, but the mesh has no {what}",
            remedy=f"use a mesh with this {what}, or leave out {key}",
        )
    there = np.unique(values)
    if missing := [str(label) for label in labels if int(label) not in there]:
        shown = ", ".join(f"{label:g}" for label in there[:_MOST_LABELS])
        shown += ", ..." if len(there) > _MOST_LABELS else ""
        raise InputError(
            f"{key} names {', '.join(missing)}, but the {what} of the mesh has only {shown}",
            remedy=f"name labels that the mesh has in {key}",
        )
    return values


def _numbered(values: FloatArray, labels: Mapping[int, object]) -> IntArray:
    """The index of each value among `labels`, from 1 on; 0 if it is none of them."""
    number = np.zeros(len(values), np.int32)
    for place, label in enumerate(labels, start=1):
        number[values == int(label)] = place
    return number


def model_of(body: Body, mesh: TetMesh, settings: Settings) -> Growth:
    """The growth of the body of a mesh; its labels are the product of those of the laws and those of the core."""
    start, chosen = time_of(settings.gestational_age), constants(settings)
    _check_one_law(mesh, settings)
    of_regions = [Gompertz(*values) for values in settings.regions.values()]
    if settings.model == "braingrowth":
        assert isinstance(chosen.growth_rate, int | float)
        return BrainGrowth([Linear(chosen.growth_rate), *of_regions], start, settings.reference)
    first = settings.gestational_age
    measured = map_of(mesh, body, first)
    along = _since(chosen.growth_rate, first)
    if measured is not None:  # the map is imposed, and nothing else
        along = np.ones_like  # the amount of an element is its growth
    elif settings.start == "stressed":
        along = _stressed(along, hidden_growth(chosen.growth_rate, first), first)
    laws = [along, *(_as_ages_say(law, start) for law in of_regions)]
    cores = [_since(0.0, first), *(_since(rate, first) for rate in settings.core_regions.values())]
    thickness = _since(chosen.thickness_rate, first)
    volume, hull = _relative(settings.volume, VOLUME, first), _relative(settings.hull, HULL, first)
    model = Growing(
        along=[law for law in laws for _ in cores],
        core=cores * len(laws),
        thickness=lambda ages: 1 + thickness(ages),
        stretch=lambda ages: np.cbrt(volume(ages)),
        envelope=lambda ages: np.cbrt(hull(ages)),
        map=measured,
    )
    return with_volume(model, body, volume, first, settings.end)


def _check_one_law(mesh: TetMesh, settings: Settings) -> None:
    """Raise InputError if a mesh with maps of growth has another law, too."""
    maps = list(ages_of_maps(mesh).values())
    others = {
        "fold.model braingrowth": settings.model == "braingrowth",
        "fold.regions": bool(settings.regions),
        f"the field {MASK_FIELD}": MASK_FIELD in mesh.point_data,
    }
    if maps and (other := next((name for name, there in others.items() if there), None)):
        raise InputError(
            f"the mesh has measured growth, {maps[0]}, which contradicts {other}",
            remedy="remove one of the two",
        )


def _since(values: ByAge, start: float) -> Curve:
    """Relative change since the age `start`, weeks, from the change since 22 weeks."""
    change = by_age(values)
    at_start = float(change(np.array([start]))[0])
    return lambda ages: (1 + change(ages)) / (1 + at_start) - 1


def hidden_growth(growth_rate: ByAge, age: float) -> float:
    """Compression of the cortex at an age: growth since 22 weeks over the growth that the shape shows, less 1.

    Growth is relative to a core that grows as the volume does.
    """
    grown, shown = (1 + float(by_age(law)(np.array([age]))[0]) for law in (growth_rate, SHOWN))
    return max(grown / shown - 1, 0.0)


def _stressed(along: Curve, hidden: float, start: float) -> Curve:
    """Growth with the hidden growth at the start added; it comes evenly within `_RELAXATION`."""
    return lambda ages: (1 + along(ages)) * (1 + hidden) ** np.clip((ages - start) / _RELAXATION, 0, 1) - 1


def _as_ages_say(law: Law, start: float) -> Curve:
    """A law of the time of the simulation, as a function of age."""
    return lambda ages: growth_since(law, start, times_of(ages))


def _relative(volumes: Mapping[float, float] | None, law: tuple[float, float, float], start: float) -> Curve:
    """Volumes at ages, over that at the start; None: those of a law."""
    curve = partial(usual, law) if volumes is None else by_age(volumes)
    at_start = curve(np.array([start]))
    return lambda ages: curve(ages) / at_start


def with_volume(model: Growing, body: Body, volume: Curve, start: float, end: float) -> Growing:
    """The model with the stretch of the core that gives the whole, free of stress, its wanted volume.

    Parameters
    ----------
    volume : of the whole at ages (k,), over that at the start
    start, end : ages, weeks
    """
    ages = np.linspace(start, end, max(int(np.ceil((end - start) / _KNOTS)), 1) + 1)
    wanted = volume(ages)
    stretch = np.cbrt(wanted)
    for _ in range(_ROUNDS):  # s^3 total(s) = wanted: a contraction, as the cortex is a small part of the whole
        total = [
            grown_volume_of(model.body_at(body, age, s), growth)
            for age, s, growth in zip(ages, stretch, model.grown(ages, stretch), strict=True)
        ]
        before, stretch = stretch, np.cbrt(wanted * body.volumes.sum() / total)
        if np.abs(stretch - before).max() < _SETTLED:
            break
    return model._replace(stretch=PchipInterpolator(ages, stretch))
