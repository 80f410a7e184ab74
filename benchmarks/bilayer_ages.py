"""From exact theory: at which age a flat cortex of the model `growing` folds, how wide, and where 12 mm can come from.

    python benchmarks/bilayer_ages.py [--rate 0.045] [--thickness 1.1] [--thickness-rate -0.02] [--stiffness 1 2 5 10]

The cortex grows along itself, and across itself, relative to a core that grows by s: that of `cortet.simulation`, but
s is the cube root of the volume alone, as if cortex took no part of it. `bilayer.py` has the onset for what the
cortex has grown across itself at an age; cortex folds at the age at which it has grown so much along itself. A fold is
carried along: what is n wide when it is born at an age is n s(later) / s(age) wide later. A wave that is first at a
later age is one that a cortex without folds would take then. Thicknesses are those that cortex without stress has at
the onset.
"""

from __future__ import annotations

import argparse
from functools import cache
from typing import NamedTuple

import numpy as np
from bilayer import Onset, onset
from scipy.optimize import brentq

from cortet.meshes import FloatArray
from cortet.simulation.body import Material
from cortet.simulation.growth import ORIGIN, VOLUME, ByAge, by_age, usual
from cortet.simulation.law import ACROSS, ALONG
from cortet.simulation.models import CONSTANTS, Growing

#: ages at which widths are printed, weeks
AGES = 28.0, 34.0, 38.0
#: width of the folds of a brain, mm, and the age at which they shall have it
WIDTH, WIDTH_AT = 12.0, 34.0
#: age up to which the law of the volume holds, weeks
LAST = 42.0
#: of the onset, weeks
_ERROR = 1e-3


class Grown(NamedTuple):
    """What has grown at an age, since 22 weeks."""

    #: of the cortex along and across itself, relative to the core
    along: float
    across: float
    #: stretch of the core
    stretch: float


class Born(NamedTuple):
    """When folds are born, and how wide."""

    #: weeks
    age: float
    grown: Grown
    #: in thicknesses at 22 weeks, both grown as the core
    wavelength: float


def laws(rate: ByAge, thickness_rate: ByAge) -> Growing:
    """The model `growing` of a flat cortex, from 22 weeks on; its envelope is out of reach."""
    thickness = by_age(thickness_rate)
    return Growing(
        along=[by_age(rate)],
        core=[np.zeros_like],
        thickness=lambda ages: 1 + thickness(ages),
        stretch=lambda ages: np.cbrt(usual(VOLUME, ages) / usual(VOLUME, np.array([ORIGIN]))),
        envelope=lambda ages: np.full_like(ages, np.inf),
    )


def grown_at(model: Growing, age: float) -> Grown:
    """What has grown at an age in weeks."""
    ages: FloatArray = np.array([age])
    stretch = model.stretch(ages)
    growth = model.grown(ages, stretch)[0, 0]
    return Grown(float(growth[ALONG]), float(growth[ACROSS]), float(stretch[0]))


def born(model: Growing, material: Material) -> Born | None:
    """The first folds; None where there are none until `LAST`, or none that the layer sets.

    The growth along that an onset takes hardly changes with that across, so one age parts those before from those
    after it where growth along rises with age.
    """

    @cache
    def first(age: float) -> Onset:
        return onset(material, across=grown_at(model, age).across)

    def excess(age: float) -> float:
        return grown_at(model, age).along - first(age).growth

    if excess(LAST) < 0:
        return None
    age = float(brentq(excess, ORIGIN, LAST, xtol=_ERROR))
    return Born(age, grown_at(model, age), first(age).wavelength) if first(age).set_by_layer else None


def width(wavelength: float, thickness: float, model: Growing, age: float) -> float:
    """Width in mm at an age of what is some thicknesses at 22 weeks wide, for that thickness in mm."""
    return wavelength * thickness * grown_at(model, age).stretch


def table_of_ages(model: Growing, thickness: float, stiffnesses: list[float]) -> dict[float, Born]:
    """Print the first table; those of the stiffnesses that fold."""
    ages = " ".join(f"{age:5g}" for age in AGES)
    print("           onset                  wavelength         born then, mm at    first at, mm")
    print(f"stiffness  week  growth  across  thicknesses    mm  {ages}   {ages}")
    folding = {}
    for stiffness in stiffnesses:
        material = Material(mu_cortex=1.0, mu_core=1 / stiffness)
        found = born(model, material)
        if found is None:
            print(f"{stiffness:9g}  does not fold until {LAST:g} weeks, or only creases")
            continue
        folding[stiffness] = found
        later = [width(found.wavelength, thickness, model, age) if age >= found.age else np.nan for age in AGES]
        firsts = [
            width(onset(material, across=grown_at(model, age).across).wavelength, thickness, model, age) for age in AGES
        ]
        print(
            f"{stiffness:9g} {found.age:5.1f} {found.grown.along:7.3f} {found.grown.across:7.3f}"
            f" {found.wavelength / (1 + found.grown.across):12.2f}"
            f" {width(found.wavelength, thickness, model, found.age):5.1f} "
            + "".join(f" {mm:5.1f}" if np.isfinite(mm) else "     -" for mm in later)
            + "  "
            + "".join(f" {mm:5.1f}" for mm in firsts),
            flush=True,
        )
    return folding


def main() -> None:
    """Print the tables."""
    usual_ones = CONSTANTS["growing"]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--rate", type=float, default=usual_ones.growth_rate, help="growth along per week since 22 weeks"
    )
    parser.add_argument("--thickness", type=float, default=usual_ones.thickness, help="at 22 weeks, mm")
    parser.add_argument(
        "--thickness-rate",
        type=float,
        default=usual_ones.thickness_rate,
        help="change of the thickness without stress, in that at 22 weeks, per week",
    )
    parser.add_argument("--stiffness", nargs="+", type=float, default=[1, 1.5, 2, 3, 4, 5, 7, 10])
    options = parser.parse_args()
    model = laws(options.rate, options.thickness_rate)
    if not grown_at(model, LAST).across > -1:
        parser.error(f"by --thickness-rate nothing is left at {LAST:g} weeks")
    folding = table_of_ages(model, options.thickness, options.stiffness)
    print(
        f"\nstiffness  thickness at {ORIGIN:g} weeks, mm, with which folds are {WIDTH:g} mm wide at {WIDTH_AT:g} weeks"
    )
    for stiffness, found in folding.items():
        if found.age <= WIDTH_AT:
            print(f"{stiffness:9g}  {WIDTH / width(found.wavelength, 1.0, model, WIDTH_AT):.2f}")


if __name__ == "__main__":
    main()
