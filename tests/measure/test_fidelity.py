"""Distances, volume, area and roughness on bodies where they are known."""

from __future__ import annotations

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_surface

from cortet.geometry.topology import boundary_surface
from cortet.measure.fidelity import boundary_roughness, fidelity, high_frequency_roughness
from cortet.meshes import TetMesh, TriSurface


def test_a_mesh_is_faithful_to_its_own_boundary():
    mesh = cube_mesh(4, side=10.0)
    surface, _ = boundary_surface(mesh)
    found = fidelity(mesh, surface)
    assert found.nodes_to_surface_mm.max < 1e-12
    assert found.face_centres_to_surface_mm.max < 1e-12
    assert found.surface_to_boundary_mm.max < 1e-12
    assert found.nodes_to_nearest_vertex_mm.max == 0
    assert found.volume_ml == pytest.approx(1.0)
    assert found.area_mm2 == pytest.approx(600.0)
    assert found.relative_volume_change == pytest.approx(0, abs=1e-12)
    assert found.roughness == found.surface_roughness


def test_a_cube_beside_a_smaller_and_a_coarser_cube():
    mesh = cube_mesh(4, side=10.0)
    outer, _ = boundary_surface(mesh)
    inner = TriSurface((outer.points - 5) * 0.8 + 5, outer.faces)  # 1 mm inside every face
    found = fidelity(mesh, inner)
    assert found.relative_volume_change == pytest.approx(1 / 0.8**3 - 1)
    assert found.relative_area_change == pytest.approx(1 / 0.8**2 - 1)
    # from inside, the farthest point is 1 mm off; from outside, the corners are sqrt(3) mm off
    assert found.surface_to_boundary_mm.max == pytest.approx(1.0)
    assert found.nodes_to_surface_mm.max == pytest.approx(np.sqrt(3))
    coarse, _ = boundary_surface(cube_mesh(1, side=10.0))  # the same cube with its 8 corners only
    found = fidelity(mesh, coarse)
    assert found.nodes_to_surface_mm.max < 1e-12
    assert found.nodes_to_nearest_vertex_mm.max == pytest.approx(np.hypot(5, 5))  # centre of a face to its corners


def test_face_centres_show_what_a_coarse_boundary_cuts_off():
    sphere = ball_surface(subdivisions=4, radius=10.0)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) * 10 / np.sqrt(3)
    found = fidelity(TetMesh(corners, [[0, 2, 1, 3]]), sphere)
    assert found.nodes_to_surface_mm.max < 0.1  # all four nodes lie on the sphere ...
    assert found.face_centres_to_surface_mm.mean == pytest.approx(10 * 2 / 3, rel=0.01)  # ... the faces far inside
    assert found.relative_volume_change < -0.8
    # a corner of a regular tetrahedron is 4/3 of the circumradius above the mean of the other three
    assert found.roughness == pytest.approx(4 / 3 * np.sqrt(3) / np.sqrt(8))


@pytest.mark.parametrize("measure", [boundary_roughness, high_frequency_roughness])
def test_roughness_is_relative_to_the_edges_and_rises_with_noise(measure):
    sphere = ball_surface(subdivisions=4)
    smooth = measure(sphere.points, sphere.faces)
    assert measure(10 * sphere.points, sphere.faces) == pytest.approx(smooth)
    noise = np.random.default_rng(0).normal(0, 0.1, sphere.points.shape)
    assert measure(sphere.points + noise, sphere.faces) > 2 * smooth


def test_roughness_of_high_frequency_tells_noise_from_curvature():
    ball = ball_surface(4, 20.0)
    wavy = ball.points * (1 + 0.05 * np.sin(4 * ball.points[:, :1] / 20))
    assert high_frequency_roughness(ball.points, ball.faces) < 0.005
    assert high_frequency_roughness(wavy, ball.faces) < 0.01
