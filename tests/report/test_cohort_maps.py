"""Maps of a cohort on the common mesh: means where vertices correspond, nearest points where a repair changed that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.errors import InputError
from cortet.geometry.nesting import nested
from cortet.meshes import TriSurface
from cortet.report.cohort_maps import DISTANCE, case_map, mean_map


def ball(radius: float) -> TriSurface:
    """A ball with its height as a field, and labels."""
    one = ball_surface(3, radius=radius)
    fields = {"height": one.points[:, 2], "lobe": (one.points[:, 0] > 0).astype(np.int32)}
    return replace(one, point_data=fields)


def test_a_case_has_its_fields_thickness_and_distance_at_the_vertices_of_the_common_mesh():
    surface, mesh = ball(21.0), ball_mesh(2, radius=20.0)
    found = case_map(ball_surface(3, radius=21.0), nested(surface, {"white": ball_surface(3, radius=19.5)}), mesh)
    assert np.array_equal(found.points, surface.points)
    assert found.point_data["thickness"] == pytest.approx(1.5)
    assert found.point_data["height"] == pytest.approx(surface.points[:, 2])
    assert found.point_data[DISTANCE].min() == pytest.approx(1.0, abs=0.02), "where nodes are"
    assert 1.0 < found.point_data[DISTANCE].mean() < 1.3


def test_means_are_of_the_cases_that_have_a_field_and_labels_are_the_most_frequent():
    first, second, third = (ball(radius) for radius in (10.0, 20.0, 30.0))
    first = replace(first, point_data={**first.point_data, "lobe": 1 - first.point_data["lobe"]})
    third = replace(third, point_data={"lobe": third.point_data["lobe"]})
    mean, counts = mean_map([first, second, third])
    assert counts == {"height": 2, "lobe": 3}
    assert np.linalg.norm(mean.points, axis=1) == pytest.approx(20.0)
    assert mean.point_data["height"] == pytest.approx(ball(15.0).point_data["height"])
    assert np.array_equal(mean.point_data["lobe"], ball(1.0).point_data["lobe"])
    with pytest.raises(InputError, match="no case"):
        mean_map([])
    with pytest.raises(InputError, match="not all on one common mesh"):
        mean_map([ball(10.0), ball_surface(2)])
