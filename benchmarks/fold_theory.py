"""At which growth does a flat cortex fold, how wide, and at which age, by exact theory?

    python benchmarks/fold_theory.py [--stiffness 0.5 1 2 5 10 20] [--across -0.3] [--sharp]
    python benchmarks/fold_theory.py yielding [--stiffness 1 2 5] [--time 4 2 1 0.5 0.25] [--rate 0.039] [--across -0.2]
    python benchmarks/fold_theory.py ages [--rate 0.045] [--thickness 1.1] [--thickness-rate -0.02] [--stiffness 1 2 5]

A half-space whose uppermost part grows tangentially and is held at its sides stays flat until the second variation of
its energy vanishes for some wave, sin kx along the surface. The variation is assembled here over the depth (quadratic
elements; the wave is exact along x) for the neo-Hookean energy, the profile of growth and the stiffness of
`cortet.folding`, and the growth at which it stops being positive is bisected for each wave number. No assumption
is made on the ratio of the moduli, as Allen's formula makes for stiff films. Methods: Biot, Mechanics of Incremental
Deformations, 1965; growing bilayers: arXiv:2312.10162.

The layer may have grown across itself, too, or have shrunk: Fg = diag(1 + alpha, 1 + alpha, 1 + beta). As F = Fe Fg,
a displacement gradient H is H_ij / Fg_jj of elastic deformation, and an initial volume holds the energy of (1 +
alpha)^2 (1 + beta) grown ones. The base does not grow: where it does, as in the model `growing`, lengths are those of
a frame that grows with it. Thicknesses are those before growth.

`yielding` lets the base relax as a Maxwell body (`fold.core_relaxation`). A layer that grows at some rate then has no
critical growth: every wave grows once it is under pressure, faster the more the base yields. A wave is a displacement
of the first moment. Printed is the wave that is the first to be `AMPLIFIED` times as high, and the growth at which it
is. With a time of inf, the base is elastic. The layer is sharp, as only the base may yield.

`ages` takes the cortex of the model `growing`: the cortex grows along itself, and across itself, relative to a core
that grows by s: that of `cortet.folding`, but s is the cube root of the volume alone, as if cortex took no part of
it. The onset is that above for what the cortex has grown across itself at an age; cortex folds at the age at which it
has grown so much along itself. A fold is carried along: what is n wide when it is born at an age is n s(later) /
s(age) wide later. A wave that is first at a later age is one that a cortex without folds would take then. Thicknesses
are those that cortex without stress has at the onset.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from _frame import command
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.optimize import brentq, minimize_scalar

from cortet.folding.body import Material
from cortet.folding.growth import ORIGIN, VOLUME, ByAge, by_age, usual
from cortet.folding.law import ACROSS, ALONG, growth_share
from cortet.folding.models import CONSTANTS, Growing
from cortet.meshes import FloatArray

#: growth beyond which a layer is called stable; Biot's half-space folds at 0.5
LARGEST_GROWTH = 2.0
#: wavelengths that are searched, in thicknesses; below the smallest there is none that the layer sets
WAVELENGTHS = 0.3, 100.0
#: depth of the base, in wavelengths
_DEPTH = 2.0
_TRIED = 30
#: Gauss points of an element of [-1, 1], and their weights
_GAUSS = np.polynomial.legendre.leggauss(3)

#: growth along per week of the model `growing`, until 34 weeks
RATE = float(by_age(CONSTANTS["growing"].growth_rate)(np.array([34.0]))[0]) / (34 - ORIGIN)

#: share of the full growth (k,) at depths (k,) in thicknesses
Profile = Callable[[FloatArray], FloatArray]


class Onset(NamedTuple):
    """The first wave that a growing layer takes."""

    #: growth along the layer at which it does
    growth: float
    #: in thicknesses before growth
    wavelength: float
    #: whether shorter waves need more growth: if not, the surface creases before the layer folds
    set_by_layer: bool


def smooth_profile(depth: FloatArray) -> FloatArray:
    """Share of the growth at a depth in thicknesses, as the simulation has it."""
    return np.asarray(np.vectorize(growth_share)(depth, 1.0, 1.0))


def sharp_profile(depth: FloatArray) -> FloatArray:
    """All of the growth down to one thickness, none below."""
    return (depth < 1).astype(float)


def normal_stretch(mu: FloatArray, bulk: float, tangential: FloatArray) -> FloatArray:
    """Stretch (k,) across a layer that is free above, for its shear modulus and elastic stretch along both sides."""
    low, high = np.full_like(tangential, 0.1), np.full_like(tangential, 20.0)
    for _ in range(60):
        middle = np.sqrt(low * high)
        j, trace = tangential**2 * middle, 2 * tangential**2 + middle**2
        stress = mu * j ** (-2 / 3) * (middle - trace / 3 / middle) + bulk * (j - 1) * j / middle
        low, high = np.where(stress < 0, middle, low), np.where(stress < 0, high, middle)
    return np.sqrt(low * high)


def moduli(mu: FloatArray, bulk: float, along: FloatArray, across: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Second derivatives of the energy per initial volume by the displacement gradients of a plane wave.

    Returns
    -------
    by (u_x,x; u_z,z), and by (u_x,z; u_z,x): (k, 2, 2) each, for shear modulus and growth along and across (k,)
    """
    tangential = 1 / (1 + along)
    normal = normal_stretch(mu, bulk, tangential)
    j, trace = tangential**2 * normal, 2 * tangential**2 + normal**2
    shear, stretch = mu * j ** (-2 / 3), np.stack([tangential, normal], axis=1)
    each, other = stretch[:, :, None], stretch[:, None, :]
    same, product = np.eye(2), each * other
    volumetric = (bulk * (2 * j - 1) * j)[:, None, None] / product - same * (bulk * (j - 1) * j)[
        :, None, None
    ] / product
    ratios = -2 / 3 * (each / other + other / each) + (2 / 9 * trace)[:, None, None] / product
    direct = shear[:, None, None] * (same + ratios + same * (trace / 3)[:, None, None] / product) + volumetric
    crossed = (shear * trace / 3 - bulk * (j - 1) * j) / (tangential * normal)
    rotated = np.stack([np.stack([shear, crossed], axis=1), np.stack([crossed, shear], axis=1)], axis=1)
    # growth comes between displacement and elastic deformation, and the energy is that of the grown volume: the root of
    # (1 + along)^2 (1 + across) over 1 + along for a gradient along x, over 1 + across for one along z
    weights = np.stack([np.sqrt(1 + across), (1 + along) / np.sqrt(1 + across)], axis=1)
    direct = direct * weights[:, :, None] * weights[:, None, :]
    weights = weights[:, ::-1]
    return direct, rotated * weights[:, :, None] * weights[:, None, :]


