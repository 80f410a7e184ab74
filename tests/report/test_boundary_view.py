"""The view of a boundary holds its shape and, however much it is simplified, its worst element."""

from __future__ import annotations

import base64

import numpy as np
import pytest
from shapes import ball_mesh

from cortet.geometry.topology import boundary_surface
from cortet.measure.quality import quality
from cortet.meshes import TetMesh
from cortet.report.boundary_view import boundary_view


def unpacked(view: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (mm), faces and q of a view, as the page reads them."""
    points, q = (np.frombuffer(base64.b64decode(view[key]), "<u2").astype(float) for key in ("points", "q"))
    faces = np.frombuffer(base64.b64decode(view["faces"]), f"<u{view['index_bytes']}")
    return view["low"] + view["step"] * points.reshape(-1, 3), faces.reshape(-1, 3), q / 65535


def dented(mesh: TetMesh) -> TetMesh:
    """The mesh with one of its boundary nodes pushed in, which makes the elements around it bad."""
    points = mesh.points.copy()
    points[boundary_surface(mesh)[1][0]] *= 0.9
    return TetMesh(points, mesh.cells)


def test_a_view_gives_the_boundary_back_and_the_worst_q_of_the_elements_at_each_vertex():
    mesh = ball_mesh(2, radius=20.0)
    boundary, nodes = boundary_surface(mesh)
    view = boundary_view(mesh, [{"q": 0.5, "centre_mm": (1.0, 2.0, 3.0), "reason": "x"}])
    points, faces, q = unpacked(view)
    np.testing.assert_allclose(points, boundary.points, atol=1e-3)
    np.testing.assert_array_equal(faces, boundary.faces)
    worst = [quality(mesh.points, mesh.cells[(mesh.cells == node).any(axis=1)]).max() for node in nodes]
    np.testing.assert_allclose(q, worst, atol=1e-4)
    assert view["worst"] == [{"q": 0.5, "centre": [1.0, 2.0, 3.0]}]
    assert view["colours"][0] == [253, 231, 37] and view["colours"][-1] == [68, 1, 84]  # viridis, from its end


def test_a_fine_boundary_is_simplified_and_keeps_its_worst_q():
    mesh = dented(ball_mesh(3, radius=20.0))
    boundary, nodes = boundary_surface(mesh)
    view = boundary_view(mesh, [], max_faces=300)
    points, faces, q = unpacked(view)
    assert view["face_count"] == len(faces) <= 300 < view["boundary_faces"] == len(boundary.faces)
    at_boundary = np.isin(mesh.cells, nodes).any(axis=1)
    assert q.max() == pytest.approx(quality(mesh.points, mesh.cells[at_boundary]).max(), abs=1e-4)
    dent = boundary.points[0]
    assert np.linalg.norm(points[q.argmax()] - dent) < 6  # mm, the length of an edge of what is left
