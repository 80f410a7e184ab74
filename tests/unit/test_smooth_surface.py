"""Smoothing by age: strong where the surface is rough, none where it would change more than noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shapes import ball_surface

from cortet.formats.gifti import read_surface, single_precision
from cortet.geometry.intersection import self_intersections
from cortet.mesh import TriSurface
from cortet.stages.smooth_surface import candidate_iterations, mean_nearest_vertex_distance, smooth_surface


def rough_ball() -> TriSurface:
    ball = ball_surface(4, 20.0)
    radial = 1 + np.random.default_rng(0).normal(0, 0.05, len(ball.points)) / 20
    return single_precision(replace(ball, points=ball.points * radial[:, None]))


@pytest.mark.parametrize(
    ("age", "iterations"),
    [
        (21.0, (10, 20, 30)),
        (22.99, (10, 20, 30)),
        (23.0, (8, 12, 20)),
        (25.0, (4, 6, 12)),
        (29.0, (2, 4, 10)),
        (33.0, (0, 2, 8)),
        (34.0, (0, 1, 3)),
        (45.0, (0, 1, 3)),
    ],
)
def test_age_decides_what_is_tried(age: float, iterations: tuple[int, ...]) -> None:
    assert candidate_iterations(age) == iterations


def test_most_roughness_within_the_limits_is_removed() -> None:
    surface = rough_ball()
    smooth, report = smooth_surface(surface, gestational_age=30.0)
    assert [c.iterations for c in report.candidates] == [0, 2, 4, 10]
    assert report.chosen_iterations == 4
    before, _, after, beyond = report.candidates
    assert before.displacement_mm == before.area_change == 0
    assert beyond.roughness_mm < after.roughness_mm < 0.7 * before.roughness_mm
    assert after.area_change == pytest.approx(after.area_mm2 / before.area_mm2 - 1)
    assert -0.06 < after.area_change < 0
    assert 0 < after.displacement_mm == mean_nearest_vertex_distance(surface.points, smooth.points) < 0.25
    assert beyond.breaks == (f"vertices are displaced by {beyond.displacement_mm:.3f} mm",)
    assert after.mean_curvature_per_mm.mean == pytest.approx(1 / 20, rel=0.02)
    assert after.gaussian_curvature_per_mm2.mean == pytest.approx(1 / 400, rel=0.03)
    assert after.mean_curvature_per_mm.sd < 0.1 * before.mean_curvature_per_mm.sd
    assert np.array_equal(smooth.faces, surface.faces)
    assert np.array_equal(single_precision(smooth).points, smooth.points)


def test_the_limit_of_area_decides_too() -> None:
    _, report = smooth_surface(rough_ball(), gestational_age=30.0, max_area_change=0.018)
    assert report.chosen_iterations == 2
    assert report.candidates[2].breaks == (f"area changes by {report.candidates[2].area_change:+.1%}",)


def test_without_an_eligible_candidate_the_surface_stays() -> None:
    surface = rough_ball()
    untouched, report = smooth_surface(surface, gestational_age=30.0, max_displacement=1e-6)
    assert report.chosen_iterations == 0
    assert all(c.breaks for c in report.candidates[1:])
    assert np.array_equal(untouched.points, surface.points)


def test_a_candidate_that_crosses_itself_is_not_chosen() -> None:
    """Of two nested balls the outer, coarser one shrinks faster."""
    outer, inner = ball_surface(2, 10.0), ball_surface(3, 9.4)
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.points)])
    nested = TriSurface(np.concatenate([outer.points, inner.points]), faces)
    smooth, report = smooth_surface(nested, gestational_age=30.0, max_area_change=1.0, max_displacement=0.28)
    crossing = report.candidates[1]
    assert crossing.self_intersecting_faces > 100
    assert crossing.breaks == (f"{crossing.self_intersecting_faces} triangles cross",)
    assert report.chosen_iterations == 0
    assert np.array_equal(smooth.points, nested.points)


def test_the_same_again() -> None:
    first, first_report = smooth_surface(rough_ball(), gestational_age=26.0)
    second, second_report = smooth_surface(rough_ball(), gestational_age=26.0)
    assert np.array_equal(first.points, second.points)
    assert first_report == second_report


def test_a_real_surface_keeps_within_the_limits() -> None:
    path = Path(__file__).parents[2] / "../shared/data/fetal/fetomorph_GW30_right.surf.gii"
    if not path.exists():
        pytest.skip("no real surfaces in ../shared/data")
    smooth, report = smooth_surface(read_surface(path), gestational_age=30.0)
    chosen = next(c for c in report.candidates if c.iterations == report.chosen_iterations)
    assert chosen.iterations in (2, 4, 10)
    assert abs(chosen.area_change) <= 0.06
    assert chosen.displacement_mm <= 0.25
    assert chosen.roughness_mm < report.candidates[0].roughness_mm
    assert not len(self_intersections(smooth))
