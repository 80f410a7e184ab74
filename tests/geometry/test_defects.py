"""The places where a surface is not a manifold are found, and only those."""

from __future__ import annotations

import pytest
from cubes import cube_mesh
from shapes import ball_surface
from wrong_meshes import touching

from cortet.geometry.defects import defective_vertices
from cortet.geometry.topology import boundary_faces


def test_a_closed_manifold_has_none():
    assert len(defective_vertices(ball_surface(3).faces)) == 0
    assert len(defective_vertices(boundary_faces(cube_mesh(3)))) == 0


def test_the_rim_of_a_hole_is_found():
    sphere = ball_surface(2)
    assert defective_vertices(sphere.faces[1:]).tolist() == sorted(sphere.faces[0].tolist())


@pytest.mark.parametrize(
    ("shift", "found"),
    [
        ((1, 1, 1), [[1, 1, 1]]),  # a corner in common, though all edges are manifold
        ((1, 1, 0), [[1, 1, 0], [1, 1, 0.5], [1, 1, 1]]),
        ((3, 0, 0), []),
    ],
)
def test_what_two_cubes_have_in_common_is_found(shift, found):
    mesh = touching(cube_mesh(2), *shift)
    assert mesh.points[defective_vertices(boundary_faces(mesh))].tolist() == found