def levels(thickness: float, wave_number: float) -> FloatArray:
    """Depths (k,) of the element borders, fine where the wave and the profile of growth change fast."""
    depths, bottom = [0.0], max(_DEPTH * 2 * np.pi / wave_number, 3 * thickness)
    while depths[-1] < bottom:
        inside = thickness / 15 if depths[-1] < 2 * thickness else np.inf
        depths.append(depths[-1] + min(inside, 0.2 / wave_number + 0.1 * depths[-1]))
    return np.array(depths)


def is_stable(
    growth: float, wave_number: float, thickness: float, material: Material, profile: Profile, across: float = 0.0
) -> bool:
    """Whether a flat layer that has grown so far along and across resists a wave; lengths are those of the thickness.

    Growth across is more than -1.
    """
    return _is_positive(stiffness_of(growth, wave_number, thickness, material, profile, across))


def stiffness_of(
    growth: float, wave_number: float, thickness: float, material: Material, profile: Profile, across: float = 0.0
) -> FloatArray:
    """Second variation of the energy by a wave, of each element of the depth: (m, 6, 6); see `is_stable`."""
    borders = levels(thickness, wave_number)
    length = np.diff(borders)
    at, weights = _GAUSS
    depth = borders[:-1, None] + length[:, None] * (1 + at) / 2
    share = profile(depth.ravel() / thickness)
    mu = material.mu_core * (1 - share) + material.mu_cortex * share
    direct, rotated = moduli(mu, material.bulk, growth * share, across * share)
    # displacement (U sin kx, W cos kx), U and W quadratic in each element: unknowns U0 W0 U1 W1 U2 W2 of its nodes
    shape = np.stack([at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2], axis=1)
    slope = np.stack([at - 0.5, -2 * at, at + 0.5], axis=1)[None] * (2 / length)[:, None, None]
    shape = np.broadcast_to(shape, slope.shape)
    none = np.zeros_like(slope)
    of_u, of_w = np.eye(2)

    def rows(u: FloatArray, w: FloatArray) -> FloatArray:
        """Interleave what belongs to U and to W: (elements, points, 6)."""
        return (u[..., None] * of_u + w[..., None] * of_w).reshape(*u.shape[:2], 6)

    first = np.stack([rows(wave_number * shape, none), rows(none, slope)], axis=2)
    second = np.stack([rows(slope, none), rows(none, -wave_number * shape)], axis=2)
    measure = weights * length[:, None] / 2
    local = np.zeros((len(length), 6, 6))
    for moduli_at, gradients in ((direct, first), (rotated, second)):
        by_point = moduli_at.reshape(*depth.shape, 2, 2)
        local += np.einsum("eq,eqai,eqab,eqbj->eij", measure, gradients, by_point, gradients)
    return local


