"""Local reconnection on cavities small enough to know the answer, and on a ball."""

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.geometry import topology
from cortet.geometry.closest_point import surface_tree
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise.star import mu2_of
from cortet.optimise.swaps import improve, live_cells, swappable

SPHERE = ball_surface(2, 1.0)
TREE = surface_tree(SPHERE.points, SPHERE.faces)


def ring(n: int, height: float, radius: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """n tetrahedra around the edge between two poles."""
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(n)], axis=1)
    points = np.vstack([[[0, 0, -height], [0, 0, height]], rim])
    cells = np.array([[0, 1, 2 + i, 2 + (i + 1) % n] for i in range(n)])
    return points, cells


def swap(points, cells, threshold=0.0, *, region=None, boundary=False, tree=TREE):
    region = np.zeros(len(cells), np.int32) if region is None else region
    mesh = TetMesh(points, cells)
    held = np.full(len(points), not boundary)
    work = swappable(mesh, mu2_of(quality(mesh.points, mesh.cells)), region, held)
    count = improve(work, tree, mu2_of(threshold))
    cells, neighbours, origin = live_cells(work)
    assert np.array_equal(neighbours, topology.neighbours(TetMesh(points, cells))), "neighbours kept up to date"
    return cells, origin, count


def test_three_around_an_edge_become_two_when_that_is_better():
    points, cells = ring(3, height=2**0.5)
    new, _, count = swap(points, cells)
    assert (len(new), count.edge_removals) == (2, 1)
    assert quality(points, new) == pytest.approx([0, 0], abs=1e-12)
    assert quality(points, cells).min() > 0.3
    assert signed_volumes(points, new).sum() == pytest.approx(signed_volumes(points, cells).sum())


def test_two_across_a_face_become_three_when_that_is_better():
    points, three = ring(3, height=0.1)
    two = np.array([[2, 3, 4, 1], [2, 4, 3, 0]])
    new, _, count = swap(points, two)
    assert (len(new), count.face_removals) == (3, 1)
    assert sorted(map(sorted, new.tolist())) == sorted(map(sorted, three.tolist()))


def test_four_around_an_edge_are_turned_to_the_better_axis():
    points, cells = ring(4, height=1.0)
    points[[2, 4]] *= 0.3  # the ring is a slim diamond: its short diagonal is the better edge
    new, _, count = swap(points, cells)
    assert (len(new), count.edge_removals) == (4, 1)
    assert all({2, 4} <= set(cell) for cell in new.tolist())
    assert quality(points, new).max() < quality(points, cells).max()


@pytest.mark.parametrize("n", [5, 7])
def test_edge_removal_finds_the_best_triangulation_of_larger_rings(n):
    points, cells = ring(n, height=2.0)
    points[2:] += np.random.default_rng(n).uniform(-0.1, 0.1, (n, 3))
    new, _, _ = swap(points, cells)
    assert len(new) == 2 * (n - 2)

    def worst(i, j):  # of the polygon i..j, by trying everything
        if j - i < 2:
            return 0.0
        return min(
            max(worst(i, k), worst(k, j), *quality(points, np.array([[i, k, j, 1], [i, j, k, 0]])))
            for k in range(i + 1, j)
        )

    assert quality(points, new).max() == pytest.approx(worst(2, n + 1))


def test_good_elements_and_other_regions_are_left_alone():
    points, cells = ring(3, height=0.8)
    assert len(swap(points, cells, threshold=0.9)[0]) == 3
    assert len(swap(points, cells, region=np.array([0, 0, 1], np.int32))[0]) == 3


def flat_corner() -> tuple[np.ndarray, np.ndarray]:
    """A wedge of two tetrahedra below z = 0 and, on top of them, a flat one alone on its upper edge (0, 1)."""
    points = np.array([[-1, 0, 0.05], [1, 0, 0.05], [0, -1, 0], [0, 1, 0], [-0.1, 0, -1.2], [0.1, 0, -1.2]])
    flat = [[0, 1, 2, 3]]
    below = [[2, 3, 0, 4], [3, 2, 1, 5], [2, 3, 4, 5]]
    cells = np.array(flat + below)
    negative = signed_volumes(points, cells) < 0
    cells[negative] = cells[negative][:, [1, 0, 2, 3]]
    return points, cells


def test_a_flat_boundary_tetrahedron_is_peeled_off_and_its_volume_reported():
    points, cells = flat_corner()
    new, _, count = swap(points, cells, threshold=0.8, boundary=False)
    assert count.peeled == count.boundary_flips == 0 and len(new) == 4, "held vertices"
    surface = surface_tree(points, topology.boundary_faces(TetMesh(points, cells)))
    new, _, count = swap(points, cells, threshold=0.8, boundary=True, tree=surface)
    assert (len(new), count.peeled, count.boundary_flips) == (3, 1, 0)
    lost = signed_volumes(points, cells).sum() - signed_volumes(points, new).sum()
    assert lost > 0.03 and count.volume_cut == pytest.approx(lost)
    assert topology.surface_topology(topology.boundary_faces(TetMesh(points, new))).is_closed_manifold


@pytest.mark.parametrize("boundary", [False, True])
def test_a_ball_improves_and_keeps_vertices_volume_and_topology(boundary):
    mesh = ball_mesh()
    new, origin, count = swap(mesh.points, mesh.cells, threshold=0.3, boundary=boundary)
    result = TetMesh(mesh.points, new)
    before, after = (quality(m.points, m.cells) for m in (mesh, result))
    assert (after > 0.5).sum() < (before > 0.5).sum() and after.max() <= before.max()
    assert np.array_equal(np.unique(new), np.arange(len(mesh.points)))
    assert topology.surface_topology(topology.boundary_faces(result)).euler_number == 2
    assert (signed_volumes(result.points, new) > 0).all()
    volumes = [signed_volumes(m.points, m.cells).sum() for m in (mesh, result)]
    assert volumes[0] - volumes[1] == pytest.approx(count.volume_cut, abs=1e-12)
    if not boundary:
        assert count.volume_cut == 0
    assert origin.max() < len(mesh.cells)
    unchanged = new[(np.sort(new, 1) == np.sort(mesh.cells[origin], 1)).all(axis=1)]
    assert len(unchanged) > len(new) / 4
