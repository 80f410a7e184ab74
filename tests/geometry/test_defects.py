"""The places where a surface is not a manifold are found, and only those."""

from __future__ import annotations

from cubes import cube_mesh
from shapes import ball_surface
from wrong_meshes import touching

from cortet.geometry.defects import defective_vertices
from cortet.geometry.topology import boundary_faces, surface_topology


def test_a_closed_manifold_has_none() -> None:
    assert len(defective_vertices(ball_surface(3).faces)) == 0
    assert len(defective_vertices(boundary_faces(cube_mesh(3)))) == 0


def test_the_rim_of_a_hole_is_found() -> None:
    sphere = ball_surface(2)
    assert defective_vertices(sphere.faces[1:]).tolist() == sorted(sphere.faces[0].tolist())


def test_a_common_corner_is_found_though_all_edges_are_manifold() -> None:
    mesh = touching(cube_mesh(2), 1, 1, 1)
    assert surface_topology(boundary_faces(mesh)).nonmanifold_edges == 0
    assert mesh.points[defective_vertices(boundary_faces(mesh))].tolist() == [[1, 1, 1]]


def test_a_common_edge_is_found_with_all_its_vertices() -> None:
    mesh = touching(cube_mesh(2), 1, 1, 0)
    assert mesh.points[defective_vertices(boundary_faces(mesh))].tolist() == [[1, 1, 0], [1, 1, 0.5], [1, 1, 1]]


def test_two_separate_bodies_are_no_defect_of_a_place() -> None:
    assert len(defective_vertices(boundary_faces(touching(cube_mesh(2), 3, 0, 0)))) == 0
