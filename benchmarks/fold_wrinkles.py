"""Onset and wavelength of the folds of a growing layer on its base, beside exact theory, over thickness and stiffness.

    python benchmarks/fold_wrinkles.py [--spacing 0.5] [--thickness 1 2] [--stiffness 0.5 1 2 5 10 20] [--across -0.25]

What folds is a strip, one layer of elements wide, that can slide along its sides and its bottom but not leave them.
The exact onset is that of `bilayer.py`; stiffness is the layer's shear modulus over the base's, as in the simulation
1 / `fold.core_stiffness`. Growth across the layer, if there is any, comes with that along it and is complete at half
the onset's: what is measured later is for that growth across, as theory has it. Thicknesses are those before growth.

measured : the layer begins with a bump, a cosine of a hundredth of its thickness. As it grows, the bump does, by
    1 / (1 - growth / critical growth) near the critical one (Southwell 1932), which so is found for three wavelengths;
    the least of a parabola through them is the onset.
from noise : the surface is displaced at random by a thousandth of the thickness and grows until it is rough; the
    wavelength is that of the mean wave number, each weighted by its power.
Allen : 2 pi H (E_f / 3 E_s)^(1/3) for a thickness H and plane-strain moduli E = 2 mu / (1 - nu) of a stiff film on a
    soft base (Allen 1969).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from typing import NamedTuple

import numpy as np
from bilayer import Onset, onset
from cubes import KUHN
from numpy.typing import NDArray
from scipy.fft import dct

from cortet.geometry.topology import boundary_faces
from cortet.meshes import FloatArray, IntArray, TetMesh
from cortet.simulation.altitude import smallest_altitude
from cortet.simulation.body import Body, Material, Scale, body_of, stable_time_step
from cortet.simulation.contact import contact_of
from cortet.simulation.kernels import DONE, Motion, advance, workspace
from cortet.simulation.law import ACROSS
from cortet.simulation.models import course

#: time step, in units of the one that a run would take: nothing is compressed much here
TIME_STEP = 3.0
#: of the displacement at first and of the roughness at which the wavelength is measured, in film thicknesses
_SEED, _ROUGHNESS = 1e-3, 0.05
#: time until the film has grown enough to buckle, in wavelengths over the base's shear wave speed: a film that grows
#: fast buckles late, in shorter waves
_PERIODS = 5
#: the same for a bump, which is to be at rest at every growth; its height, in film thicknesses
_BUMP_PERIODS, _BUMP = 10, 0.01
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


class Wrinkles(NamedTuple):
    """What a strip had become when its wrinkles were measured."""

    growth: float
    wavelength: float
    #: (k,), heights of the surface along the strip
    heights: FloatArray


def strip(length: float, depth: float, film: float, spacing: float) -> TetMesh:
    """A box [0, length] x [0, spacing] x [-depth, 0] of Kuhn tetrahedra, finest down to twice the film's thickness."""
    fine = np.arange(0, 2 * film, spacing / 2)
    coarse = [2 * film]
    while coarse[-1] < depth:
        coarse.append(coarse[-1] + min(spacing / 2 * _GRADING ** len(coarse), depth / 6))
    z = -np.concatenate([fine, coarse])[::-1]
    axes = np.linspace(0, length, round(length / spacing) + 1), np.array([0.0, spacing]), z
    points = np.stack([w.ravel() for w in np.meshgrid(*axes, indexing="ij")], axis=1)
    nx, ny, nz = (len(axis) for axis in axes)
    number = np.arange(nx * ny * nz).reshape(nx, ny, nz)
    origin = number[:-1, :-1, :-1].ravel()
    corner = np.array([(i & 1) * ny * nz + (i >> 1 & 1) * nz + (i >> 2 & 1) for i in range(8)])
    return TetMesh(points, (origin[:, None] + corner)[:, KUHN].reshape(-1, 4).astype(np.int32))


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


def film(mesh: TetMesh, thickness: float) -> Strip:
    """What grows is down to a thickness below the upper surface of a `strip`."""
    x, y, z = mesh.points.T
    m, n = len(mesh.cells), len(mesh.points)
    body = body_of(mesh, Scale(np.zeros(3), 1.0), thickness=thickness)._replace(
        normals=np.tile([0.0, 0.0, 1.0], (m, 1)), depth=-mesh.points[mesh.cells][:, :, 2].mean(axis=1)
    )
    held = [(x == 0) | (x == x.max()), np.full(n, True), z == z.min()]
    surface = np.flatnonzero((z == 0) & (y == 0))
    return Strip(mesh.points, body, held, surface[np.argsort(x[surface])])


