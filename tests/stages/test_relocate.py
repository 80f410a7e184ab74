"""S3 moves nodes only, through Gmsh's renumbering, and leaves a fixed boundary exactly alone."""

import gmsh
import numpy as np
import pytest
from cubes import cube_mesh

from cortet.config.stages import Relocate
from cortet.errors import StageError
from cortet.geometry.topology import boundary_nodes
from cortet.measure.quality import quality, signed_volumes
from cortet.meshes import TetMesh
from cortet.stages import relocate as stage
from cortet.stages.relocate import relocate


def rough_cube() -> TetMesh:
    """Interior nodes out of place, and numbered at random, so that any mix-up of numbers tears the mesh."""
    cube = cube_mesh(6, side=3.0, jitter=0.2)
    shuffle = np.random.default_rng(3).permutation(len(cube.points))
    fields = {"label": np.arange(len(shuffle), dtype=np.int32)}
    return TetMesh(cube.points[np.argsort(shuffle)], shuffle[cube.cells], fields)


@pytest.mark.parametrize("boundary", ["fixed", "free"])
def test_quality_improves_nothing_is_inverted_and_numbering_and_fields_stay(boundary):
    mesh = rough_cube()
    better, report = relocate(mesh, Relocate(boundary=boundary))
    assert not gmsh.isInitialized()
    assert better.cells is mesh.cells and better.point_data["label"] is mesh.point_data["label"]
    before, after = quality(mesh.points, mesh.cells), quality(better.points, better.cells)
    assert after.mean() < before.mean() - 0.02 and after.max() < before.max()
    assert signed_volumes(better.points, better.cells).min() > 0
    assert (report.mean_q_before, report.q_max_after) == (before.mean(), after.max())
    assert report.max_displacement_mm > 0


def test_a_fixed_boundary_does_not_move_by_one_bit_and_a_free_one_does():
    mesh = rough_cube()
    nodes = boundary_nodes(mesh)
    fixed, _ = relocate(mesh, Relocate(boundary="fixed"))
    assert np.array_equal(fixed.points[nodes], mesh.points[nodes])
    assert np.linalg.norm(fixed.points - mesh.points, axis=1).max() < 0.5  # a mix-up of numbers would be many spacings
    free, report = relocate(mesh, Relocate(boundary="free"))
    moved = np.linalg.norm(free.points - mesh.points, axis=1)
    assert report.max_displacement_mm == moved.max() >= moved[nodes].max() > 0


def test_nodes_that_gmsh_moved_through_a_face_go_only_part_of_the_way(monkeypatch, caplog):
    mesh = rough_cube()
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), boundary_nodes(mesh))[0]
    points[inner] += 1.2
    monkeypatch.setattr(stage, "_relocated", lambda *_: points)
    moved, _ = relocate(mesh)
    assert "nodes" in caplog.text
    assert signed_volumes(moved.points, moved.cells).min() > 0


def test_a_failure_inside_gmsh_is_reported_and_leaves_no_session(monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise Exception("no such method")

    monkeypatch.setattr(gmsh.model.mesh, "optimize", fail)
    with pytest.raises(StageError, match="Gmsh failed: no such method"):
        relocate(cube_mesh(2))
    assert not gmsh.isInitialized()
