"""What a fold takes off its surface before it begins: short waves, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import Delaunay
from shapes import ball_surface

from cortet.config.fold import Settings
from cortet.folding.ripples import without_ripples
from cortet.folding.run import beginning, millimetres, prepared
from cortet.geometry.topology import boundary_nodes
from cortet.measure.quality import signed_volumes
from cortet.meshes import FloatArray, TetMesh

RADIUS, HEIGHT = 30.0, 0.3


@pytest.fixture(scope="module")
def ball() -> TetMesh:
    """Fine at its surface (edges of 1.1 mm), coarse inside."""
    shells = [ball_surface(*of).points for of in ((5, RADIUS), (4, RADIUS - 1.5), (3, RADIUS - 4), (2, RADIUS - 10))]
    points = np.vstack([*shells, np.zeros((1, 3))])
    cells = Delaunay(points).simplices
    volumes = signed_volumes(points, cells)
    cells[volumes < 0] = cells[volumes < 0][:, [1, 0, 2, 3]]
    return TetMesh(points, cells[np.abs(volumes) > 1e-6].astype(np.int32))


def rippled(mesh: TetMesh, degree: int) -> TetMesh:
    """The ball with a wave along its meridians: a Legendre polynomial, of wavelength 2 pi R / degree."""
    radius = np.linalg.norm(mesh.points, axis=1, keepdims=True)
    wave = legendre(mesh.points, degree) * (radius / RADIUS) ** degree
    return replace(mesh, points=mesh.points * (1 + HEIGHT / RADIUS * wave))


def legendre(points: FloatArray, degree: int) -> FloatArray:
    height = points[:, 2:] / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
    return np.polynomial.legendre.legval(height, np.eye(degree + 1)[degree])


@pytest.mark.parametrize("degree", [8, 24])
def test_a_wave_keeps_what_the_filter_lets_through(ball, degree):
    length, nodes = 2.0, boundary_nodes(ball)
    found = np.linalg.norm(without_ripples(rippled(ball, degree), length)[nodes], axis=1) - RADIUS
    wave = legendre(ball.points[nodes], degree)[:, 0]
    kept = (found - found.mean()) @ wave / (wave @ wave) / HEIGHT
    flow = (1 + degree * (degree + 1) / RADIUS**2 * length**2 / 8) ** -4
    assert kept == pytest.approx(2 * flow - flow**2, abs=0.03)


def test_fixed_nodes_stay_and_a_ball_stays_a_ball(ball):
    rough = rippled(ball, 32)
    fixed = np.zeros(len(ball.points), bool)
    fixed[boundary_nodes(ball)] = ball.points[boundary_nodes(ball), 0] > 10
    moved = without_ripples(rough, 1.0, fixed)
    assert np.array_equal(moved[fixed], rough.points[fixed]) and not np.array_equal(moved, rough.points)
    assert np.abs(without_ripples(ball, 1.0) - ball.points).max() < 2e-3


def test_no_tetrahedron_is_flattened(ball):
    """Dents and spikes of an edge's height."""
    points, nodes = ball.points.copy(), boundary_nodes(ball)
    points[nodes[::40]] *= 1.03
    points[nodes[20::40]] *= 0.99
    spiky = replace(ball, points=points)
    before = signed_volumes(spiky.points, spiky.cells)
    assert (before > 0).all()
    after = signed_volumes(without_ripples(spiky, 3.0), spiky.cells)
    assert (after >= before / 2).all() and (after < 0.6 * before).any()


def test_a_fold_begins_without_ripples_and_its_frames_with_the_users_mesh(ball):
    rough = rippled(ball, 32)
    settings = Settings(gestational_age=22.0, end=23.0)
    run = prepared(rough, settings)
    start = millimetres(run, beginning(run))
    assert np.allclose(run.mesh.points[np.argsort(run.node)], rough.points)
    assert np.allclose(start, without_ripples(run.mesh, 1.0), atol=1e-12)
    for without in ({"smoothing": 0.0}, {"model": "braingrowth"}):
        assert np.array_equal(prepared(rough, settings.with_keys(**without)).points, run.mesh.points)
