"""The medial wall of half a brain: it is found where it is, does not grow, and slides in the sagittal plane."""

from __future__ import annotations

import numpy as np
import pytest
from cubes import cube_mesh
from scipy.spatial.transform import Rotation
from shapes import real_surface

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.body import scale_of
from cortet.folding.growth import time_of
from cortet.folding.medial_wall import Wall, medial_wall
from cortet.folding.run import advance_to, beginning, described, millimetres, prepared
from cortet.geometry.topology import boundary_faces, boundary_nodes, boundary_surface
from cortet.meshes import MeshSets, TetMesh, TriSurface

#: surface -> hemisphere, and share of the surface that the cut has, read off pictures
REAL = {
    "fetal/CRL_STA25_right_white": ("R", 0.06),
    "neonatal/week40.white.L": ("L", 0.03),
}


def wall_of(mesh: TetMesh | TriSurface, hemisphere: str) -> Wall:
    scale = scale_of(mesh, hemisphere)
    return medial_wall(mesh, hemisphere, scale.origin, scale.length)


def block(turned: float = 0.0) -> TetMesh:
    """A block of 20 x 60 x 40 mm, turned about the vertical by some degrees: all its sides are flat."""
    mesh = cube_mesh(8)
    turn = Rotation.from_euler("z", turned, degrees=True)
    return TetMesh(turn.apply((mesh.points - 0.5) * [20, 60, 40]), mesh.cells)


@pytest.mark.parametrize(("hemisphere", "side"), [("L", 1.0), ("R", -1.0)])
@pytest.mark.parametrize("turned", [0.0, 8.0])
def test_a_flat_cut_is_found_on_the_side_of_the_midline(hemisphere, side, turned):
    mesh = block(turned)
    wall = wall_of(mesh, hemisphere)
    straight = Rotation.from_euler("z", -turned, degrees=True).apply(mesh.points[wall.nodes])
    assert straight[:, 0] == pytest.approx(10 * side)
    assert "is flat" in wall.found
    assert 0.05 < wall.share < 0.2
    assert wall.area_mm2 == pytest.approx(wall.share * 2 * (20 * 60 + 20 * 40 + 60 * 40))
    assert np.abs(straight[:, 1]).max() < 25  # the cortex in front of it and behind faces the midline, too


def test_the_mesh_or_the_surface_may_say_what_its_wall_is():
    mesh = block()
    surface, _ = boundary_surface(mesh)
    faces, top = boundary_faces(mesh), mesh.points[:, 2] == 20
    above = surface.points[:, 2] == 20
    marked = [
        (TetMesh(mesh.points, mesh.cells, {"medial_wall": top.astype(np.int32)}), top),
        (TetMesh(mesh.points, mesh.cells, sets=MeshSets(faces={"medial_wall": faces[top[faces].all(axis=1)]})), top),
        (TriSurface(surface.points, surface.faces, {"medial_wall": above.astype(np.int32)}), above),
    ]
    for body, expected in marked:
        wall = wall_of(body, "L")
        assert np.array_equal(wall.nodes, expected) and "marks it" in wall.found
    for body, _ in marked[:2]:
        assert prepared(body, Settings(gestational_age=22.0, hemisphere="L")).body.held.sum() == top.sum()
    for value, word in ((0, "none"), (1, "all")):
        with pytest.raises(InputError, match=word):
            wall_of(TetMesh(mesh.points, mesh.cells, {"medial_wall": np.full(len(mesh.points), value)}), "L")


@pytest.mark.parametrize("name", REAL)
def test_the_wall_of_a_real_brain_is_the_cut_through_its_middle(name):
    hemisphere, share = REAL[name]
    surface = real_surface(name)
    wall = wall_of(surface, hemisphere)
    assert "is flat" in wall.found
    assert wall.share == pytest.approx(share, rel=0.25)


def test_the_wall_slides_in_the_sagittal_plane_and_does_not_grow():
    mesh = block()
    run = prepared(mesh, Settings(gestational_age=22.0, hemisphere="L", thickness=6.0))
    surface = boundary_nodes(run.mesh)
    held = run.body.held
    inside = held[run.body.cells].all(axis=1)
    assert not run.body.mask[inside].any()
    far = ~held & np.isin(np.arange(len(held)), surface) & (run.mesh.points[:, 0] < -5)
    assert (run.body.mask[far[run.body.cells].all(axis=1)] == 1).all()
    moment = beginning(run)
    assert not advance_to(run, moment, time_of(22.5))
    moved = millimetres(run, moment) - run.mesh.points
    assert not moved[held, 0].any()
    assert np.abs(moved[held, 1:]).max() > 1e-3
    assert np.abs(moved[far, 0]).max() > 1e-2
    assert "medial wall: " in described(run)[1]
