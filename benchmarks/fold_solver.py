"""Does the folding solver do what theory says: onset and width of folds, displacements, and no imprint of a lattice?

    python benchmarks/fold_solver.py [--spacing 0.5] [--thickness 1 2] [--stiffness 0.5 1 2 5 10 20] [--across -0.25]
    python benchmarks/fold_solver.py yielding [--spacing 0.5] [--height 1] [--stiffness 1 2] [--times 2 0.5]
    python benchmarks/fold_solver.py balls [--nodes 12000] [--thickness 0.12 0.18] [--stiffness 4 16]
    python benchmarks/fold_solver.py growing_ball [--cell-sizes 2.5 1.75 1.25] [--growth 0.02] [--dolfinx PYTHON]
    python benchmarks/fold_solver.py imprint LATTICE_RUN OTHER_RUN --cell-size 0.8

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
Allen : 2 pi H (E_f / 3 E_s)^(1/3) for a thickness H and plane-strain moduli E = 2 mu / (1 - nu) of a stiff film on a
    soft base (Allen 1969).

`yielding`: the base relaxes as a Maxwell body (`fold.core_relaxation`), and its layer is sharp. Bumps of three lengths
grow until they are `AMPLIFIED` times as high; the least growth at which one is, and its length, stand beside those of
`fold_theory.py yielding`.

`balls`: a flat layer would buckle as the strip says; a ball's curvature changes the factor, not the trend. The ball
grows until the distances of its surface from the centre, divided by those at the start, vary by some per cent; the
wavelength is that of the mean degree of this variation in spherical harmonics, each weighted by its power.

`growing_ball`: a ball whose outer shell grows along itself. The shell, from a radius of 10 to 14 mm, is the cortex of
a mesh of two regions. Displacements are outward and in mm, of the outside and of the interface. Exact ones are of
linear elasticity. CalculiX (ccx) solves the job that `cortet job` writes, and so does dolfinx, with `--dolfinx
'COMMAND OF A PYTHON THAT HAS IT'`; ours is the folding model, damped until nothing moves.

`imprint`: both are folders of `cortet fold`, the first of a `lattice` mesh of that cell size, the second of any other
mesh. Prints the gyrification index of both against age, and the correlation of what their curvature has gained, at
the same place of the unfolded surface. Then, how strongly that gain has the period of the lattice over the unfolded
surface: its mean power at the lattice's shortest reciprocal vectors over that at the same vectors turned at random (1
means no imprint), the share of turned ones with more power, and the share of the gain's variance that waves of these
vectors hold. Surface nodes settle between those of the lattice below, and thus sample any signal with its period; so
the same is printed for the other run's gain, at the places of its own nodes and at those of the lattice's.
"""

from __future__ import annotations

import shlex
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyvista
import trimesh
from _frame import command, cpu_seconds
from cubes import KUHN
from fold_theory import AMPLIFIED, RATE, Onset, first_wave, onset
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.spatial import ConvexHull, Delaunay, cKDTree
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from cortet.folding import fenics_job
from cortet.folding.body import Body, Material, Scale, body_of
from cortet.folding.calculix import write_job
from cortet.folding.contact import contact_of, listed_at
from cortet.folding.growth import Linear
from cortet.folding.journal import SERIES, TABLE, series
from cortet.folding.kernels import DONE, LIST_OUTDATED, Motion, advance, energies, workspace
from cortet.folding.law import ACROSS
from cortet.folding.models import course, tangential
from cortet.folding.patches import renew
from cortet.folding.relaxation import relax
from cortet.folding.stability import longest_step
from cortet.formats import vtu
from cortet.formats.tsv import read_tsv
from cortet.geometry.nesting import nested
from cortet.geometry.quadratic import QuadraticMesh
from cortet.geometry.topology import boundary_faces, boundary_nodes, boundary_surface
from cortet.measure.quality import signed_volumes
from cortet.meshers._lattice import CONSTANT
from cortet.meshes import FloatArray, IntArray, TetMesh, TriSurface
from cortet.solver_files.sets import named_sets
from cortet.stages.generate import generate
from cortet.stages.reconnect import reconnect
from cortet.stages.solver_ready import surface_nodes_first

# --- strips ----------------------------------------------------------------------------------------------------------

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


