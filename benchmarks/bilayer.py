"""Exact onset of folding: the linear stability of a growing layer on its base, by the law that the simulation has.

    python benchmarks/bilayer.py [--stiffness 0.5 1 2 5 10 20] [--sharp]

A half-space whose uppermost part grows tangentially and is held at its sides stays flat until the second variation of
its energy vanishes for some wave, sin kx along the surface. The variation is assembled here over the depth (quadratic
elements; the wave is exact along x) for the neo-Hookean energy, the profile of growth and the stiffness of
`cortet.simulation`, and the growth at which it stops being positive is bisected for each wave number. No assumption
is made on the ratio of the moduli, as Allen's formula makes for stiff films. Methods: Biot, Mechanics of Incremental
Deformations, 1965; growing bilayers: arXiv:2312.10162.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cholesky_banded
from scipy.optimize import minimize_scalar

from cortet.meshes import FloatArray
from cortet.simulation.body import Material
from cortet.simulation.law import growth_share

#: growth beyond which a layer is called stable; Biot's half-space folds at 0.5
LARGEST_GROWTH = 2.0
#: wavelengths that are searched, in thicknesses; below the smallest there is none that the layer sets
WAVELENGTHS = 0.3, 100.0
#: depth of the base, in wavelengths
_DEPTH = 2.0
_TRIED = 30
#: Gauss points of an element of [-1, 1], and their weights
_GAUSS = np.polynomial.legendre.leggauss(3)

#: share of the full growth (k,) at depths (k,) in thicknesses
Profile = Callable[[FloatArray], FloatArray]


class Onset(NamedTuple):
    """The first wave that a growing layer takes."""

    #: tangential growth at which it does
    growth: float
    #: in the unit of the thickness
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


def moduli(mu: FloatArray, bulk: float, growth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Second derivatives of the energy per initial volume by the displacement gradients of a plane wave.

    Returns
    -------
    by (u_x,x; u_z,z), and by (u_x,z; u_z,x): (k, 2, 2) each, for shear modulus and growth (k,)
    """
    tangential = 1 / (1 + growth)
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
    # growth comes between displacement and elastic deformation, along x, and the energy is that of the grown volume
    weights = np.stack([np.ones_like(growth), 1 + growth], axis=1)
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


def is_stable(growth: float, wave_number: float, thickness: float, material: Material, profile: Profile) -> bool:
    """Whether a flat layer that has grown so far resists a wave; lengths are those of the thickness."""
    borders = levels(thickness, wave_number)
    length = np.diff(borders)
    at, weights = _GAUSS
    depth = borders[:-1, None] + length[:, None] * (1 + at) / 2
    share = profile(depth.ravel() / thickness)
    mu = material.mu_core * (1 - share) + material.mu_cortex * share
    direct, rotated = moduli(mu, material.bulk, growth * share)
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
    return _is_positive(local)


def _is_positive(local: FloatArray) -> bool:
    """Whether a chain of elements (m, 6, 6), each with two unknowns more than its last shares, held at its end, is."""
    size = 4 * len(local) + 2
    banded = np.zeros((6, size))
    for i in range(6):
        for j in range(i + 1):  # lower form: row i - j, column j
            np.add.at(banded[i - j], 4 * np.arange(len(local)) + j, local[:, i, j])
    try:
        cholesky_banded(banded[:, : size - 2], lower=True)  # the last node does not move
    except LinAlgError:
        return False
    return True


def critical_growth(wave_number: float, thickness: float, material: Material, profile: Profile) -> float:
    """Least growth at which a wave appears; `LARGEST_GROWTH` if none does."""
    low, high = 0.0, LARGEST_GROWTH
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if is_stable(middle, wave_number, thickness, material, profile) else (low, middle)
    return high


def onset(material: Material, profile: Profile = smooth_profile) -> Onset:
    """The first wave of a layer of thickness 1 on a deep base."""

    def at(logarithm: float) -> float:
        return critical_growth(2 * np.pi / np.exp(logarithm), 1.0, material, profile)

    tried = np.linspace(*np.log(WAVELENGTHS), _TRIED)
    growths = np.array([at(one) for one in tried])
    lowest = int(growths.argmin())
    if lowest == 0:
        return Onset(growths[0], WAVELENGTHS[0], set_by_layer=False)
    best = minimize_scalar(at, bounds=(tried[lowest - 1], tried[min(lowest + 1, _TRIED - 1)]), method="bounded")
    return Onset(float(best.fun), float(np.exp(best.x)), set_by_layer=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stiffness", nargs="+", type=float, default=[0.5, 0.857, 1, 1.5, 2, 5, 10, 20])
    parser.add_argument("--sharp", action="store_true", help="all growth above one thickness, none below")
    options = parser.parse_args()
    profile = sharp_profile if options.sharp else smooth_profile
    print("stiffness  growth  wavelength  set by the layer")
    for stiffness in options.stiffness:
        material = Material(mu_cortex=1.0, mu_core=1 / stiffness)
        found = onset(material, profile)
        print(f"{stiffness:9g} {found.growth:7.4f} {found.wavelength:11.3f}  {found.set_by_layer}", flush=True)


if __name__ == "__main__":
    main()
