"""A later brain is predicted from growth that was measured, and checked against the real one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from carried import carried
from prediction import (
    forecast_growth,
    measured_growth,
    predict,
    shuffled_growth,
    uniform_growth,
)
from prediction_tables import correlation, scores
from series import Series, series_of
from shapes import ball_mesh, ball_surface

from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.fold import fold
from cortet.folding.growth import AREA, usual
from cortet.folding.journal import SERIES
from cortet.folding.journal import series as frames_of
from cortet.folding.surface_growth import area_ratio
from cortet.formats import vtu
from cortet.geometry.topology import boundary_surface
from cortet.meshes import TetMesh, TriSurface
from cortet.solver_files.names import growth_field
from cortet.stages.transfer import transfer

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SETTINGS = Settings(
    force=True, gestational_age=22.0, end=23.0, thickness=3.0, record_interval=0.5, frame_interval=0.5,
    envelope=False,
)  # fmt: skip


def bumpy(size: float, height: float) -> TriSurface:
    ball = ball_surface(3)
    return replace(ball, points=ball.points * (size + height * np.sin(4 * ball.points[:, 2:] / 5)))


def balls() -> Series:
    return series_of({22.0: bumpy(2.0, 0.1), 23.0: bumpy(2.1, 0.15), 24.0: bumpy(2.2, 0.2)}, sphere=ball_surface(3))


# --- the series


def test_surfaces_of_a_series_are_laid_onto_the_first():
    first, later = bumpy(2.0, 0.1), bumpy(2.0, 0.1)
    moved = replace(later, points=later.points @ TURN.T + 30.0)
    assert series_of({22.0: first, 24.0: moved}).at(24.0).points == pytest.approx(first.points, abs=1e-9)
    weights = np.where(first.points[:, 2] > 0, 1.0, 0.0)
    odd = replace(moved, points=moved.points + np.where(first.points[:, 2:] > 0, 0.0, 5.0))
    laid = series_of({22.0: first, 24.0: odd}, cortex=weights).at(24.0)
    assert laid.points[weights > 0] == pytest.approx(first.points[weights > 0], abs=1e-9)
    for wrong, word in (({22.0: first}, "one surface"), ({22.0: first, 24.0: ball_surface(2)}, "correspond")):
        with pytest.raises(InputError, match=word):
            series_of(wrong)


def test_scores_do_not_see_where_a_brain_lies_and_are_given_by_lobe():
    series = balls()
    above = series.first.points[:, 2] > 0
    (perfect,) = scores(series, {24.0: series.at(24.0).points @ TURN.T + 7.0})
    assert perfect["gained_depth"] == pytest.approx(1) == perfect["curvature"]
    assert perfect["distance_mm"] == pytest.approx(0, abs=1e-9) == perfect["distance_95_mm"]
    (scaled,) = scores(series, {24.0: series.first.points * 1.1})
    assert scaled["gained_depth"] < 0.99 and scaled["distance_mm"] > 0.01
    predicted = {24.0: series.at(24.0).points - np.where(above, 0.0, 0.1)[:, None]}
    whole, upper, lower = scores(replace(series, lobes={"upper": above, "lower": ~above}), predicted)
    assert [row["lobe"] for row in (whole, upper, lower)] == [None, "upper", "lower"]
    assert "area_mm2" in whole and "area_mm2" not in upper
    assert whole["distance_mm"] == pytest.approx(np.mean([upper["distance_mm"], lower["distance_mm"]]), rel=0.05)
    one = scores(replace(series, lobes={"one": np.arange(len(above)) == 0}), predicted)[1]
    assert one["depth"] is None and one["distance_mm"] > 0, "one vertex has no correlation, and JSON no NaN"


# --- growth


def test_a_forecast_goes_on_as_areas_of_usual_brains_do():
    series = balls()
    maps = measured_growth(series, [23.0], 0.0)
    (later,) = forecast_growth(series, maps, 23.0, [24.0]).values()
    areas = np.log(usual(AREA, np.array([22.0, 23.0, 24.0])))
    assert later == pytest.approx(maps[23.0] * (areas[2] - areas[0]) / (areas[1] - areas[0]))
    wild = {23.0: 20 * maps[23.0]}
    assert np.abs(forecast_growth(series, wild, 23.0, [24.0])[24.0]).max() <= 1.2, "a fold refuses what no tissue does"


def test_nulls_have_as_much_growth_as_was_measured_but_no_pattern_or_another():
    series = balls()
    maps = measured_growth(series, [24.0], 0.0)
    even, turned = uniform_growth(series, maps)[24.0], shuffled_growth(series, maps, 0)[24.0]
    measured = np.average(area_ratio(maps[24.0]), weights=series.weights)
    assert area_ratio(even) == pytest.approx(measured)
    assert np.average(area_ratio(turned), weights=series.weights) == pytest.approx(measured, rel=0.03)
    assert area_ratio(turned).std() > 0.5 * area_ratio(maps[24.0]).std()
    assert abs(correlation(area_ratio(turned), area_ratio(maps[24.0]), series.weights)) < 0.7
    with pytest.raises(InputError, match="no sphere"):
        shuffled_growth(replace(series, sphere=None), maps, 0)


# --- predictions


def grown_balls(folder: Path) -> tuple[Series, TetMesh]:
    """A ball, and what it becomes in a week by a map that differs from pole to pole; and its mesh."""
    mesh = ball_mesh(2, radius=10.0)
    surface, _ = boundary_surface(mesh)
    normals = surface.points / np.linalg.norm(surface.points, axis=1, keepdims=True)
    plane = (np.eye(3) - normals[:, :, None] * normals[:, None, :])[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    fields = {growth_field(23.0): 0.1 * plane * (1 + normals[:, 2:])}
    grown, _ = transfer(mesh, replace(surface, point_data=fields))
    fold(grown, folder, SETTINGS)
    (last,) = [vtu.read(file) for file, age in frames_of(folder / SERIES) if age == 23.0]
    return series_of({22.0: surface, 23.0: replace(surface, points=carried(surface.points, mesh, last.points))}), mesh


@pytest.mark.usefixtures("at_rest")
def test_rounds_find_what_has_to_be_imposed(tmp_path):
    series, mesh = grown_balls(tmp_path / "truth")
    rounds: list[str] = []
    how = {"settings": SETTINGS, "until": 23.0}
    found = predict(series, mesh, "mechanics", tmp_path / "found", smoothing=0.0, rounds=5, say=rounds.append, **how)
    left = [one["rms_23"] for one in found.residuals]
    assert left[-1] < 0.3 * left[0]
    assert len(rounds) == 5
    rows = {row["gestational_age"]: row for row in scores(series, found.points)}
    nothing = scores(series, predict(series, mesh, "nothing", Path(), **how).points)[0]
    assert rows[23.0]["distance_mm"] < 0.3 * nothing["distance_mm"]
    assert rows[23.0]["area_mm2"] == pytest.approx(rows[23.0]["real_area_mm2"], rel=5e-3)