#: steps after which a base relaxes
_PER_YIELD = 10
#: height of a bump on a base that yields, in film thicknesses: small until it is `AMPLIFIED`
_SMALL_BUMP = 0.001


class Wrinkles(NamedTuple):
    """What a strip had become when its wrinkles were measured."""

    growth: float
    wavelength: float
    #: (k,), heights of the surface along the strip
    heights: FloatArray


def strip(length: float, depth: float, film: float, spacing: float, height: float = 0.5) -> TetMesh:
    """A box [0, length] x [0, spacing] x [-depth, 0] of Kuhn tetrahedra, finest down to twice the film's thickness.

    height : of the finest cells, over `spacing`
    """
    fine = np.arange(0, 2 * film, spacing * height)
    coarse = [2 * film]
    while coarse[-1] < depth:
        coarse.append(coarse[-1] + min(spacing * height * _GRADING ** len(coarse), depth / 6))
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
    *,
    yielding: float = np.inf,
) -> Iterator[tuple[float, FloatArray]]:
    """Growth along, and heights of the surface (k,), after each step from positions (n, 3).

    Parameters
    ----------
    rate : growth along per time
    across : growth across, by that along
    yielding : growth along in the time in which the base relaxes; inf: it is elastic

    Raises
    ------
    RuntimeError : an element inverted
    """
    body = strip.body._replace(gradients=strip.body.gradients.copy())
    mesh, every = TetMesh(strip.points, body.cells), np.ones(len(body.cells))
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
        if np.isfinite(yielding) and step % _PER_YIELD == 0:
            parts = -np.expm1(-_PER_YIELD * rate * dt / yielding) * every
            energies(material, state, work, grown.growth[0], 0.0)
            relax(body.gradients, work, grown.growth[0], 0.0, parts)
            renew(work.patches, body)
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
    return least(waves, [critical_growth(wave, spacing, thickness, material, exact.growth, across) for wave in waves])


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
    thickness: Sequence[float] = (1.0, 2.0),
    stiffness: Sequence[float] = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0),
    across: float = 0.0,
) -> None:
    """Measure the onset on strips.

    across : growth across the layer at the onset
    """
    print("                     exact               measured / exact     from noise        Allen")
    print("thickness stiffness  growth  wavelength  growth  wavelength  wavelength  wavelength  CPU s")
    for film_thickness, ratio in product(thickness, stiffness):
        began, material = time.process_time(), material_of(ratio)
        exact = onset(material, across=across)
        growth, wavelength = measured_onset(spacing, film_thickness, material, exact, across)
        length = exact.wavelength * film_thickness
        mesh = strip(_LENGTH * length, 2 * length, film_thickness, spacing)
        noisy = wrinkle(mesh, film_thickness, material, across)
        allen = theory(film_thickness * (1 + across), material)[0]
        print(
            f"{film_thickness:9g} {ratio:9g} {exact.growth:7.3f} {length:11.2f} {growth / exact.growth:7.3f}"
            f" {wavelength / length:11.2f} {noisy.wavelength / length:11.2f}"
            f" {allen / length:11.2f} {time.process_time() - began:6.0f}",
            flush=True,
        )


# --- strips on a base that yields ------------------------------------------------------------------------------------


def sharp(strip: Strip) -> Strip:
    """The strip with all of the growth in its film, and none below."""
    depth = np.where(strip.body.depth < strip.body.thickness, -np.inf, np.inf)
    return strip._replace(body=strip.body._replace(depth=depth))


def growth_of_bump(
    wavelength: float, spacing: float, height: float, material: Material, yielding: float, slow: float
) -> float:
    """Growth along at which a bump on a film 1 thick is `AMPLIFIED` times as high; NaN: none up to 1.

    height : of the finest cells, over `spacing`
    slow : growth along in the time in which a shear wave of the base crosses the wave
    """
    flat = film(strip(wavelength, 2 * wavelength + 2, 1.0, spacing, height), 1.0)
    wave = np.cos(2 * np.pi * flat.points[:, 0] / wavelength)
    bumpy = flat.points.copy()
    bumpy[:, 2] += _SMALL_BUMP * wave * np.exp(2 * np.pi / wavelength * bumpy[:, 2]) * ~flat.held[2]
    bent = film(TetMesh(bumpy, flat.body.cells), 1.0)
    bent = sharp(bent._replace(body=bent.body._replace(depth=flat.body.depth), held=flat.held, surface=flat.surface))
    rate, first = rate_of(1 / slow, 1.0, wavelength, material), 0.0
    for growth, heights in growing(bent, bumpy, material, rate, yielding=yielding):
        amplitude = float(dct(heights, type=1)[2])
        first = first or amplitude
        if amplitude > AMPLIFIED * first:
            return growth
        if growth > 1:
            break
    return np.nan


