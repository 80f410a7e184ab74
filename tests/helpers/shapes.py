"""Small surfaces and meshes that several tests share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import Delaunay

from cortet.formats.gifti import read_surface
from cortet.measure.quality import signed_volumes
from cortet.meshes import TetMesh, TriSurface


def ball_surface(subdivisions: int = 3, radius: float = 5.0) -> TriSurface:
    """A sphere about the origin, in mm."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return TriSurface(sphere.vertices, sphere.faces)


def real_surface(name: str) -> TriSurface:
    """A surface of a real brain in `../shared/data`; the test is skipped where that is not."""
    path = Path(__file__).parents[2] / f"../shared/data/{name}.surf.gii"
    if not path.exists():
        pytest.skip(f"needs ../shared/data/{name}.surf.gii")
    return read_surface(path)


def torus(major: float, minor: float, **sections: int) -> TriSurface:
    """A ring about the z axis, its radii in mm."""
    shape = trimesh.creation.torus(major, minor, **sections)
    return TriSurface(shape.vertices, shape.faces)


def one_sided() -> TriSurface:
    """A Klein bottle of 40 by 20 quads: closed, but without an inside."""
    u, v = (w.ravel() for w in np.meshgrid(np.arange(40), np.arange(20), indexing="ij"))

    def index(i, j):
        return i % 40 * 20 + np.where(i >= 40, -j, j) % 20

    quad = [index(u, v), index(u + 1, v), index(u + 1, v + 1), index(u, v + 1)]
    faces = np.concatenate([np.stack([quad[0], quad[1], quad[2]], 1), np.stack([quad[0], quad[2], quad[3]], 1)])
    a, b = u * np.pi / 20, v * np.pi / 10
    radius = 20 + 6 * np.cos(b)
    return TriSurface(np.c_[radius * np.cos(a), radius * np.sin(a), 6 * np.sin(b) * np.cos(a / 2)], faces)


def can(sides: int, rings: int = 1, hub: float = 0.0) -> TriSurface:
    """A closed cylinder of radius 25 mm and length 60 mm; each end is a fan of `sides` triangles around one vertex.

    Parameters
    ----------
    rings : number of bands of triangles along it
    hub : mm, distance of the vertices of the fans from the axis
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.column_stack([25 * np.cos(angle), 25 * np.sin(angle), np.zeros(sides)])
    height = np.array([0, 0, 60.0])
    points = [*(circle + height * ring / rings for ring in range(rings + 1)), [[hub, 0, 0]], [[hub, 0, 60.0]]]
    a, last = np.arange(sides), sides * rings
    b = np.roll(a, -1)
    faces = [
        np.column_stack([b, a, np.full(sides, last + sides)]),
        np.column_stack([a + last, b + last, np.full(sides, last + sides + 1)]),
    ]
    for low in range(0, last, sides):
        faces += [np.column_stack([a, b, b + sides]) + low, np.column_stack([a, b + sides, a + sides]) + low]
    return TriSurface(np.concatenate(points), np.concatenate(faces).astype(np.int32))


def horseshoe(gap: float, ring: float = 5.0, tube: float = 2.0, sections: int = 60, sides: int = 24) -> TriSurface:
    """A ring (radii in mm) cut open: genus 0, its flat ends facing each other across `gap` mm, like a sulcus."""
    opening = gap / ring
    along = np.linspace(opening / 2, 2 * np.pi - opening / 2, sections)[:, None]
    around = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    radius = ring + tube * np.cos(around)
    height = np.broadcast_to(tube * np.sin(around), (sections, sides))
    points = np.stack([radius * np.cos(along), radius * np.sin(along), height], axis=2).reshape(-1, 3)
    ends = np.c_[ring * np.cos(along[[0, -1]]), ring * np.sin(along[[0, -1]]), [0, 0]]
    i, j = (x.ravel() for x in np.meshgrid(np.arange(sections - 1), np.arange(sides), indexing="ij"))
    a, b = i * sides + j, i * sides + (j + 1) % sides
    k, last, first_cap, last_cap = np.arange(sides), (sections - 1) * sides, sections * sides, sections * sides + 1
    caps = [
        np.stack([np.full(sides, first_cap), k, (k + 1) % sides], axis=1),
        np.stack([np.full(sides, last_cap), last + (k + 1) % sides, last + k], axis=1),
    ]
    walls = [np.stack([a, a + sides, b], axis=1), np.stack([b, a + sides, b + sides], axis=1)]
    return TriSurface(np.concatenate([points, ends]), np.concatenate(walls + caps))


def bowl(thickness: float, radius: float = 5.0) -> TriSurface:
    """A bowl of an opening of 72 degrees, `thickness` mm thick: genus 0, its sides cross when triangles are coarse."""
    ball = ball_surface(5, radius=1.0)
    polar = np.arccos(np.clip(ball.points[:, 2], -1, 1))
    around = np.arctan2(ball.points[:, 1], ball.points[:, 0])
    side = np.sign(np.round(np.pi / 2 - polar, 9))  # 1 outside, -1 inside, 0 on the rim
    angle = 0.8 * np.pi * np.minimum(polar, np.pi - polar) / (np.pi / 2)
    r = radius + side * thickness / 2
    points = np.c_[np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), -np.cos(angle)] * r[:, None]
    return TriSurface(points, ball.faces)


def ball_mesh(subdivisions: int = 2, radius: float = 1.0) -> TetMesh:
    """The inside of `ball_surface`, filled with jittered grid points: valid, with bad tetrahedra."""
    skin = ball_surface(subdivisions, radius).points
    spacing = 1.1 * radius / 2**subdivisions
    axis = np.arange(-radius, radius, spacing)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = grid + np.random.default_rng(0).uniform(-0.25, 0.25, grid.shape) * spacing
    points = np.vstack([skin, grid[np.linalg.norm(grid, axis=1) < radius - 0.7 * spacing]])
    cells = Delaunay(points).simplices
    volumes = signed_volumes(points, cells)
    cells[volumes < 0] = cells[volumes < 0][:, [1, 0, 2, 3]]
    return TetMesh(points, cells[np.abs(volumes) > 1e-6 * spacing**3])


def shell_mesh(outer: float, inner: float, across: int, subdivisions: int = 3) -> TetMesh:
    """The shell between two spheres of these radii, mm: prisms on the triangles of an icosphere, three cells each."""
    ball = ball_surface(subdivisions, 1.0)
    count = len(ball.points)
    radii = np.linspace(inner, outer, across + 1)
    points = np.concatenate([radius * ball.points for radius in radii])
    low, middle, high = np.sort(ball.faces, axis=1).T  # so that prisms that share a side cut it alike
    cells = []
    for below in count * np.arange(across):
        a, b, c, d, e, f = (corner + below + up for up in (0, count) for corner in (low, middle, high))
        cells += [np.stack([a, b, c, f], 1), np.stack([a, b, e, f], 1), np.stack([a, d, e, f], 1)]
    cells = np.concatenate(cells)
    wrong = signed_volumes(points, cells) < 0
    cells[wrong] = cells[wrong][:, [1, 0, 2, 3]]
    return TetMesh(points, cells)
