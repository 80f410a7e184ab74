"""S5 renumbers, and lets nothing unsound through."""

import numpy as np
import pytest
from cubes import cube_mesh

from cortet.errors import StageError
from cortet.geometry.topology import boundary_faces, boundary_nodes
from cortet.meshes import TetMesh
from cortet.stages.solver_ready import surface_nodes_first


def shuffled() -> TetMesh:
    cube = cube_mesh(3, side=2.0, jitter=0.2)
    shuffle = np.random.default_rng(5).permutation(len(cube.points))
    where = np.argsort(shuffle)
    return TetMesh(cube.points[where], shuffle[cube.cells], {"x": cube.points[where, 0]}, {"cell": cube.cells[:, 0]})


def test_surface_nodes_come_first_and_all_else_is_the_same_mesh():
    mesh = shuffled()
    ready, report = surface_nodes_first(mesh)
    assert np.array_equal(boundary_nodes(ready), np.arange(report.surface_nodes)) and report.surface_nodes == 56
    assert np.array_equal(ready.points[:56], mesh.points[boundary_nodes(mesh)])
    assert np.array_equal(ready.points[ready.cells], mesh.points[mesh.cells])
    assert np.array_equal(ready.point_data["x"], ready.points[:, 0]) and ready.cell_data == mesh.cell_data
    assert (report.nodes, report.tetrahedra, report.boundary_faces) == (64, 162, 108)
    assert report.volume_mm3 == pytest.approx(8)
    a, b, c = (ready.points[boundary_faces(ready)[:, i]] for i in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - 1.0) > 0).all(), "faces look outward"
    twice, _ = surface_nodes_first(ready)
    assert np.array_equal(ready.points, twice.points) and np.array_equal(ready.cells, twice.cells)


CUBE = cube_mesh(2)


@pytest.mark.parametrize(
    ("points", "cells", "word"),
    [
        (
            CUBE.points,
            np.where(np.arange(48)[:, None] == 5, CUBE.cells[:, [1, 0, 2, 3]], CUBE.cells),
            "1 tetrahedron is",
        ),
        (np.vstack([CUBE.points, [[3, 3, 3], [4, 4, 4]]]), CUBE.cells, "2 nodes"),
        # two on the same side of their common face: every volume positive, but part of the space twice
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 1], [0.3, 0.3, 0.5]], [[0, 1, 2, 3], [0, 1, 2, 4]], "add up"),
    ],
    ids=["inverted", "unused nodes", "overlapping"],
)
def test_what_is_unsound_is_refused(points, cells, word):
    with pytest.raises(StageError, match=word):
        surface_nodes_first(TetMesh(points, cells))