def yielding(
    *,
    spacing: float = 0.5,
    stiffness: Sequence[float] = (1.0, 2.0),
    times: Sequence[float] = (2.0, 0.5),
    rate: float = RATE,
    slow: float = 0.005,
    height: float = 0.5,
    damping: float = Material().damping,
) -> None:
    """Compare bumps on a base that yields with theory.

    height : of the finest cells, over `spacing`
    damping : see `Material`
    times : in which the base relaxes, weeks
    rate : growth along per week
    slow : growth along in the time in which a shear wave of the base crosses a wave
    """
    print("                  exact               measured / exact")
    print("stiffness  weeks  growth  wavelength  growth  wavelength  CPU s")
    for ratio, weeks in product(stiffness, times):
        began, material = time.process_time(), material_of(ratio)._replace(damping=damping)
        growth, wavelength = first_wave(material, rate * weeks)
        waves = np.array(_WAVES) * wavelength
        found = least(waves, [growth_of_bump(wave, spacing, height, material, rate * weeks, slow) for wave in waves])
        print(
            f"{ratio:9g} {weeks:6g} {growth:7.4f} {wavelength:11.2f} {found[0] / growth:7.3f}"
            f" {found[1] / wavelength:11.2f} {time.process_time() - began:6.0f}",
            flush=True,
        )


# --- balls that fold -------------------------------------------------------------------------------------------------

#: relative variation of the radius at which the wavelength is measured
_AMPLITUDE = 0.03
_MAX_DEGREE = 16
#: time until the cortex has grown enough to buckle, in wavelengths over the core's shear wave speed
_BALL_PERIODS = 2
_LARGEST_GROWTH = 1.5


@dataclass(frozen=True)
class Folds:
    """What a ball of radius 1 had become when its folds were measured."""

    growth: float
    #: power-weighted mean degree of the spherical harmonics, and the wavelength 2 pi / degree
    degree: float
    wavelength: float


def solid_ball(nodes: int) -> TetMesh:
    """A ball of radius 1 filled with a body-centred cubic lattice, its tetrahedra improved."""
    spacing = (4 / 3 * np.pi / nodes * 2) ** (1 / 3)  # two nodes per cube
    axis = np.arange(-np.ceil(1 / spacing), np.ceil(1 / spacing) + 1) * spacing
    corners = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = np.concatenate([corners, corners + spacing / 2])
    count = round(4 * np.pi / (0.75 * spacing**2))
    height = (np.arange(count) + 0.5) * 2 / count - 1
    angle, ring = np.pi * (1 + 5**0.5) * np.arange(count), np.sqrt(1 - height**2)
    skin = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    # displaced at random: a lattice would prefer folds of its own symmetry
    lattice = lattice + np.random.default_rng(0).uniform(-0.25, 0.25, lattice.shape) * spacing
    points = np.vstack([skin, lattice[np.linalg.norm(lattice, axis=1) < 1 - 0.5 * spacing]])
    cells = Delaunay(points).simplices
    volumes = signed_volumes(points, cells)
    cells[volumes < 0] = cells[volumes < 0][:, [1, 0, 2, 3]]
    rough = TetMesh(points, cells[np.abs(volumes) > 1e-6 * spacing**3])
    hull = ConvexHull(skin).simplices
    inward = np.linalg.det(skin[hull]) < 0
    hull[inward] = hull[inward][:, ::-1]
    return reconnect(rough, TriSurface(skin, hull))[0]


