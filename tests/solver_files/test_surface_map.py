"""Values go between a mesh and the surface it was made from: exactly where triangles are the same, nearby elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_surface

import cortet
from cortet.errors import InputError
from cortet.geometry.closest_point import closest_points, tree_of
from cortet.geometry.topology import boundary_nodes, boundary_surface
from cortet.meshes import TriSurface, single_precision
from cortet.solver_files.surface_map import surface_map

RADIUS = 14.0
UNSMOOTHED = {"smooth_surface": {"enabled": False}}
#: mm
EXACT = 1e-9


@pytest.fixture(scope="module")
def ball() -> TriSurface:
    return single_precision(ball_surface(3, RADIUS))


@pytest.fixture(scope="module")
def made(ball: TriSurface) -> cortet.Mesh:
    return cortet.mesh(ball, cell_size=3.0, settings=UNSMOOTHED, progress=False)


def test_coordinates_come_exactly_from_the_surface(made, ball):
    nodes = boundary_nodes(made.mesh)
    found = made.from_surface(ball.points)
    assert np.abs(found[nodes] - made.points[nodes]).max() < EXACT
    inside = np.setdiff1d(np.arange(len(made.points)), nodes)
    assert len(inside) and np.isnan(found[inside]).all()


def test_a_linear_field_comes_exactly_to_the_surface(made, ball):
    boundary, _ = boundary_surface(made.mesh)
    nearest = closest_points(tree_of(boundary), ball.points).points
    assert np.abs(made.to_surface(made.points) - nearest).max() < EXACT
    assert np.abs(made.to_surface(made.points @ [1, 2, 3] + 4) - (nearest @ [1, 2, 3] + 4)).max() < EXACT
    assert made.surface_map().kept.all()


def test_values_of_elements_are_averaged_by_volume(made, ball):
    assert made.to_surface(np.full((len(made.cells), 2), 3.0)) == pytest.approx(np.full((len(ball.points), 2), 3.0))
    heights = made.points[made.cells].mean(axis=1)[:, 2]
    assert np.abs(made.to_surface(heights) - ball.points[:, 2]).mean() < 1.5
    mesh = cube_mesh(1)
    corners, found = surface_map(mesh, boundary_surface(mesh)[0], boundary_surface(mesh)[0]).corners
    assert np.array_equal(corners, mesh.cells)  # a single region
    around = (mesh.cells == 0).any(axis=1)
    volumes = np.abs(np.linalg.det(np.diff(mesh.points[mesh.cells], axis=1))) * around
    assert found.toarray()[0] == pytest.approx(volumes / volumes.sum())


def test_labels_are_never_averaged(made):
    labels = np.where(made.points[:, 0] > 0, 7, 2).astype(np.int32)
    found = made.to_surface(labels)
    assert found.dtype == np.int32 and set(found.tolist()) == {2, 7}
    inside = made.from_surface(np.full(len(found), 5, np.int32))
    assert np.isnan(inside).any() and set(inside[~np.isnan(inside)]) == {5}
    of_cells = np.where(made.points[made.cells].mean(axis=1)[:, 0] > 0, 7, 2)
    assert np.array_equal(made.to_surface(of_cells), of_cells[made.surface_map().nearest.cells])
    for depth in (None, 1.0, (0.0, 4.0)):
        assert set(made.to_surface(of_cells, depth=depth).tolist()) == {2, 7}


def test_values_of_a_region_are_averaged_within_it(ball):
    inner = single_precision(ball_surface(3, 12.0))
    made = cortet.mesh(ball, cell_size=3.0, inner={"white": inner}, settings=UNSMOOTHED, progress=False)
    values = np.where(made.mesh.cell_data["region"] == 1, 100.0, -100.0)
    for depth in (None, 0.5, (0.5, 1.5)):
        assert made.to_surface(values, depth=depth) == pytest.approx(100)
    assert made.to_surface(values, region="white") == pytest.approx(-100)
    assert np.abs(made.to_surface(values, depth=(0.0, 4.0))).mean() < 15  # half of it lies in each


def test_depth_is_below_the_surface(made, ball):
    radius = np.linalg.norm(made.points, axis=1)
    for depth in (1.0, 4.0):
        assert np.abs(made.to_surface(radius, depth=depth) - (RADIUS - depth)).max() < 0.4
        there = made.surface_map()
        below = there.points - depth * there.normals
        assert np.abs(below - (1 - depth / RADIUS) * ball.points).max() < 0.06
        assert np.abs(made.to_surface(made.points, depth=depth) - below).max() < EXACT
    assert np.abs(made.to_surface(radius, depth=(1.0, 3.0)) - (RADIUS - 2)).max() < 0.3
    assert np.isnan(made.to_surface(radius, depth=3 * RADIUS)).all()
    partly = made.to_surface(made.points, depth=(2 * RADIUS - 2, 2 * RADIUS + 10))
    assert np.nanmax(np.linalg.norm(partly, axis=1)) < RADIUS and not np.isnan(partly).all()


@pytest.mark.parametrize("depth", [-1.0, np.nan, np.inf, (3.0, 1.0), np.ones(7), (0.0, np.ones(7)), (1, 2, 3), "deep"])
def test_what_is_no_depth_is_refused(made, depth):
    with pytest.raises(InputError, match="depth"):
        made.to_surface(made.points, depth=depth)


@pytest.mark.parametrize("values", [3.0, None, [[1.0], [1.0, 2.0]], ["a"], [1j], np.ones((2, 2, 2)), [1.0, 2.0, 3.0]])
def test_what_is_no_list_of_numbers_of_the_mesh_or_the_surface_is_refused(made, values):
    for there in (made.to_surface, made.from_surface):
        with pytest.raises(InputError, match="numbers|3 values"):
            there(values)
    with pytest.raises(InputError, match="white"):
        made.to_surface(made.points, region="white")


def test_smoothed_vertices_are_known_by_number_however_far_they_went(made, ball):
    """An inflated surface has the values of the folded one."""
    inflated = surface_map(made.mesh, made.surface, replace(ball, points=3 * ball.points + 50))
    own = made.surface_map()
    for name in ("to_surface", "from_surface"):
        assert abs(getattr(inflated, name) - getattr(own, name)).max() < EXACT
    assert inflated.kept.all()
    smoothed = cortet.mesh(ball, cell_size=3.0, ga=24, progress=False)
    assert smoothed.surface_map().kept.all()
    assert np.array_equal(smoothed.surface_map().points, smoothed.surface.points)


def test_a_repaired_surface_works_by_the_closest_point_where_it_changed(ball):
    broken = replace(ball, faces=ball.faces[6:])
    made = cortet.mesh(broken, cell_size=3.0, settings={**UNSMOOTHED, "repair": {"enabled": True}}, progress=False)
    found = made.surface_map()
    assert np.abs(made.to_surface(made.points) - ball.points).max() < 0.6
    whole = np.bincount(ball.faces[6:].ravel(), minlength=642) == np.bincount(ball.faces.ravel(), minlength=642)
    assert found.kept.sum() > 600 and np.isfinite(found.points).all() and found.kept[whole].mean() > 0.95
    nodes = boundary_nodes(made.mesh)
    assert np.abs(made.from_surface(ball.points)[nodes] - made.points[nodes]).max() < 1.0