def across_at(growth: float, across: float, onset_growth: float) -> float:
    """Growth across a film that has grown so much along itself, of `across` in all."""
    return across * min(growth / (_COMPLETE * onset_growth), 1.0)


def growing(
    strip: Strip,
    start: FloatArray,
    material: Material,
    rate: float,
    across: Callable[[float], float] = lambda _: 0.0,
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
    body, mesh = strip.body, TetMesh(strip.points, strip.body.cells)
    work, state = workspace(body), Motion(start.copy(), np.zeros_like(start))
    contact = contact_of(start, boundary_faces(mesh), bulk=material.bulk)._replace(radius=np.inf)
    dt = TIME_STEP * stable_time_step(smallest_altitude(strip.points, body.cells), material)
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


def wrinkle(mesh: TetMesh, thickness: float, material: Material, across: float = 0.0) -> Wrinkles:
    """Let the film of a strip grow from noise until it wrinkles.

    Raises
    ------
    RuntimeError : an element inverted, or the film stayed flat
    """
    strip, exact, start = film(mesh, thickness), onset(material, across=across), mesh.points.copy()
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
    wavelength: float, spacing: float, thickness: float, material: Material, expected: float, across: float = 0.0
) -> float:
    """Growth at which a wave of this length would appear, from how a bump of its shape grows.

    Raises
    ------
    RuntimeError : an element inverted, or the bump had not grown at three times the growth that was expected
    """
    flat = film(strip(wavelength, 2 * wavelength + 2 * thickness, thickness, spacing), thickness)
    wave = np.cos(2 * np.pi * flat.points[:, 0] / wavelength)
    bumpy = flat.points.copy()
    bumpy[:, 2] += _BUMP * thickness * wave * np.exp(2 * np.pi / wavelength * bumpy[:, 2]) * ~flat.held[2]
    flat = film(TetMesh(bumpy, flat.body.cells), thickness)._replace(held=flat.held, surface=flat.surface)
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
    return float(np.polyfit(*np.array(seen).T, 1)[1])


def measured_onset(
    spacing: float, thickness: float, material: Material, exact: Onset, across: float = 0.0
) -> tuple[float, float]:
    """Least critical growth and its wavelength."""
    waves = np.array(_WAVES) * exact.wavelength * thickness
    growths = [critical_growth(wave, spacing, thickness, material, exact.growth, across) for wave in waves]
    a, b, c = np.polyfit(np.log(waves), growths, 2)
    least = np.exp(-b / (2 * a))
    if a <= 0 or not waves[0] < least < waves[-1]:  # no least one among them
        return min(growths), float(waves[np.argmin(growths)])
    return float(c - b**2 / (4 * a)), float(least)


def mean_wavelength(heights: FloatArray, length: float) -> float:
    """Wavelength of the power-weighted mean wave number of equally spaced heights (k,) along a length."""
    power = dct(heights, type=1)[1:] ** 2  # the first is the mean height
    return float(2 * length * power.sum() / (power * np.arange(1, len(heights))).sum())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spacing", type=float, default=0.5)
    parser.add_argument("--thickness", nargs="+", type=float, default=[1.0, 2.0])
    parser.add_argument("--stiffness", nargs="+", type=float, default=[0.5, 1.0, 2.0, 5.0, 10.0, 20.0])
    parser.add_argument("--across", type=float, default=0.0, help="growth across the layer at the onset")
    options = parser.parse_args()
    print("                     exact               measured / exact     from noise        Allen")
    print("thickness stiffness  growth  wavelength  growth  wavelength  wavelength  wavelength  CPU s")
    for thickness in options.thickness:
        for stiffness in options.stiffness:
            began, material = time.process_time(), material_of(stiffness)
            exact = onset(material, across=options.across)
            growth, wavelength = measured_onset(options.spacing, thickness, material, exact, options.across)
            length = exact.wavelength * thickness
            mesh = strip(_LENGTH * length, 2 * length, thickness, options.spacing)
            noisy = wrinkle(mesh, thickness, material, options.across)
            allen = theory(thickness * (1 + options.across), material)[0]
            print(
                f"{thickness:9g} {stiffness:9g} {exact.growth:7.3f} {length:11.2f} {growth / exact.growth:7.3f}"
                f" {wavelength / length:11.2f} {noisy.wavelength / length:11.2f}"
                f" {allen / length:11.2f} {time.process_time() - began:6.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
