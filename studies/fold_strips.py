"""Does a flat cortex fold in the solver when theory says, and as wide?

    python studies/fold_strips.py [--spacing 0.5] [--thickness 1 --thickness 2] [--stiffness 1 --stiffness 5]
    python studies/fold_strips.py --thickness 1.25 --stiffness 1 --coarse --spacing 1 [--cut]

What folds is a strip, one layer of elements wide, that can slide along its sides and its bottom but not leave them.
The exact onset is that of `fold_theory.py`; stiffness is the layer's shear modulus over the base's, as in the
simulation 1 / `fold.core_stiffness`. Growth across the layer, if there is any, comes with that along it and is
complete at half the onset's: what is measured later is for that growth across, as theory has it. Thicknesses are
those before growth.

measured : the layer begins with a bump, a cosine of a hundredth of its thickness. As it grows, the bump does, by
    1 / (1 - growth / critical growth) near the critical one (Southwell 1932), which so is found for three wavelengths;
    the least of a parabola through them is the onset.
from noise : the surface is displaced at random by a thousandth of the thickness and grows until it is rough; the
    wavelength is that of the mean wave number, each weighted by its power.
`--coarse` makes cells as high as they are wide, as those of a brain are. `--cut` gives each of them the mean of growth
over it, in place of that at its centroid. `--own` is the part of its shear energy that an element has of its own.

Allen : 2 pi H (E_f / 3 E_s)^(1/3) for a thickness H and plane-strain moduli E = 2 mu / (1 - nu) of a stiff film on a
    soft base (Allen 1969).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import count, product
from typing import NamedTuple

import numpy as np
from cyclopts import App
from fold_theory import Onset, onset
from numpy.typing import NDArray
from scipy.fft import dct

from cortet.folding.body import Body, Material, Scale, body_of
from cortet.folding.contact import contact_of
from cortet.folding.kernels import DONE, Motion, advance, workspace
from cortet.folding.law import ACROSS, depth_of_share, growth_share
from cortet.folding.models import course, tangential
from cortet.folding.stability import longest_step
from cortet.geometry.topology import boundary_faces
from cortet.meshes import FloatArray, IntArray, TetMesh

#: of the displacement at first and of the roughness at which the wavelength is measured, in film thicknesses
_SEED, _ROUGHNESS = 1e-3, 0.05
#: time until the film has grown enough to buckle, in wavelengths over the base's shear wave speed: a film that grows
#: fast buckles late, in shorter waves
_PERIODS = 5
#: the same for a bump, which is to be at rest at every growth; its height, in film thicknesses
_BUMP_PERIODS, _BUMP = 40, 0.01
#: amplification from which on, and up to which, a bump grows as theory says; it lasts past the critical growth
_FROM, _TO = 3.0, 8.0
#: growth along, in that of the onset, at which all growth across has come: before a bump grows by `_FROM`
_COMPLETE = 0.5
#: wavelengths whose critical growth is measured, in units of the exact one
_WAVES = 0.75, 1.0, 1.3
#: exact wavelengths in a strip with noise
_LENGTH = 6
#: of the base's layers, each over the one above
_GRADING = 1.25


#: corners of the six tetrahedra of a cube (Kuhn 1960), corner i having the bits of i as coordinates
_KUHN = np.array([[0, 1, 3, 7], [0, 5, 1, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 6, 4, 7]])


class Wrinkles(NamedTuple):
    """What a strip had become when its wrinkles were measured."""

    growth: float
    wavelength: float
    #: (k,), heights of the surface along the strip
    heights: FloatArray


def strip(length: float, depth: float, film: float, spacing: float, height: float | None = None) -> TetMesh:
    """A box [0, length] x [0, spacing] x [-depth, 0] of Kuhn tetrahedra, finest down to twice the film's thickness.

    Parameters
    ----------
    height : of the finest cells; None: half of `spacing`
    """
    height = height or spacing / 2
    fine = np.arange(0, 2 * film - height / 2, height)
    coarse = [fine[-1] + height]
    while coarse[-1] < depth:
        coarse.append(coarse[-1] + min(height * _GRADING ** len(coarse), depth / 6))
    z = -np.concatenate([fine, coarse])[::-1]
    axes = np.linspace(0, length, round(length / spacing) + 1), np.array([0.0, spacing]), z
    points = np.stack([w.ravel() for w in np.meshgrid(*axes, indexing="ij")], axis=1)
    nx, ny, nz = (len(axis) for axis in axes)
    number = np.arange(nx * ny * nz).reshape(nx, ny, nz)
    origin = number[:-1, :-1, :-1].ravel()
    corner = np.array([(i & 1) * ny * nz + (i >> 1 & 1) * nz + (i >> 2 & 1) for i in range(8)])
    return TetMesh(points, (origin[:, None] + corner)[:, _KUHN].reshape(-1, 4).astype(np.int32))


def theory(thickness: float, material: Material) -> tuple[float, float]:
    """Wavelength, and compression at which it comes, for a film of `mu_cortex` on a base of `mu_core`."""
    bulk, shear = material.bulk, (material.mu_cortex, material.mu_core)
    film, base = (2 * mu / (1 - (3 * bulk - 2 * mu) / (6 * bulk + 2 * mu)) for mu in shear)
    return 2 * np.pi * thickness * (film / (3 * base)) ** (1 / 3), (3 * base / film) ** (2 / 3) / 4


def material_of(stiffness: float) -> Material:
    """A film so many times as stiff as its base."""
    # little damping: waves here are longer than the body of size 1 that the constants are made for
    return Material(mu_cortex=1.0, mu_core=1.0 / stiffness, damping=0.005)


class Strip(NamedTuple):
    """A film on its base, and what holds it."""

    points: FloatArray
    body: Body
    #: nodes that do not move along x, y and z
    held: list[NDArray[np.bool_]]
    #: nodes of one side of its upper surface, along x
    surface: IntArray


def film(mesh: TetMesh, thickness: float, *, cut: bool = False) -> Strip:
    """What grows is down to a thickness below the upper surface of a `strip`.

    Parameters
    ----------
    cut : whether an element grows by the mean over it, not by the value at its centroid
    """
    x, y, z = mesh.points.T
    m, n = len(mesh.cells), len(mesh.points)
    depth = -mesh.points[mesh.cells][:, :, 2]
    own = _depth_of_mean(depth, thickness) if cut else depth.mean(axis=1)
    body = body_of(mesh, Scale(np.zeros(3), 1.0), thickness=thickness)._replace(
        normals=np.tile([0.0, 0.0, 1.0], (m, 1)), depth=own
    )
    held = [(x == 0) | (x == x.max()), np.full(n, True), z == z.min()]
    surface = np.flatnonzero((z == 0) & (y == 0)).astype(np.int32)
    return Strip(mesh.points, body, held, surface[np.argsort(x[surface])])


def _depth_of_mean(depths: FloatArray, thickness: float) -> FloatArray:
    """Depth at which the share of the layer is its mean over a tetrahedron with corners at depths (m, 4): (m,)."""
    inside = np.random.default_rng(0).dirichlet(np.ones(4), 500)  # barycentric coordinates, even over the tetrahedron
    share = np.vectorize(growth_share)(depths @ inside.T, thickness, 1.0).mean(axis=1)
    return np.vectorize(depth_of_share)(share, thickness)


def across_at(growth: float, across: float, onset_growth: float) -> float:
    """Growth across a film that has grown so much along itself, of `across` in all."""
    return across * min(growth / (_COMPLETE * onset_growth), 1.0)


def growing(
    strip: Strip,
    start: FloatArray,
    material: Material,
    rate: float,
    across: Callable[[float], float],
) -> Iterator[tuple[float, FloatArray]]:
    """Growth along, and heights of the surface (k,), after each step from positions (n, 3).

    Parameters
    ----------
    rate : growth along per time
    across : growth across, by that along

    Raises
    ------
    RuntimeError : an element inverted
    """
    body = strip.body
    mesh = TetMesh(strip.points, body.cells)
    work, state = workspace(body), Motion(start.copy(), np.zeros_like(start))
    contact = contact_of(start, boundary_faces(mesh), bulk=0.0)._replace(radius=np.inf)
    dt = longest_step(material, start, work, contact, tangential([0.0]))[0] / 2  # growth across makes cells flat
    for step in count():
        growth = rate * step * dt
        grown = course([[growth]])
        grown.growth[..., ACROSS] = across(growth)
        if advance(body, material, state, work, contact, grown, dt) != (1, DONE):
            raise RuntimeError(f"an element inverted at a growth of {growth:.3f}")
        for axis, nodes in enumerate(strip.held):
            state.x[nodes, axis] = start[nodes, axis]
            state.v[nodes, axis] = 0
        yield growth, state.x[strip.surface, 2]


def rate_of(periods: float, growth: float, wavelength: float, material: Material) -> float:
    """Growth per unit of time that reaches `growth` in so many wavelengths over the base's shear wave speed."""
    return growth / (periods * wavelength * np.sqrt(material.density / material.mu_core))