def fold_ball(mesh: TetMesh, thickness: float, stiffness: float) -> Folds:
    """Let the cortex of a ball of radius 1 grow until it folds.

    Parameters
    ----------
    thickness : of the cortex
    stiffness : shear modulus of the cortex over that of the core

    Raises
    ------
    RuntimeError : an element inverted, or there were no folds in the end
    """
    material = Material(mu_cortex=1.0, mu_core=1.0 / stiffness, damping=0.05)
    body = body_of(mesh, Scale(np.zeros(3), 1.0), thickness=thickness)
    work, state = workspace(body), Motion(mesh.points.copy(), np.zeros_like(mesh.points))
    contact = contact_of(state.x, boundary_faces(mesh), bulk=material.bulk)
    dt, _ = longest_step(material, state.x, work, contact, tangential([0.0]))
    wavelength, buckling = theory(thickness, material)
    rate = buckling / (_BALL_PERIODS * wavelength * np.sqrt(material.density / material.mu_core))
    surface = boundary_nodes(mesh)
    step = 0
    while rate * step * dt < _LARGEST_GROWTH:
        times = (step + np.arange(20)) * dt
        done, how = advance(body, material, state, work, contact, course(Linear(rate)(times)[:, None]), dt)
        step += done
        if how == LIST_OUTDATED:
            contact = listed_at(contact, state.x, 1.0)
        elif how != DONE:
            raise RuntimeError(f"an element inverted at a growth of {rate * step * dt:.3f}")
        stretch = np.linalg.norm(state.x[surface], axis=1) / np.linalg.norm(mesh.points[surface], axis=1)
        if stretch.std() > _AMPLITUDE * stretch.mean():
            degree = mean_degree(mesh.points[surface], stretch)
            return Folds(rate * step * dt, degree, 2 * np.pi / degree)
    raise RuntimeError(f"no folds until a growth of {_LARGEST_GROWTH}")


def mean_degree(points: FloatArray, heights: FloatArray) -> float:
    """Power-weighted mean degree, from 2 on, of heights (n,) in the directions of points (n, 3)."""
    polar = np.arccos(points[:, 2] / np.linalg.norm(points, axis=1))
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    terms = [(degree, order) for degree in range(_MAX_DEGREE + 1) for order in range(degree + 1)]
    values = [sph_harm_y(degree, order, polar, azimuth) for degree, order in terms]
    columns = [value.real for value in values] + [value.imag for value in values]
    weights = np.linalg.lstsq(np.stack(columns, axis=1), heights, rcond=None)[0] ** 2
    degrees = np.array([degree for degree, _ in terms] * 2)
    power = np.bincount(degrees, weights)[2:]
    return float((power * np.arange(2, _MAX_DEGREE + 1)).sum() / power.sum())


def balls(
    *, nodes: int = 12000, thickness: Sequence[float] = (0.12, 0.18), stiffness: Sequence[float] = (4.0, 16.0)
) -> None:
    """Measure the wavelength of the folds of a ball."""
    mesh = solid_ball(nodes)
    print(f"{len(mesh.points)} nodes, {len(mesh.cells)} tetrahedra")
    print("thickness  stiffness  growth  degree  wavelength  theory  quotient  CPU s")
    for cortex, ratio in product(thickness, stiffness):
        began = time.process_time()
        folds = fold_ball(mesh, cortex, ratio)
        seconds = time.process_time() - began
        flat = theory(cortex, Material(mu_core=1 / ratio))[0]
        print(
            f"{cortex:9.3f}  {ratio:9.1f}  {folds.growth:6.3f}  {folds.degree:6.2f}"
            f"  {folds.wavelength:10.3f}  {flat:6.3f}  {folds.wavelength / flat:8.2f}  {seconds:5.0f}",
            flush=True,
        )


# --- a ball whose shell grows ----------------------------------------------------------------------------------------

INNER, OUTER = 10.0, 14.0
#: a Python that has dolfinx: that of the system, where Debian's python3-dolfinx is installed
DOLFINX = ("/usr/bin/python3",)
#: dimensionless damping, in the place of the model's 0.5: enough that nothing swings for long
_DAMPING = 5.0
#: steps between two looks at the largest speed, and the speed at which the body rests
_STEPS, _REST = 500, 1e-9


def surfaces() -> TriSurface:
    """The outside of the ball, with the interface inside it."""
    outer, inner = (trimesh.creation.icosphere(subdivisions=4, radius=radius) for radius in (OUTER, INNER))
    return nested(TriSurface(outer.vertices, outer.faces), {"white": TriSurface(inner.vertices, inner.faces)})


def ball(cell_size: float) -> TetMesh:
    """The mesh, with its sets."""
    mesh, _ = surface_nodes_first(generate(surfaces(), cell_size=cell_size)[0])
    return named_sets(mesh, inner=["white"])


