"""At which growth does a flat cortex fold, and how wide, by exact theory?

    python studies/fold_theory.py [--stiffness 0.5 --stiffness 2] [--across -0.3] [--sharp]

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
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from cyclopts import App
from scipy.linalg import LinAlgError, cholesky_banded
from scipy.optimize import minimize_scalar

from cortet.folding.body import Material
from cortet.folding.law import growth_share
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

    tried = np.log(np.geomspace(WAVELENGTHS[0], WAVELENGTHS[1], _TRIED))
    growths = np.array([at(one) for one in tried])
    lowest = int(growths.argmin())
    if lowest == 0:
        return Onset(growths[0], WAVELENGTHS[0], set_by_layer=False)
    best = minimize_scalar(at, bounds=(tried[lowest - 1], tried[min(lowest + 1, _TRIED - 1)]), method="bounded")
    return Onset(float(best.fun), float(np.exp(best.x)), set_by_layer=True)


def bilayer(
    *, stiffness: tuple[float, ...] = (0.5, 0.857, 1, 1.5, 2, 5, 10, 20), across: float = 0.0, sharp: bool = False
) -> None:
    """Print the first wave for each stiffness.

    Parameters
    ----------
    stiffness
        Of the layer over that of its base.
    across
        Growth across the layer, the same at each onset.
    sharp
        All growth above one thickness, none below.
    """
    profile = sharp_profile if sharp else smooth_profile
    print("stiffness  growth  wavelength  set by the layer")
    for ratio in stiffness:
        first = onset(Material(mu_cortex=1.0, mu_core=1 / ratio), profile, across)
        print(f"{ratio:9g} {first.growth:7.4f} {first.wavelength:11.3f}  {first.set_by_layer}", flush=True)


app = App(help=__doc__, help_format="plaintext")
app.default(bilayer)

if __name__ == "__main__":
    app()
