"""Wavelength of the wrinkles of a growing film on a soft base, against its thickness and stiffness.

    python benchmarks/fold_wrinkles.py [--spacing 1] [--thickness 1 2] [--stiffness 8 32]

A film of thickness H and plane-strain modulus E_f on a deep base of modulus E_s, held at its sides, wrinkles with a
wavelength of 2 pi H (E_f / 3 E_s)^(1/3) (Allen 1969), where E = 2 mu / (1 - nu). What folds here is a strip, one layer
of elements wide, that can slide along its sides and its bottom but not leave them. Its surface is displaced at random
by a thousandth of the film's thickness, and grows until it is rough; the wavelength is that of the mean wave number,
each weighted by its power.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np
from cubes import KUHN
from scipy.fft import dct

from cortet.geometry.topology import boundary_faces
from cortet.mesh import FloatArray, TetMesh
from cortet.simulation.body import Material, Scale, body_of, smallest_altitude, stable_time_step
from cortet.simulation.contact import contact_of
from cortet.simulation.kernels import DONE, Motion, advance, workspace

#: time step, in units of the one that a run would take: nothing is compressed much here
TIME_STEP = 3.0
#: of the displacement at first and of the roughness at which the wavelength is measured, in film thicknesses
_SEED, _ROUGHNESS = 1e-3, 0.05
#: time until the film has grown enough to buckle, in wavelengths over the base's shear wave speed: a film that grows
#: fast buckles late, in shorter waves
_PERIODS = 5
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


def wrinkle(mesh: TetMesh, thickness: float, material: Material) -> Wrinkles:
    """Let the film of a strip grow until it wrinkles.

    Raises
    ------
    RuntimeError : an element inverted, or the film stayed flat
    """
    m, n = len(mesh.cells), len(mesh.points)
    body = body_of(mesh, Scale(np.zeros(3), 1.0), thickness=thickness)._replace(
        normals=np.tile([0.0, 0.0, 1.0], (m, 1)), depth=-mesh.points[mesh.cells][:, :, 2].mean(axis=1)
    )
    x, y, z = mesh.points.T
    held = [(x == 0) | (x == x.max()), np.full(n, True), z == z.min()]
    work, state = workspace(body), Motion(mesh.points.copy(), np.zeros((n, 3)))
    state.x[~held[2], 2] += _SEED * thickness * np.random.default_rng(0).normal(size=(~held[2]).sum())
    contact = contact_of(mesh.points, boundary_faces(mesh), bulk=material.bulk)._replace(radius=np.inf)
    dt = TIME_STEP * stable_time_step(smallest_altitude(mesh.points, mesh.cells), material)
    wavelength, buckling = theory(thickness, material)
    buckles_at = _PERIODS * wavelength * np.sqrt(material.density / material.mu_core) / dt
    surface = np.flatnonzero((z == 0) & (y == 0))
    for step in range(int(4 * buckles_at)):
        growth = buckling * step / buckles_at
        if advance(body, material, state, work, contact, np.array([[growth]]), np.zeros(1), dt) != (1, DONE):
            raise RuntimeError(f"an element inverted at a growth of {growth:.3f}")
        for axis, nodes in enumerate(held):
            state.x[nodes, axis] = mesh.points[nodes, axis]
            state.v[nodes, axis] = 0
        heights = state.x[surface, 2]
        if heights.std() > _ROUGHNESS * thickness:
            return Wrinkles(growth, mean_wavelength(heights, x.max()), heights)
    raise RuntimeError(f"the film was flat at a growth of {growth:.3f}")


def mean_wavelength(heights: FloatArray, length: float) -> float:
    """Wavelength of the power-weighted mean wave number of equally spaced heights (k,) along a length."""
    power = dct(heights, type=1)[1:] ** 2  # the first is the mean height
    return float(2 * length * power.sum() / (power * np.arange(1, len(heights))).sum())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spacing", type=float, default=1.0)
    parser.add_argument("--thickness", nargs="+", type=float, default=[1.0, 2.0])
    parser.add_argument("--stiffness", nargs="+", type=float, default=[8.0, 32.0])
    options = parser.parse_args()
    print("thickness  stiffness    tets  growth  wavelength  theory  quotient  CPU s")
    for thickness in options.thickness:
        for stiffness in options.stiffness:
            mesh, material = strip(120.0, 40.0, thickness, options.spacing), material_of(stiffness)
            began = time.process_time()
            found = wrinkle(mesh, thickness, material)
            seconds, expected = time.process_time() - began, theory(thickness, material)[0]
            print(
                f"{thickness:9.2f}  {stiffness:9.1f}  {len(mesh.cells):6d}  {found.growth:6.3f}"
                f"  {found.wavelength:10.2f}  {expected:6.2f}  {found.wavelength / expected:8.2f}  {seconds:5.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