def wrinkle(mesh: TetMesh, thickness: float, material: Material, across: float = 0.0, *, cut: bool = False) -> Wrinkles:
    """Let the film of a strip grow from noise until it wrinkles.

    Raises
    ------
    RuntimeError : an element inverted, or the film stayed flat
    """
    strip, exact, start = film(mesh, thickness, cut=cut), onset(material, across=across), mesh.points.copy()
    free = ~strip.held[2]
    start[free, 2] += _SEED * thickness * np.random.default_rng(0).normal(size=free.sum())
    rate = rate_of(_PERIODS, exact.growth, exact.wavelength * thickness, material)
    path = partial(across_at, across=across, onset_growth=exact.growth)
    for growth, heights in growing(strip, start, material, rate, path):
        if heights.std() > _ROUGHNESS * thickness:
            return Wrinkles(growth, mean_wavelength(heights, mesh.points[:, 0].max()), heights)
        if growth > 4 * exact.growth:
            raise RuntimeError(f"the film was flat at a growth of {growth:.3f}")
    raise AssertionError


def critical_growth(
    wavelength: float,
    spacing: float,
    thickness: float,
    material: Material,
    expected: float,
    across: float = 0.0,
    *,
    coarse: bool = False,
    cut: bool = False,
) -> float:
    """Growth at which a wave of this length would appear, from how a bump of its shape grows.

    Parameters
    ----------
    coarse : whether cells are as high as they are wide
    cut : as of `film`

    Raises
    ------
    RuntimeError : an element inverted, or the bump had not grown at three times the growth that was expected
    """
    mesh = strip(wavelength, 2 * wavelength + 2 * thickness, thickness, spacing, spacing if coarse else None)
    flat = film(mesh, thickness, cut=cut)
    wave = np.cos(2 * np.pi * flat.points[:, 0] / wavelength)
    bumpy = flat.points.copy()
    bumpy[:, 2] += _BUMP * thickness * wave * np.exp(2 * np.pi / wavelength * bumpy[:, 2]) * ~flat.held[2]
    flat = flat._replace(points=bumpy, body=film(TetMesh(bumpy, mesh.cells), thickness, cut=cut).body)
    seen, first = [], 0.0
    rate = rate_of(_BUMP_PERIODS, expected, wavelength, material)
    path = partial(across_at, across=across, onset_growth=expected)
    for growth, heights in growing(flat, bumpy, material, rate, path):
        amplitude = dct(heights, type=1)[2]  # one wave is two half waves
        first = first or amplitude
        if amplitude > _FROM * first:
            seen.append((first / amplitude, growth))
        if amplitude > _TO * first:
            break
        if growth > 3 * expected:
            raise RuntimeError(f"the bump had not grown at a growth of {growth:.3f}")
    inverse, growths = np.array(seen).T
    return float(np.polyfit(inverse, growths, 1)[1])


