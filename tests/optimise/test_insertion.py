"""New vertices inside, where no swap helps."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_mesh

from cortet.geometry import topology
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise.insertion import insert_vertices
from cortet.optimise.star import MU2, empty_star, find_mu2, mu2_of, set_column

#: four tetrahedra around a long edge: whatever swaps do with the six points, they stay long
SPINDLE = np.array([[0, 0, -2.0], [0, 0, 2.0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
AROUND = np.array([[0, 1, 2, 3], [0, 1, 3, 4], [0, 1, 4, 5], [0, 1, 5, 2]], np.int32)


def inserted(mesh: TetMesh, threshold: float, region=None):
    """The mesh, which says of each node and tetrahedron which one it was or comes from, and the number inserted."""
    region = np.zeros(len(mesh.cells), np.int32) if region is None else region
    mu2 = np.asarray(mu2_of(quality(mesh.points, mesh.cells)))
    nodes, cells = {"like": np.arange(len(mesh.points))}, {"origin": np.arange(len(mesh.cells))}
    traced = replace(mesh, point_data=nodes, cell_data=cells)
    made, count = insert_vertices(traced, mu2, region, float(mu2_of(threshold)))
    fresh = TetMesh(made.points, made.cells.copy())
    assert np.array_equal(topology.neighbours(made), topology.neighbours(fresh)), "neighbours kept up to date"
    return made, count


def test_a_vertex_halves_a_long_edge_in_its_middle():
    mesh = TetMesh(SPINDLE, AROUND)
    made, count = inserted(mesh, 0.3)
    like, origin = made.point_data["like"], made.cell_data["origin"]
    assert count == 1 and len(made.cells) == 8 and np.array_equal(made.points[:6], SPINDLE)
    assert made.points[6] == pytest.approx([0, 0, 0], abs=1e-12)
    assert signed_volumes(made.points, made.cells).sum() == pytest.approx(signed_volumes(SPINDLE, AROUND).sum())
    assert quality(made.points, made.cells).max() < quality(SPINDLE, AROUND).max()
    assert np.array_equal(like[:6], np.arange(6)) and like[6] in range(6) and set(origin) <= set(range(4))


@pytest.mark.parametrize("height", [1e-170, 0.0, -1.0])
def test_a_tetrahedron_whose_squared_volume_is_zero_is_infinitely_bad(height):
    star = empty_star()
    set_column(star, 0, *[1.0, 0, 0], *[0, 1.0, 0], *[0, 0, height])
    find_mu2(star, 1, 0.0, 0.0, 0.0)
    assert star[MU2] == np.inf


def test_nothing_is_inserted_where_nothing_would_be_better_unless_that_is_asked_for():
    flat = TetMesh(np.array([[0, 0, 0], [1, 0, 0.0], [0, 1, 0], [0.3, 0.3, 0.1]]), np.array([[0, 1, 2, 3]], np.int32))
    good = TetMesh(SPINDLE * [1, 1, 0.4], AROUND)
    for mesh in (flat, good):
        made, count = inserted(mesh, 0.3)
        assert count == 0 and np.array_equal(made.points, mesh.points) and np.array_equal(made.cells, mesh.cells)
    _, count = inserted(TetMesh(SPINDLE, AROUND), 0.3, np.array([0, 0, 1, 1], np.int32))
    assert count == 0, "the long edge lies in the interface of two regions"
    mu2, region, threshold = np.asarray(mu2_of(quality(good.points, good.cells))), np.zeros(4, np.int32), mu2_of(0.05)
    assert insert_vertices(good, mu2, region, float(threshold))[1] == 0
    made, count = insert_vertices(good, mu2, region, float(threshold), gain=3.0)  # it may get worse at first
    assert count > 0 and quality(made.points, made.cells).max() > quality(good.points, good.cells).max()


def test_the_boundary_and_the_volume_stay():
    mesh = ball_mesh()
    made, count = inserted(mesh, 0.3)
    points, cells, like = made.points, made.cells, made.point_data["like"]
    assert count > 0 and (signed_volumes(points, cells) > 0).all()
    assert signed_volumes(points, cells).sum() == pytest.approx(signed_volumes(mesh.points, mesh.cells).sum())
    assert np.array_equal(np.unique(cells), np.arange(len(points)))
    before, after = topology.boundary_faces(mesh), topology.boundary_faces(made)
    assert {tuple(sorted(face)) for face in before.tolist()} == {tuple(sorted(face)) for face in like[after].tolist()}
    assert quality(points, cells).max() <= quality(mesh.points, mesh.cells).max()
