"""New vertices inside, where no swap helps."""

import numpy as np
import pytest
from shapes import ball_mesh

from cortet.geometry import topology
from cortet.measure.quality import quality, signed_volumes
from cortet.mesh import TetMesh
from cortet.optimise.insertion import insert_vertices
from cortet.optimise.vertices import mu2_of

#: four tetrahedra around a long edge: whatever swaps do with the six points, they stay long
SPINDLE = np.array([[0, 0, -2.0], [0, 0, 2.0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
AROUND = np.array([[0, 1, 2, 3], [0, 1, 3, 4], [0, 1, 4, 5], [0, 1, 5, 2]], np.int32)


def inserted(mesh: TetMesh, threshold: float, region=None):
    region = np.zeros(len(mesh.cells), np.int32) if region is None else region
    mu2 = np.asarray(mu2_of(quality(mesh.points, mesh.cells)))
    return insert_vertices(mesh.points, mesh.cells, mu2, region, float(mu2_of(threshold)))


def test_a_vertex_halves_a_long_edge_in_its_middle():
    mesh = TetMesh(SPINDLE, AROUND)
    points, cells, origin, like, count = inserted(mesh, 0.3)
    assert count == 1 and len(cells) == 8 and np.array_equal(points[:6], SPINDLE)
    assert points[6] == pytest.approx([0, 0, 0], abs=1e-12)
    assert signed_volumes(points, cells).sum() == pytest.approx(signed_volumes(SPINDLE, AROUND).sum())
    assert quality(points, cells).max() < quality(SPINDLE, AROUND).max()
    assert np.array_equal(like[:6], np.arange(6)) and like[6] in range(6) and set(origin) <= set(range(4))


def test_nothing_is_inserted_where_nothing_would_be_better():
    flat = TetMesh(np.array([[0, 0, 0], [1, 0, 0.0], [0, 1, 0], [0.3, 0.3, 0.1]]), np.array([[0, 1, 2, 3]], np.int32))
    good = TetMesh(SPINDLE * [1, 1, 0.4], AROUND)
    for mesh in (flat, good):
        points, cells, _, _, count = inserted(mesh, 0.3)
        assert count == 0 and np.array_equal(points, mesh.points) and np.array_equal(cells, mesh.cells)


def test_regions_keep_their_interface():
    mesh = TetMesh(SPINDLE, AROUND)
    *_, count = inserted(mesh, 0.3, np.array([0, 0, 1, 1], np.int32))
    assert count == 0, "the long edge lies in the interface"


def test_the_boundary_and_the_volume_stay():
    mesh = ball_mesh()
    points, cells, _, like, count = inserted(mesh, 0.3)
    assert count > 0 and (signed_volumes(points, cells) > 0).all()
    assert signed_volumes(points, cells).sum() == pytest.approx(signed_volumes(mesh.points, mesh.cells).sum())
    assert np.array_equal(np.unique(cells), np.arange(len(points)))
    before, after = topology.boundary_faces(mesh), topology.boundary_faces(TetMesh(points, cells))
    assert {tuple(sorted(face)) for face in before.tolist()} == {tuple(sorted(face)) for face in like[after].tolist()}
    assert quality(points, cells).max() <= quality(mesh.points, mesh.cells).max()
