"""Smoothing: as much as the surface is rough and no more; by the paper's method, as much as its age asks for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv
from shapes import ball_surface

from cortet.config import SETTINGS
from cortet.config.stages import SmoothSurface
from cortet.errors import InputError
from cortet.formats.gifti import read_surface
from cortet.geometry.intersection import self_intersections
from cortet.geometry.topology import enclosed_volume, face_areas
from cortet.measure.fidelity import high_frequency_roughness
from cortet.meshes import TriSurface, single_precision
from cortet.phantoms import phantom
from cortet.stages.smooth_surface import candidate_iterations, mean_nearest_vertex_distance, smooth_surface

#: the method and the limits of the setting `published`
PUBLISHED = SmoothSurface(**SETTINGS["published"]["smooth_surface"])
DATA = Path(__file__).parents[2] / "../shared/data"


def stairs(radius: float = 10.0, voxel: float = 0.5) -> TriSurface:
    """A ball as a label image has it: steps of one voxel."""
    count = int(2 * radius / voxel) + 6
    grid = pv.ImageData(dimensions=(count,) * 3, spacing=(voxel,) * 3, origin=(-(count - 1) * voxel / 2 + 0.013,) * 3)
    inside = (np.linalg.norm(np.asarray(grid.points), axis=1) < radius).astype(float)
    found = grid.contour([0.5], inside, method="marching_cubes").clean()
    surface = TriSurface(np.asarray(found.points, float), found.faces.reshape(-1, 4)[:, 1:].astype(np.int32))
    outward = enclosed_volume(surface.points, surface.faces) > 0
    return single_precision(surface if outward else replace(surface, faces=surface.faces[:, ::-1]))


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
    smooth, report = smooth_surface(surface, PUBLISHED, gestational_age=30.0)
    assert [c.iterations for c in report.candidates] == [0, 2, 4, 10]
    assert report.chosen_iterations == 4
    before, _, after, beyond = report.candidates
    assert before.displacement_mm == before.area_change == 0
    assert beyond.roughness_mm < after.roughness_mm < 0.7 * before.roughness_mm
    assert after.area_change == pytest.approx(after.area_mm2 / before.area_mm2 - 1)
    assert -0.06 < after.area_change < 0
    assert 0 < after.displacement_mm == mean_nearest_vertex_distance(surface.points, smooth.points) < 0.25
    assert beyond.breaks == (f"vertices are displaced by {beyond.displacement_mm:.3f} mm",)
    assert np.array_equal(smooth.faces, surface.faces)
    assert np.array_equal(single_precision(smooth).points, smooth.points)


def test_the_limit_of_area_decides_too() -> None:
    _, report = smooth_surface(
        rough_ball(), PUBLISHED.model_copy(update={"max_area_change": 0.018}), gestational_age=30.0
    )
    assert report.chosen_iterations == 2
    assert report.candidates[2].breaks == (f"area changes by {report.candidates[2].area_change:+.1%}",)


def test_without_an_eligible_candidate_the_surface_stays() -> None:
    surface = rough_ball()
    untouched, report = smooth_surface(
        surface, PUBLISHED.model_copy(update={"max_displacement": 1e-6}), gestational_age=30.0
    )
    assert report.chosen_iterations == 0
    assert all(c.breaks for c in report.candidates[1:])
    assert np.array_equal(untouched.points, surface.points)


def test_a_candidate_that_crosses_itself_is_not_chosen() -> None:
    """Of two nested balls the outer, coarser one shrinks faster."""
    outer, inner = ball_surface(2, 10.0), ball_surface(3, 9.4)
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.points)])
    nested = TriSurface(np.concatenate([outer.points, inner.points]), faces)
    smooth, report = smooth_surface(
        nested, PUBLISHED.model_copy(update={"max_area_change": 1.0, "max_displacement": 0.28}), gestational_age=30.0
    )
    crossing = report.candidates[1]
    (reason,) = crossing.breaks
    assert int(reason.removesuffix(" triangles cross")) > 100
    assert report.chosen_iterations == 0
    assert np.array_equal(smooth.points, nested.points)


def test_the_same_again() -> None:
    first, first_report = smooth_surface(rough_ball(), PUBLISHED, gestational_age=26.0)
    second, second_report = smooth_surface(rough_ball(), PUBLISHED, gestational_age=26.0)
    assert np.array_equal(first.points, second.points)
    assert first_report == second_report


def test_a_real_surface_keeps_within_the_limits() -> None:
    path = Path(__file__).parents[2] / "../shared/data/fetal/fetomorph_GW30_right.surf.gii"
    if not path.exists():
        pytest.skip("no real surfaces in ../shared/data")
    smooth, report = smooth_surface(read_surface(path), PUBLISHED, gestational_age=30.0)
    chosen = next(c for c in report.candidates if c.iterations == report.chosen_iterations)
    assert chosen.iterations in (2, 4, 10)
    assert abs(chosen.area_change) <= 0.06
    assert chosen.displacement_mm <= 0.25
    assert chosen.roughness_mm < report.candidates[0].roughness_mm
    assert not len(self_intersections(smooth))


# --- the filter of Taubin -------------------------------------------------------------------------------------------


def off_the_sphere(surface: TriSurface, radius: float = 10.0) -> float:
    return float(np.abs(np.linalg.norm(surface.points, axis=1) - radius).mean())


def test_stair_steps_are_removed_without_shrinking() -> None:
    surface = stairs()
    smooth, report = smooth_surface(surface)
    chosen = next(c for c in report.candidates if c.iterations == report.chosen_iterations)
    assert report.candidates[0].high_frequency_roughness > 0.1 and chosen.high_frequency_roughness <= 0.03
    assert off_the_sphere(smooth) < 0.6 * off_the_sphere(surface), "it is nearer to what the steps stand for"
    assert abs(chosen.volume_change) < 0.001
    area = 4 * np.pi * 10**2
    before, after = (face_areas(one.points, one.faces).sum() / area - 1 for one in (surface, smooth))
    assert before > 0.05 and abs(after) < 0.02, "the area of the steps goes with them"
    assert chosen.displacement_mm <= 0.05 and not len(self_intersections(smooth))
    assert np.array_equal(single_precision(smooth).points, smooth.points)
    by_age = smooth_surface(surface, PUBLISHED, gestational_age=22.0)[0]
    assert off_the_sphere(smooth) < off_the_sphere(by_age)


def test_a_smooth_surface_is_not_touched_at_any_age() -> None:
    ball = ball_surface(4, 20.0)
    for age in (None, 21.0, 40.0):
        smooth, report = smooth_surface(ball, gestational_age=age)
        assert smooth is ball and report.chosen_iterations == 0 and len(report.candidates) == 1


def test_no_more_steps_are_taken_than_the_limit_of_roughness_asks_for() -> None:
    steps = [
        smooth_surface(stairs(), SmoothSurface(max_roughness=limit))[1].chosen_iterations
        for limit in (0.2, 0.07, 0.03, 0.015)
    ]
    assert steps == sorted(steps) and steps[0] == 0 and len(set(steps)) >= 3


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"max_area_change": 0.001}, "area changes by -"),
        ({"max_volume_change": 1e-7}, "volume changes by "),
        ({"max_displacement": 0.001}, "vertices are displaced by 0."),
    ],
)
def test_the_limits_hold_and_the_log_says_that_the_surface_stays_rough(
    limits: dict[str, float], words: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    surface = stairs()
    smooth, report = smooth_surface(surface, SmoothSurface(**limits))
    assert smooth is surface and report.chosen_iterations == 0
    assert report.candidates[1].breaks[0].startswith(words)
    assert "the surface stays rough: 0.1" in caplog.text


def test_roughness_has_no_unit_and_tells_noise_from_curvature() -> None:
    ball, rough = ball_surface(4, 20.0), stairs()
    assert high_frequency_roughness(ball.points, ball.faces) < 0.005
    small = high_frequency_roughness(rough.points / 7, rough.faces)
    assert small == pytest.approx(high_frequency_roughness(rough.points, rough.faces))
    wavy = ball.points * (1 + 0.05 * np.sin(4 * ball.points[:, :1] / 20))
    assert high_frequency_roughness(wavy, ball.faces) < 0.01


def test_taubin_gives_the_same_again() -> None:
    first, second = smooth_surface(stairs())[0], smooth_surface(stairs())[0]
    assert np.array_equal(first.points, second.points)


def test_the_published_method_needs_an_age() -> None:
    with pytest.raises(InputError, match="needs a gestational age"):
        smooth_surface(ball_surface(2), PUBLISHED)


def test_folds_that_large_triangles_hardly_follow_are_left_alone(caplog: pytest.LogCaptureFixture) -> None:
    """They are as rough as stair steps; any smoothing would move them by more than the limit."""
    coarse = phantom(34.0, subdivisions=4)
    smooth, report = smooth_surface(coarse, gestational_age=34.0)
    assert report.candidates[0].high_frequency_roughness > 0.03
    assert smooth is coarse and not caplog.records


@pytest.mark.parametrize("name", ["fetal/CRL_STA28_left_white", "atlas_series/dHCP.week40.L.white"])
def test_an_atlas_surface_is_not_touched(name: str) -> None:
    path = DATA / f"{name}.surf.gii"
    if not path.exists():
        pytest.skip("no real surfaces in ../shared/data")
    surface = read_surface(path)
    assert smooth_surface(surface, gestational_age=28.0)[0] is surface