def exact(growth: float, material: Material) -> tuple[float, float]:
    """Displacements of the outside and of the interface, mm.

    In the core u = A r. In the shell, whose stress-free strain is `growth` in both tangential directions, equilibrium
    is u'' + 2 u' / r - 2 u / r^2 = -4 mu growth / (lambda + 2 mu) / r, so u = B r + C / r^2 + c r ln r.
    """
    shear, bulk = material.mu_cortex, material.bulk
    first = bulk - 2 / 3 * shear
    stiff = first + 2 * shear
    c = -4 * shear * growth / (3 * stiff)

    def displacement(r: float) -> FloatArray:
        return np.array([r, 1 / r**2, c * r * np.log(r)])

    def stress(r: float) -> FloatArray:
        slope = np.array([1, -2 / r**3, c * (np.log(r) + 1)])
        return stiff * slope + 2 * first * displacement(r) / r - [0, 0, 2 * first * growth]

    at_inner, at_outer, pressed, free = displacement(INNER), displacement(OUTER), stress(INNER), stress(OUTER)
    equations = [[INNER, *-at_inner[:2]], [3 * bulk, *-pressed[:2]], [0, *free[:2]]]
    a, *shell = np.linalg.solve(equations, [at_inner[2], pressed[2], -free[2]])
    return float(at_outer @ [*shell, 1]), float(a * INNER)


def by_calculix(mesh: TetMesh, growth: float, curved: QuadraticMesh | None = None) -> FloatArray:
    """Displacements of all corners: (n, 3) mm; with elements of ten nodes if they are given."""
    with tempfile.TemporaryDirectory() as folder:
        write_job(mesh, Path(folder), growth=growth, curved=curved)
        subprocess.run(["ccx", "job"], cwd=folder, capture_output=True, check=True)
        rows = [line.split() for line in Path(folder, "job.dat").read_text().splitlines()]
    found = [row[1:] for row in rows if len(row) == 4 and row[0].isdecimal()]
    return np.array(found[-len((curved or mesh).points) :][: len(mesh.points)], float)


def by_dolfinx(mesh: TetMesh, growth: float, python: Sequence[str] = DOLFINX) -> FloatArray:
    """The same by dolfinx, in the law of the folding model."""
    with tempfile.TemporaryDirectory() as folder:
        fenics_job.write_job(mesh, Path(folder), growth=growth)
        subprocess.run([*python, "job.py"], cwd=folder, capture_output=True, check=True)
        rows = np.loadtxt(Path(folder, "displacement.txt"))
    found: FloatArray = rows[cKDTree(rows[:, :3]).query(mesh.points)[1], 3:]
    return found


def by_cortet(mesh: TetMesh, growth: float) -> FloatArray:
    """The same by the folding model, at rest."""
    points, material = mesh.points / OUTER, Material(damping=_DAMPING)
    body = body_of(mesh, Scale(np.zeros(3), OUTER))
    work, state = workspace(body), Motion(points.copy(), np.zeros(points.shape))
    contact = contact_of(points, boundary_faces(mesh), bulk=0.0)._replace(radius=np.inf)
    dt, _ = longest_step(material, points, work, contact, tangential([growth]))
    while True:
        steps = course(np.full((_STEPS, 1), growth))
        if advance(body, material, state, work, contact, steps, dt) != (_STEPS, DONE):
            raise RuntimeError("an element inverted")
        if np.abs(state.v).max() < _REST:
            return OUTER * (state.x - points)


def outward(mesh: TetMesh, displacement: FloatArray) -> tuple[float, float]:
    """Mean displacement away from the centre, of the outside and of the interface, mm."""
    length = np.linalg.norm(mesh.points, axis=1)
    along = np.einsum("nc,nc->n", displacement, mesh.points) / np.maximum(length, 1e-9)
    outside, interface = (along[mesh.sets.nodes[name]].mean() for name in ("cortical_surface", "white_interface"))
    return float(outside), float(interface)


