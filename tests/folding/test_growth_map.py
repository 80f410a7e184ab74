"""Measured growth: it is found between two surfaces, and a fold grows by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_mesh, ball_surface

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.fold import fold
from cortet.folding.run import advance_to, beginning, prepared
from cortet.folding.surface_growth import (
    area_ratio,
    logarithmic_growth,
    measured,
    principal,
    smoothed,
)
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import vertex_normals
from cortet.meshes import FloatArray, TetMesh
from cortet.solver_files.names import growth_field

EVERY = {"record_interval": 0.5, "frame_interval": 0.5}
THIN = Settings(gestational_age=22.0, force=True, end=22.5, thickness=3.0, envelope=False, **EVERY)


# --- what was measured


def test_stretches_and_directions_of_a_stretched_ball_are_those_put_in():
    ball = ball_surface(4)
    tensors = logarithmic_growth(ball, replace(ball, points=ball.points * [1.5, 1.5, 1.2]))
    pole, equator = ball.points[:, 2].argmax(), ball.points[:, 0].argmax()
    normals = vertex_normals(ball.points, ball.faces)
    found = principal(tensors, normals)
    assert (found.largest[pole], found.smallest[pole]) == pytest.approx((1.5, 1.5), rel=1e-3)
    assert (found.largest[equator], found.smallest[equator]) == pytest.approx((1.5, 1.2), rel=1e-3)
    assert abs(found.direction[equator]) == pytest.approx([0, 1, 0], abs=1e-3)


def test_smoothing_takes_away_as_much_noise_as_there_is():
    ball = ball_surface(4)
    later = replace(ball, points=ball.points * [1.5, 1.5, 1.2])
    true = logarithmic_growth(ball, later)
    noise = np.random.default_rng(0).normal(0, 0.05, later.points.shape)
    noisy = logarithmic_growth(ball, replace(later, points=later.points + noise))
    kept, less = smoothed(true, ball), smoothed(noisy, ball)
    assert np.abs(less.tensors - true).mean() < 0.7 * np.abs(noisy - true).mean()
    assert kept.width_mm <= less.width_mm
    assert smoothed(noisy, ball, 0.0).tensors == pytest.approx(noisy)
    assert smoothed(noisy, ball, 2.0).width_mm == pytest.approx(2.0, rel=0.1)
    even = logarithmic_growth(ball, replace(ball, points=1.3 * ball.points))  # directions turn with the surface
    assert smoothed(even, ball, 5.0).tensors == pytest.approx(even, abs=2e-2)
    assert area_ratio(smoothed(even, ball, 5.0).tensors) == pytest.approx(1.69)


def test_surfaces_that_do_not_correspond_are_refused():
    ball = ball_surface(2)
    turned, flat = replace(ball, faces=ball.faces[::-1]), replace(ball, points=np.zeros_like(ball.points))
    for later, word in ((ball_surface(3), "correspond"), (turned, "correspond"), (flat, "no area")):
        with pytest.raises(InputError, match=word):
            logarithmic_growth(ball, later)
    ball = ball_surface(4, radius=25.0)
    mixed = ball.points[np.random.default_rng(0).permutation(len(ball.points))]
    for early, late, word in ((1, ball.points / 1000, "in mm"), (1, mixed, "corr"), (1.2, ball.points, "69%")):
        with pytest.raises(InputError, match=word):
            measured(replace(ball, points=early * ball.points), replace(ball, points=late))


# --- what is imposed


def mapped(mesh: TetMesh, tensors: FloatArray, age: float = 24.0) -> TetMesh:
    return replace(mesh, point_data={**mesh.point_data, growth_field(age): tensors})


def radial(mesh: TetMesh, stretch: float) -> FloatArray:
    """Logarithmic growth of each node across the direction from the centre."""
    normals = mesh.points / np.maximum(np.linalg.norm(mesh.points, axis=1, keepdims=True), 1e-12)
    plane = (np.eye(3) - normals[:, :, None] * normals[:, None, :]) * np.log(stretch)
    return plane[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def grown(mesh: TetMesh, settings: Settings) -> FloatArray:
    run = prepared(mesh, settings)
    moment = beginning(run)
    assert not advance_to(run, moment, run.end)
    return run.scale.origin + run.scale.length * run.growth.frame(moment.time) * moment.state.x


@pytest.mark.usefixtures("at_rest")
def test_what_grows_more_along_its_meridians_becomes_longer_from_pole_to_pole():
    """And no larger: growth along the meridians is as much as shrinking along the parallels."""
    mesh = ball_mesh(2, radius=10.0)
    x, y, z = mesh.points.T
    from_axis, from_centre = np.hypot(x, y), np.maximum(np.linalg.norm(mesh.points, axis=1), 1e-12)
    parallel = np.stack([-y, x, 0 * z], axis=1) / np.maximum(from_axis, 1e-12)[:, None]
    meridian = np.cross(parallel, mesh.points / from_centre[:, None])
    shape = 0.2 * (from_axis / from_centre) ** 2
    tensors = meridian[:, :, None] * meridian[:, None, :] - parallel[:, :, None] * parallel[:, None, :]
    tensors = (shape[:, None, None] * tensors)[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    end = grown(mapped(mesh, tensors), THIN.with_keys(end=23.5, volume={22.0: 1.0, 24.0: 1.0}))
    along_x, along_y, along_z = np.ptp(end, axis=0) / np.ptp(mesh.points, axis=0)
    assert along_z > 1.005 > 0.998 > along_x
    assert along_x == pytest.approx(along_y, rel=2e-3)


def test_the_energy_of_a_fold_by_a_map_is_balanced_and_it_ends_where_its_last_map_does(tmp_path):
    mesh, said = ball_mesh(2, radius=10.0), list[str]()
    verdict = fold(mapped(mesh, radial(mesh, 1.1), 23.0), tmp_path, THIN.with_keys(end=24.0), say=said.append)
    assert abs(float(read_tsv(tmp_path / "fold.tsv")["energy_error"].iloc[-1])) < 5e-3
    assert verdict.gestational_age == pytest.approx(23.0)
    assert any("warning" in line and "23 weeks" in line for line in said)


BALL = ball_mesh(1, radius=10.0)
NOTHING, ONES = np.zeros((len(BALL.points), 6)), np.ones(len(BALL.points))


@pytest.mark.parametrize(
    ("fields", "settings", "word"),
    [
        ({"growth_to_24": NOTHING[:, :3]}, THIN, "shape"),
        ({"growth_to_24": NOTHING + np.nan}, THIN, "finite"),
        ({"growth_to_24": NOTHING + 2.5}, THIN, "sevenfold"),
        ({"growth_to_21": NOTHING}, THIN, "growth_to_21"),
        ({"growth_to_24": NOTHING}, THIN.with_keys(model="braingrowth", envelope=None), "braingrowth"),
        ({"growth_to_24": NOTHING, "growth": ONES}, THIN, "growth"),
        ({"growth_to_24_area_ratio": ONES}, THIN, "area_ratio"),
    ],
)
def test_what_is_no_map_is_refused(fields, settings, word):
    with pytest.raises(InputError, match=word):
        prepared(replace(BALL, point_data=fields), settings)