def _is_positive(local: FloatArray) -> bool:
    """Whether a chain of elements (m, 6, 6), each with two unknowns more than its last shares, held at its end, is."""
    try:
        cholesky_banded(_banded(local), lower=True)
    except LinAlgError:
        return False
    return True


def _banded(local: FloatArray) -> FloatArray:
    """The matrix of a chain of elements in lower banded form; the last node does not move."""
    size = 4 * len(local) + 2
    banded = np.zeros((6, size))
    for i in range(6):
        for j in range(i + 1):  # lower form: row i - j, column j
            np.add.at(banded[i - j], 4 * np.arange(len(local)) + j, local[:, i, j])
    return banded[:, : size - 2]


def critical_growth(
    wave_number: float, thickness: float, material: Material, profile: Profile, across: float = 0.0
) -> float:
    """Least growth along at which a wave appears, for some growth across; `LARGEST_GROWTH` if none does."""
    low, high = 0.0, LARGEST_GROWTH
    for _ in range(20):
        middle = (low + high) / 2
        stable = is_stable(middle, wave_number, thickness, material, profile, across)
        low, high = (middle, high) if stable else (low, middle)
    return high


def onset(material: Material, profile: Profile = smooth_profile, across: float = 0.0) -> Onset:
    """The first wave of a layer that was 1 thick before it grew across by so much, on a deep base."""

    def at(logarithm: float) -> float:
        return critical_growth(2 * np.pi / np.exp(logarithm), 1.0, material, profile, across)

    tried = np.linspace(*np.log(WAVELENGTHS), _TRIED)
    growths = np.array([at(one) for one in tried])
    lowest = int(growths.argmin())
    if lowest == 0:
        return Onset(growths[0], WAVELENGTHS[0], set_by_layer=False)
    best = minimize_scalar(at, bounds=(tried[lowest - 1], tried[min(lowest + 1, _TRIED - 1)]), method="bounded")
    return Onset(float(best.fun), float(np.exp(best.x)), set_by_layer=True)


def bilayer(
    *,
    stiffness: Sequence[float] = (0.5, 0.857, 1, 1.5, 2, 5, 10, 20),
    across: float = 0.0,
    sharp: bool = False,
) -> None:
    """The first wave for each stiffness.

    across : growth across the layer, the same at each onset
    sharp : all growth above one thickness, none below
    """
    profile = sharp_profile if sharp else smooth_profile
    print("stiffness  growth  wavelength  set by the layer")
    for ratio in stiffness:
        first = onset(Material(mu_cortex=1.0, mu_core=1 / ratio), profile, across)
        print(f"{ratio:9g} {first.growth:7.4f} {first.wavelength:11.3f}  {first.set_by_layer}", flush=True)


# --- on a base that yields -------------------------------------------------------------------------------------------

#: a wave counts as a fold from this height on, over that at the start
AMPLIFIED = float(np.exp(3))
#: steps of growth, and least steps of a relaxation time; growth until which waves are followed
_STEPS, _PER_TIME, _FOLLOWED = 400, 10, 1.0
#: waves that are tried, in thicknesses
_WAVES = np.geomspace(2.0, 30.0, 25)


def heights(wave_number: float, material: Material, yielding: float, across: float = 0.0) -> tuple[FloatArray, ...]:
    """Growth along a layer 1 thick, and the height of a wave over that at the start: (k,) each, until it has no limit.

    The base is pulled towards the shape to which it has relaxed. All else is elastic. Growth across is in proportion to
    that along.

    Parameters
    ----------
    yielding : growth along in the time in which the base relaxes; inf: it is elastic
    """
    step = min(_FOLLOWED / _STEPS, yielding / _PER_TIME)
    part = -np.expm1(-step / yielding)

    def at(growth: float, of: Material) -> FloatArray:
        return stiffness_of(growth, wave_number, 1.0, of, sharp_profile, across * growth)

    borders = levels(1.0, wave_number)
    in_base = (borders[:-1] > 1 - 1e-9)[:, None, None]
    all_of_it, volume = at(0.0, material), at(0.0, material._replace(mu_cortex=0.0, mu_core=0.0))
    yields = np.where(in_base, all_of_it - volume, 0.0)  # in shape, and not in volume
    depth = np.sort(np.concatenate([borders, (borders[:-1] + borders[1:]) / 2]))[:-1]
    start = np.zeros(2 * len(depth))
    start[1::2] = np.exp(-wave_number * depth)
    relaxed, last, kept, found = start, start, _forces(all_of_it - yields, start), []
    growths = np.arange(0, _FOLLOWED, step)
    for growth in growths:
        try:
            factor = cholesky_banded(_banded(at(growth, material)), lower=True)
        except LinAlgError:
            break
        wave = cho_solve_banded((factor, True), kept + _forces(yields, relaxed))
        found.append(wave[1])
        relaxed = relaxed + part * ((3 * wave - last) / 2 - relaxed)  # towards the wave in the middle of the next step
        last = wave
        if wave[1] > AMPLIFIED * start[1]:
            break
    return growths[: len(found)], np.array(found) / start[1]