def measured_onset(
    spacing: float, thickness: float, material: Material, exact: Onset, across: float = 0.0, **how: bool
) -> tuple[float, float]:
    """Least critical growth and its wavelength; `how` as of `critical_growth`."""
    waves = np.array(_WAVES) * exact.wavelength * thickness
    expected = exact.growth
    growths = [critical_growth(one, spacing, thickness, material, expected, across, **how) for one in waves]
    return least(waves, growths)


def least(waves: FloatArray, growths: Sequence[float]) -> tuple[float, float]:
    """The least growth, by a parabola through those of three waves, and its wave."""
    a, b, c = np.polyfit(np.log(waves), growths, 2)
    wave = np.exp(-b / (2 * a))
    if a <= 0 or not waves[0] < wave < waves[-1]:  # no least one among them
        return min(growths), float(waves[np.argmin(growths)])
    return float(c - b**2 / (4 * a)), float(wave)


def mean_wavelength(heights: FloatArray, length: float) -> float:
    """Wavelength of the power-weighted mean wave number of equally spaced heights (k,) along a length."""
    power = dct(heights, type=1)[1:] ** 2  # the first is the mean height
    return float(2 * length * power.sum() / (power * np.arange(1, len(heights))).sum())


def strips(
    *,
    spacing: float = 0.5,
    thickness: tuple[float, ...] = (1.0, 2.0),
    stiffness: tuple[float, ...] = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0),
    across: float = 0.0,
    coarse: bool = False,
    cut: bool = False,
    own: float = Material().own,
) -> None:
    """Measure the onset on strips.

    Parameters
    ----------
    spacing
        Of the nodes along the strip.
    thickness
        Of the layer.
    stiffness
        Of the layer over that of its base.
    across
        Growth across the layer at the onset.
    coarse
        Cells as high as they are wide.
    cut
        The mean of an element's growth in place of that at its centroid.
    own
        Part of its shear energy that an element has of its own, the rest by its edges.
    """
    print("                     exact               measured / exact     from noise        Allen")
    print("thickness stiffness  growth  wavelength  growth  wavelength  wavelength  wavelength  CPU s")
    for film_thickness, ratio in product(thickness, stiffness):
        began, material = time.process_time(), material_of(ratio)._replace(own=own)
        exact = onset(material, across=across)
        growth, wavelength = measured_onset(spacing, film_thickness, material, exact, across, coarse=coarse, cut=cut)
        length = exact.wavelength * film_thickness
        mesh = strip(_LENGTH * length, 2 * length, film_thickness, spacing, spacing if coarse else None)
        noisy = wrinkle(mesh, film_thickness, material, across, cut=cut)
        allen = theory(film_thickness * (1 + across), material)[0]
        print(
            f"{film_thickness:9g} {ratio:9g} {exact.growth:7.3f} {length:11.2f} {growth / exact.growth:7.3f}"
            f" {wavelength / length:11.2f} {noisy.wavelength / length:11.2f}"
            f" {allen / length:11.2f} {time.process_time() - began:6.0f}",
            flush=True,
        )


app = App(help=__doc__, help_format="plaintext")
app.default(strips)

if __name__ == "__main__":
    app()
