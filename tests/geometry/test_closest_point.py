"""The tree must give what a search over all triangles gives, and winding numbers tell inside from outside."""

import numpy as np
import pytest
from shapes import ball_surface

from cortet.geometry.closest_point import closest_points, surface_tree
from cortet.geometry.nesting import joined
from cortet.geometry.winding import winding_numbers

TRIANGLE = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0.0]])
FACE = np.array([[0, 1, 2]], np.int32)


@pytest.mark.parametrize(
    ("query", "nearest", "weights"),
    [
        ((0.5, 0.5, 3), (0.5, 0.5, 0), (0.5, 0.25, 0.25)),  # above the inside
        ((-1, -1, 0), (0, 0, 0), (1, 0, 0)),  # beyond a corner
        ((1, -2, 1), (1, 0, 0), (0.5, 0.5, 0)),  # beyond a side
        ((2, 2, 0), (1, 1, 0), (0, 0.5, 0.5)),  # beyond the long side
    ],
)
def test_regions_of_one_triangle(query, nearest, weights):
    found = closest_points(surface_tree(TRIANGLE, FACE), np.array([query]))
    assert found.points[0] == pytest.approx(nearest) and found.barycentric[0] == pytest.approx(weights)
    assert found.distances[0] == pytest.approx(np.linalg.norm(np.subtract(query, nearest)))


def test_tree_agrees_with_a_search_over_every_triangle():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(90, 3))
    faces = rng.permutation(90).reshape(-1, 3).astype(np.int32)
    queries = 2 * rng.normal(size=(200, 3))
    found = closest_points(surface_tree(points, faces), queries)
    each = [closest_points(surface_tree(points, face[None]), queries).distances for face in faces]
    assert np.array_equal(found.distances, np.min(each, axis=0))
    assert np.array_equal(found.faces, np.argmin(each, axis=0))
    rebuilt = np.einsum("ij,ijk->ik", found.barycentric, points[faces[found.faces]])
    assert rebuilt == pytest.approx(found.points, abs=1e-12)
    assert (found.barycentric >= 0).all() and found.barycentric.sum(axis=1) == pytest.approx(1)


def test_a_closed_surface_winds_once_around_what_is_inside():
    ball = ball_surface(3, radius=10.0)
    places = np.array([[0, 0, 0], [9, 0, 0], [0, 11, 0], [0, 0, 100.0]])
    assert winding_numbers(ball, places) == pytest.approx([1, 1, 0, 0], abs=0.05)
    assert winding_numbers(joined([ball, ball]), places[:1]) == pytest.approx([2], abs=0.05)
