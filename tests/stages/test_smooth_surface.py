"""Smoothing: as much as the surface is rough and no more; by the paper's method, as much as its age asks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv
from shapes import ball_surface, real_surface

from cortet.config import SETTINGS
from cortet.config.stages import SmoothSurface
from cortet.errors import InputError
from cortet.geometry.intersection import self_intersections
from cortet.geometry.topology import enclosed_volume, face_areas
from cortet.meshes import TriSurface, single_precision
from cortet.phantoms import phantom
from cortet.stages.smooth_surface import mean_nearest_vertex_distance, smooth_surface

#: the method and the limits of the setting `published`
PUBLISHED = SmoothSurface(**SETTINGS["published"]["smooth_surface"])


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


def test_most_roughness_within_the_limits_is_removed():
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


def test_a_candidate_that_crosses_itself_is_not_chosen():
    """Of two nested balls the outer, coarser one shrinks faster."""
    outer, inner = ball_surface(2, 10.0), ball_surface(3, 9.4)
    faces = np.concatenate([outer.faces, inner.faces[:, ::-1] + len(outer.points)])
    nested = TriSurface(np.concatenate([outer.points, inner.points]), faces)
    smooth, report = smooth_surface(
        nested, PUBLISHED.model_copy(update={"max_area_change": 1.0, "max_displacement": 0.28}), gestational_age=30.0
    )
    crossing = report.candidates[1]
    (reason,) = crossing.breaks
    assert int(reason.removesuffix(" triangles cross").replace(",", "")) > 100
    assert report.chosen_iterations == 0
    assert np.array_equal(smooth.points, nested.points)


# --- the filter of Taubin -------------------------------------------------------------------------------------------


def off_the_sphere(surface: TriSurface, radius: float = 10.0) -> float:
    return float(np.abs(np.linalg.norm(surface.points, axis=1) - radius).mean())


def test_stair_steps_are_removed_without_shrinking():
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


def test_a_smooth_surface_is_not_touched_at_any_age():
    ball = ball_surface(4, 20.0)
    for age in (None, 21.0, 40.0):
        smooth, report = smooth_surface(ball, gestational_age=age)
        assert smooth is ball and report.chosen_iterations == 0 and len(report.candidates) == 1


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"max_area_change": 0.001}, "area"),
        ({"max_volume_change": 1e-7}, "volume"),
        ({"max_displacement": 0.001}, "vertices"),
    ],
)
def test_the_limits_hold_and_the_log_says_that_the_surface_stays_rough(limits, words, caplog):
    caplog.set_level("INFO")
    surface = stairs()
    smooth, report = smooth_surface(surface, SmoothSurface(**limits))
    assert smooth is surface and report.chosen_iterations == 0
    assert report.candidates[1].breaks[0].startswith(words)
    assert "stays rough" in caplog.text


def test_the_published_method_needs_an_age():
    with pytest.raises(InputError, match="gestational age"):
        smooth_surface(ball_surface(2), PUBLISHED)


def test_folds_that_large_triangles_hardly_follow_are_left_alone(caplog):
    """They are as rough as stair steps; any smoothing would move them by more than the limit."""
    coarse = phantom(34.0, subdivisions=4)
    smooth, report = smooth_surface(coarse, gestational_age=34.0)
    assert report.candidates[0].high_frequency_roughness > 0.03
    assert smooth is coarse and not caplog.records


@pytest.mark.parametrize("name", ["fetal/CRL_STA28_left_white", "atlas_series/dHCP.week40.L.white"])
def test_an_atlas_surface_is_not_touched(name):
    surface = real_surface(name)
    assert smooth_surface(surface, gestational_age=28.0)[0] is surface
