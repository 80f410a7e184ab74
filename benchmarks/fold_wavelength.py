"""Wavelength of the folds of a growing ball against thickness and stiffness of its cortex.

    python benchmarks/fold_wavelength.py [--nodes 12000] [--thickness 0.12 0.18] [--stiffness 4 16]

A flat layer would buckle as `fold_wrinkles` says; a ball's curvature changes the factor, not the trend. The ball grows
until the distances of its surface from the centre, divided by those at the start, vary by some per cent; the wavelength
is that of the mean degree of this variation in spherical harmonics, each weighted by its power.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from fold_wrinkles import TIME_STEP, theory
from scipy.spatial import ConvexHull, Delaunay
from scipy.special import sph_harm_y

from cortet.geometry.topology import boundary_faces, boundary_nodes
from cortet.measure.quality import signed_volumes
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.simulation.altitude import smallest_altitude
from cortet.simulation.body import Material, Scale, body_of, stable_time_step
from cortet.simulation.contact import contact_of, listed_at
from cortet.simulation.growth import Linear
from cortet.simulation.kernels import DONE, LIST_OUTDATED, Motion, advance, workspace
from cortet.simulation.models import course
from cortet.stages.reconnect import reconnect

#: relative variation of the radius at which the wavelength is measured
_AMPLITUDE = 0.03
_MAX_DEGREE = 16
#: time until the cortex has grown enough to buckle, in wavelengths over the core's shear wave speed
_PERIODS = 2
_LARGEST_GROWTH = 1.5


@dataclass(frozen=True)
class Folds:
    """What a ball of radius 1 had become when its folds were measured."""

    growth: float
    #: power-weighted mean degree of the spherical harmonics, and the wavelength 2 pi / degree
    degree: float
    wavelength: float


def ball(nodes: int) -> TetMesh:
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
    dt = TIME_STEP * stable_time_step(smallest_altitude(mesh.points, mesh.cells), material)
    wavelength, buckling = theory(thickness, material)
    rate = buckling / (_PERIODS * wavelength * np.sqrt(material.density / material.mu_core))
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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", type=int, default=12000)
    parser.add_argument("--thickness", nargs="+", type=float, default=[0.12, 0.18])
    parser.add_argument("--stiffness", nargs="+", type=float, default=[4.0, 16.0])
    options = parser.parse_args()
    mesh = ball(options.nodes)
    print(f"{len(mesh.points)} nodes, {len(mesh.cells)} tetrahedra")
    print("thickness  stiffness  growth  degree  wavelength  theory  quotient  CPU s")
    for thickness in options.thickness:
        for stiffness in options.stiffness:
            began = time.process_time()
            found = fold_ball(mesh, thickness, stiffness)
            seconds = time.process_time() - began
            flat = theory(thickness, Material(mu_core=1 / stiffness))[0]
            print(
                f"{thickness:9.3f}  {stiffness:9.1f}  {found.growth:6.3f}  {found.degree:6.2f}"
                f"  {found.wavelength:10.3f}  {flat:6.3f}  {found.wavelength / flat:8.2f}  {seconds:5.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
