"""Wavelength of the folds of a growing ball against thickness and stiffness of its cortex.

    python benchmarks/fold_wavelength.py [--nodes 3000] [--thickness 0.1 0.2] [--stiffness 3 24]

A stiff layer of thickness H on a soft core buckles with a wavelength of about 2 pi H (mu_c / 3 mu_s)^(1/3) (Allen
1969); a ball's curvature and the softness of its layer change the factor, not the trend. The ball grows until the
distances of its surface from the centre, divided by those at the start, vary by some per cent; the wavelength is that
of the mean degree of this variation in spherical harmonics, each weighted by its power.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, Delaunay
from scipy.special import sph_harm_y

from cortet.mesh import FloatArray, TetMesh, TriSurface
from cortet.quality import signed_volumes
from cortet.simulation.body import Material, Scale, body_of, smallest_altitude, stable_time_step
from cortet.simulation.contact import contact_of, listed_at
from cortet.simulation.growth import Linear
from cortet.simulation.kernels import DONE, LIST_OUTDATED, State, advance, workspace
from cortet.stages.reconnect import reconnect
from cortet.topology import boundary_faces, boundary_nodes

#: relative variation of the radius at which the wavelength is measured
_AMPLITUDE = 0.03
_MAX_DEGREE = 16


@dataclass(frozen=True)
class Folds:
    """What a ball of radius 1 had become when its folds were measured."""

    time: float
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


def fold_ball(mesh: TetMesh, *, thickness: float, stiffness: float, rate: float = 0.4, end: float = 3.0) -> Folds:
    """Let the cortex of a ball of radius 1 grow until it folds.

    Parameters
    ----------
    thickness : of the cortex
    stiffness : shear modulus of the cortex over that of the core
    rate : of growth; slow, so that a soft core has the time to follow

    Raises
    ------
    RuntimeError : an element inverted, or there were no folds in the end
    """
    material = Material(mu_cortex=1.0, mu_core=1.0 / stiffness)
    body = body_of(mesh, Scale(np.zeros(3), 1.0), thickness=thickness)
    work, state = workspace(body), State(mesh.points.copy(), np.zeros_like(mesh.points))
    contact = contact_of(state.x, boundary_faces(mesh), bulk=material.bulk)
    dt = stable_time_step(smallest_altitude(mesh.points, mesh.cells), material)
    surface = boundary_nodes(mesh)
    step = 0
    while step * dt < end:
        times = (step + np.arange(100)) * dt
        done, how = advance(body, material, state, work, contact, Linear(rate)(times)[:, None], np.zeros(100), dt)
        step += done
        if how == LIST_OUTDATED:
            contact = listed_at(contact, state.x)
        elif how != DONE:
            raise RuntimeError(f"an element inverted at t = {step * dt:.3f}")
        stretch = np.linalg.norm(state.x[surface], axis=1) / np.linalg.norm(mesh.points[surface], axis=1)
        if stretch.std() > _AMPLITUDE * stretch.mean():
            degree = mean_degree(mesh.points[surface], stretch)
            return Folds(step * dt, degree, 2 * np.pi / degree)
    raise RuntimeError(f"no folds until t = {end}")


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
    parser.add_argument("--nodes", type=int, default=3000)
    parser.add_argument("--thickness", nargs="+", type=float, default=[0.1, 0.2])
    parser.add_argument("--stiffness", nargs="+", type=float, default=[3.0, 24.0])
    options = parser.parse_args()
    mesh = ball(options.nodes)
    print(f"{len(mesh.points)} nodes, {len(mesh.cells)} tetrahedra")
    print("thickness  stiffness   time  degree  wavelength  2 pi H (mu_c / 3 mu_s)^(1/3)")
    for thickness in options.thickness:
        for stiffness in options.stiffness:
            found = fold_ball(mesh, thickness=thickness, stiffness=stiffness)
            theory = 2 * np.pi * thickness * (stiffness / 3) ** (1 / 3)
            print(
                f"{thickness:9.3f}  {stiffness:9.1f}  {found.time:5.2f}  {found.degree:6.2f}  {found.wavelength:10.3f}"
                f"  {theory:10.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
