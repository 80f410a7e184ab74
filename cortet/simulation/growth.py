"""How much the cortex has grown at which age."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.geometry.limits import FOLD_AGES

#: coefficients of GA^3, GA^2, GA and 1 in the time of the simulation (Wang et al. 2021): 0 at 22 weeks, 1 at 44
_TIME = (6.926e-5, -0.00665, 0.250, -3.0189)


#: gestational ages that a fold may begin and end at, weeks
AGES = FOLD_AGES

#: one time, or many at once
Times = TypeVar("Times", float, NDArray[np.float64])


def check_age(gestational_age: float) -> None:
    """Raise InputError for an age at which the model of growth means nothing, weeks."""
    youngest, oldest = AGES
    if not youngest <= gestational_age <= oldest:
        raise InputError(
            f"{gestational_age:g} is no gestational age to fold at: the model of growth holds from {youngest:g} to "
            f"{oldest:g} weeks",
            remedy="give the gestational age of the mesh in weeks",
        )


def time_of(gestational_age: float) -> float:
    """Time of the simulation at a gestational age in weeks."""
    return float(np.polyval(_TIME, gestational_age))


def age_of(time: float) -> float:
    """Gestational age in weeks at a time of the simulation; `time_of` rises everywhere, so there is exactly one."""
    roots = np.roots([*_TIME[:3], _TIME[3] - time])
    return float(roots[np.abs(roots.imag).argmin()].real)


@dataclass(frozen=True)
class Linear:
    """Tangential growth rate * t, the same rate at all times (Tallinen et al. 2016)."""

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


def growth_since(law: Law, start: float, time: Times) -> Times:
    """Growth from `start` to `time`, relative to the cortex as it was at `start`.

    The reference takes `law(time)`, as if every mesh were of t = 0.
    """
    return (1 + law(time)) / (1 + law(start)) - 1
