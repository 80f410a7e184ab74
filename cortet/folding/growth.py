"""Growth of a brain as a function of age."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.limits import FOLD_AGES
from cortet.meshes import FloatArray

#: coefficients of GA^3, GA^2, GA and 1 in the time of the simulation (Wang et al. 2021): 0 at 22 weeks, 1 at 44
_TIME = (6.926e-5, -0.00665, 0.250, -3.0189)


#: gestational age from which growth by age counts, weeks
ORIGIN = 22.0

#: one time, or many at once
Times = TypeVar("Times", float, NDArray[np.float64])


def check_age(gestational_age: float) -> None:
    """Raise InputError for an age, weeks, at which the growth model has no meaning."""
    youngest, oldest = FOLD_AGES
    if not youngest <= gestational_age <= oldest:
        raise InputError(
            f"cannot fold at {gestational_age:g} weeks: the growth model covers {youngest:g} to {oldest:g} weeks",
            remedy="give the gestational age of the mesh in weeks",
        )


def times_of(ages: FloatArray) -> FloatArray:
    """Time of the simulation at gestational ages in weeks (k,)."""
    return np.asarray(np.polyval(_TIME, ages))


def time_of(gestational_age: float) -> float:
    """Time of the simulation at a gestational age in weeks."""
    return float(np.polyval(_TIME, gestational_age))


def age_of(time: float) -> float:
    """Gestational age in weeks at a time of the simulation; exactly one, because `time_of` is strictly increasing."""
    roots = np.roots([*_TIME[:3], _TIME[3] - time])
    return float(roots[np.abs(roots.imag).argmin()].real)


def ages_of(times: FloatArray) -> FloatArray:
    """`age_of` of many times (k,) between those of `FOLD_AGES`, by Newton's method."""
    known = np.linspace(*FOLD_AGES, 200)
    ages: FloatArray = np.interp(times, times_of(known), known)
    for _ in range(3):
        ages = ages - (times_of(ages) - times) / np.polyval(np.polyder(_TIME), ages)
    return ages


@dataclass(frozen=True)
class Linear:
    """Tangential growth rate * t; the rate is the same at all times (Tallinen et al. 2016)."""

    rate: float = 1.829

    def __call__(self, time: Times) -> Times:
        """Relative tangential growth alpha since t = 0."""
        return self.rate * time


@dataclass(frozen=True)
class Gompertz:
    """Growth that begins slowly, is fastest at `latency` and ends at `amplitude` (Wang et al. 2021, per region)."""

    amplitude: float
    rate: float
    latency: float

    def __call__(self, time: Times) -> Times:
        """Relative tangential growth alpha."""
        return self.amplitude * np.exp(-np.exp(-self.rate * (time - self.latency)))


Law = Linear | Gompertz

#: a number as a function of gestational age: change per week from 22 weeks on, or values at ages
ByAge = float | Mapping[float, float]


def growth_since(law: Law, start: float, time: Times) -> Times:
    """Growth from `start` to `time`, relative to the cortex as it was at `start`."""
    return (1 + law(time)) / (1 + law(start)) - 1


def by_age(values: ByAge) -> Callable[[FloatArray], FloatArray]:
    """Relative change since 22 weeks at ages (k,): linear, or monotone cubics through values (Fritsch and Carlson).

    Before the first age and after the last, a table is constant.
    """
    if not isinstance(values, Mapping):
        return lambda ages: values * (ages - ORIGIN)
    from scipy.interpolate import PchipInterpolator  # imported here, because the configuration imports this module

    table = {float(age): value for age, value in values.items()}  # a workflow rule passes ages as text, in JSON
    known = sorted(table)
    if len(known) == 1:
        return lambda ages: np.full_like(ages, table[known[0]])
    curve = PchipInterpolator(known, [table[age] for age in known])
    return lambda ages: curve(np.clip(ages, known[0], known[-1]))


class Course(NamedTuple):
    """Growth at each of k steps."""

    #: (k, labels, 3), growth of each label: `law.ALONG`, `law.ACROSS` and `law.CORE`
    growth: FloatArray
    #: (k,), gain of the cortex in thickness
    thickening: FloatArray
    #: (k,), size of the envelope over that at the start
    envelope: FloatArray

    def part(self, first: int, last: int) -> Course:
        """The course of the steps from `first` to before `last`."""
        steps = slice(first, last)
        return Course(self.growth[steps], self.thickening[steps], self.envelope[steps])