def growing_ball(
    *, cell_sizes: Sequence[float] = (2.5, 1.75, 1.25), growth: float = 0.02, dolfinx: str | None = None
) -> None:
    """Solve the ball at each cell size.

    dolfinx : also solve it with the dolfinx of this Python, a command
    """
    solvers: dict[str, Callable[[TetMesh, float], FloatArray]] = {"CalculiX": by_calculix, "cortet": by_cortet}
    if dolfinx:
        solvers["dolfinx"] = partial(by_dolfinx, python=shlex.split(dolfinx))
    print("solver     h mm    tets  outside  interface  CPU s")
    print("exact                  " + "{:9.4f}  {:9.4f}".format(*exact(growth, Material())))
    for cell_size in cell_sizes:
        mesh = ball(cell_size)
        for name, solve in solvers.items():
            began = cpu_seconds()
            outside, interface = outward(mesh, solve(mesh, growth))
            print(
                f"{name:9s}  {cell_size:4.2f}  {len(mesh.cells):6d}  {outside:7.4f}  {interface:9.4f}"
                f"  {cpu_seconds() - began:5.0f}",
                flush=True,
            )


# --- imprint of a lattice --------------------------------------------------------------------------------------------

_TURNS = 200
#: shortest reciprocal vectors of a body-centred cubic lattice of constant 1, over 2 pi, one of each opposite pair
_RECIPROCAL = np.array([v for v in product((-1, 0, 1), repeat=3) if np.abs(v).sum() == 2 and v > (0, 0, 0)], float)
#: weeks between the lines of the printed table
_INTERVAL = 2.0


def folded(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Places on the unfolded surface, (s, 3) mm, and the mean curvature gained there, (s,) 1/mm."""
    last = vtu.read(series(folder / SERIES)[-1][0])
    surface, nodes = boundary_surface(last)
    before = surface.points - last.point_data["displacement"][nodes]
    gained = _curvature(surface.points, surface.faces) - _curvature(before, surface.faces)
    return before, np.clip(gained, *np.percentile(gained, [1, 99]))


def _curvature(points: FloatArray, faces: IntArray) -> FloatArray:
    curvature: FloatArray = pyvista.PolyData.from_regular_faces(points, faces).curvature("mean")
    return curvature


def held(places: FloatArray, signal: FloatArray, vectors: FloatArray) -> float:
    """Share of the variance of a signal (s,) that waves of wave vectors (k, 3) hold together."""
    centred = signal - signal.mean()
    waves = np.exp(1j * places @ vectors.T)
    return float(2 * (np.abs(centred @ waves) ** 2).sum() / (len(signal) * (centred**2).sum()))


def periodic(places: FloatArray, signal: FloatArray, constant: float, seed: int = 0) -> str:
    """What the waves of a lattice hold of a signal, against those of the same lattice turned at random."""
    vectors = 2 * np.pi / constant * _RECIPROCAL
    turned = np.array(
        [held(places, signal, turn.apply(vectors)) for turn in Rotation.random(_TURNS, random_state=seed)]
    )
    ours = held(places, signal, vectors)
    return f"{ours / turned.mean():.2f} of turned ones, {(turned > ours).mean():.0%} hold more; {ours:.2%} of variance"


def imprint(lattice_run: Path, other_run: Path, *, cell_size: float) -> None:
    """Compare two runs.

    cell_size : of the lattice, mm
    """
    runs = lattice_run, other_run
    tables = [read_tsv(run / TABLE) for run in runs]
    ages, indices = (
        [table[name].to_numpy(float) for table in tables] for name in ("gestational_age", "gyrification_index")
    )
    print("weeks", *runs, sep="\t")
    for age in np.arange(ages[0][0], min(ages[0][-1], ages[1][-1]) + 1e-9, _INTERVAL):
        print(f"{age:.1f}", *(f"{np.interp(age, *run):.4f}" for run in zip(ages, indices, strict=True)), sep="\t")
    (places, gained), (other_places, other_gained) = map(folded, runs)
    there = other_gained[cKDTree(other_places).query(places)[1]]
    print(f"correlation of gained curvature: {np.corrcoef(gained, there)[0, 1]:.3f}")
    constant = CONSTANT * cell_size
    print(f"lattice run: {periodic(places, gained, constant)}")
    print(f"other run: {periodic(other_places, other_gained, constant)}")
    print(f"other run, at the nodes of the lattice run: {periodic(places, there, constant)}")


main = command(__doc__, strips, yielding, balls, growing_ball, imprint)

if __name__ == "__main__":
    main()
