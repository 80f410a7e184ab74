"""What was done to a mesh is taken back around some vertices, and stays elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_surface

from cortet.config.stages import Reconnect
from cortet.geometry import topology
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.optimise.backing_off import back_off
from cortet.optimise.undoing import undone
from cortet.stages.generate import generate
from cortet.stages.reconnect import reconnect

SURFACE = ball_surface(4)


def rows(cells: np.ndarray) -> set:
    return set(map(tuple, np.sort(cells, axis=1).tolist()))


@pytest.fixture(scope="module")
def before() -> TetMesh:
    """Good tetrahedra, but for those whose inner nodes were shaken."""
    mesh, _ = generate(SURFACE, cell_size=0.8)
    inside = np.linalg.norm(mesh.points, axis=1) < 4.2
    shaken = np.random.default_rng(0).uniform(-0.25, 0.25, mesh.points.shape)
    points, _ = back_off(mesh.points, mesh.points + inside[:, None] * shaken, mesh.cells)
    return TetMesh(points, mesh.cells, cell_data={"number": np.arange(len(mesh.cells)).astype(float)})


@pytest.fixture(scope="module")
def after(before: TetMesh) -> TetMesh:
    return reconnect(before, SURFACE, Reconnect(insert=False))[0]


def test_around_a_vertex_all_is_as_before_and_far_away_all_is_as_after(before, after):
    changed = np.array(sorted(rows(before.cells) - rows(after.cells)))
    vertex = changed[np.argmax(before.points[changed[:, 0]][:, 2]), 0]
    mesh, around = undone(before, after, np.array([vertex]))
    here = rows(mesh.cells[(mesh.cells == vertex).any(axis=1)])
    assert here == rows(before.cells[(before.cells == vertex).any(axis=1)])
    back = (mesh.points != after.points).any(axis=1)
    assert back[vertex] and np.array_equal(mesh.points[back], before.points[back])
    assert back.sum() < 0.1 * len(back) and len(rows(mesh.cells) - rows(after.cells)) > 0
    assert np.array_equal(around, back[mesh.cells].any(axis=1))
    assert (signed_volumes(mesh.points, mesh.cells) > 0).all()
    assert topology.surface_topology(topology.boundary_faces(mesh)).problems() == []
    enclosed = topology.enclosed_volume(mesh.points, topology.boundary_faces(mesh))
    assert signed_volumes(mesh.points, mesh.cells).sum() == pytest.approx(enclosed)
    assert len(mesh.cell_data["number"]) == len(mesh.cells)


def test_more_is_taken_back_where_what_is_between_would_be_bad(before):
    """All vertices but one are pushed by more than an edge: that one cannot stay behind alone."""
    pushed = replace(before, points=before.points + np.array([0.5, 0, 0]))
    mesh, _ = undone(before, pushed, np.array([7]))
    assert (signed_volumes(mesh.points, mesh.cells) > 0).all()
    moved = (mesh.points != before.points).any(axis=1)
    mixed = moved[mesh.cells].any(axis=1) & ~moved[mesh.cells].all(axis=1)
    assert quality(mesh.points, mesh.cells)[mixed].max(initial=0) <= 0.5
    assert mesh.cells is pushed.cells, "what follows from the connectivity is still known"