def _forces(local: FloatArray, displacement: FloatArray) -> FloatArray:
    """Those of a chain of elements (m, 6, 6) for a displacement of all nodes but the last."""
    unknowns = 4 * np.arange(len(local))[:, None] + np.arange(6)
    whole, forces = np.zeros((2, 4 * len(local) + 2))
    whole[:-2] = displacement
    np.add.at(forces, unknowns, np.einsum("eij,ej->ei", local, whole[unknowns]))
    return forces[:-2]


def first_wave(material: Material, yielding: float, across: float = 0.0) -> tuple[float, float]:
    """Growth along at which the first wave is `AMPLIFIED` times as high, and its length in thicknesses; NaN: none."""
    reached = np.full(len(_WAVES), np.nan)
    for i, wave in enumerate(_WAVES):
        growths, height = heights(2 * np.pi / wave, material, yielding, across)
        if height[-1] > AMPLIFIED:
            reached[i] = np.interp(np.log(AMPLIFIED), np.log(height), growths)
        elif growths[-1] < _FOLLOWED * (1 - 1.5 / _STEPS):  # it has no limit
            reached[i] = growths[-1]
    if np.isnan(reached).all():
        return np.nan, np.nan
    first = int(np.nanargmin(reached))
    if not 0 < first < len(_WAVES) - 1 or np.isnan(reached[first - 1 : first + 2]).any():
        return float(reached[first]), float(_WAVES[first])
    a, b, c = np.polyfit(np.log(_WAVES[first - 1 : first + 2]), reached[first - 1 : first + 2], 2)
    return (float(c - b**2 / (4 * a)), float(np.exp(-b / (2 * a)))) if a > 0 else (reached[first], _WAVES[first])


def yielding(
    *,
    stiffness: Sequence[float] = (1.0, 2.0, 6.67),
    time: Sequence[float] = (np.inf, 4.0, 2.0, 1.0, 0.5, 0.25),
    rate: float = RATE,
    across: float = 0.0,
) -> None:
    """The first wave for each stiffness and relaxation time of the base.

    time : in which the base relaxes, weeks
    rate : growth along per week
    across : growth across over growth along
    """
    print("stiffness  time, weeks  growth  weeks  wavelength")
    for ratio, weeks in product(stiffness, time):
        growth, wave = first_wave(Material(mu_cortex=1.0, mu_core=1 / ratio), rate * weeks, across)
        print(f"{ratio:9g} {weeks:12g} {growth:7.3f} {growth / rate:6.1f} {wave:11.2f}", flush=True)


# --- by age ----------------------------------------------------------------------------------------------------------

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


def print_ages(model: Growing, thickness: float, stiffnesses: list[float]) -> dict[float, Born]:
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


def ages(
    *,
    rate: float = RATE,
    thickness: float = CONSTANTS["growing"].thickness,
    thickness_rate: float = CONSTANTS["growing"].thickness_rate,
    stiffness: Sequence[float] = (1, 1.5, 2, 3, 4, 5, 7, 10),
) -> None:
    """The age and the width of the first folds for each stiffness.

    rate : growth along per week since 22 weeks
    thickness : at 22 weeks, mm
    thickness_rate : change of the thickness without stress, in that at 22 weeks, per week
    """
    model = laws(rate, thickness_rate)
    if not grown_at(model, LAST).across > -1:
        raise argparse.ArgumentTypeError(f"by --thickness-rate nothing is left at {LAST:g} weeks")
    folding = print_ages(model, thickness, list(stiffness))
    print(
        f"\nstiffness  thickness at {ORIGIN:g} weeks, mm, with which folds are {WIDTH:g} mm wide at {WIDTH_AT:g} weeks"
    )
    for ratio, first in folding.items():
        if first.age <= WIDTH_AT:
            print(f"{ratio:9g}  {WIDTH / width(first.wavelength, 1.0, model, WIDTH_AT):.2f}")


main = command(__doc__, bilayer, yielding, ages)

if __name__ == "__main__":
    main()
