"""Figures show what the table holds, and their files do not change from run to run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cortet.report.figures import PANELS, cohort_figure, save

HEADER = "case\themi\tscan_age\tcell_size_mm\ttets\tq_mean\tq_max\tsurface_to_boundary_mean_mm\tverdict\n"
ROWS = (
    "sub-1_hemi-L\tL\t22\t0.6\t380000\t0.129\t0.39\t0.03\tpass\n"
    "sub-2_hemi-R\tR\t28.5\t0.6\t970000\t0.131\t0.41\t0.04\tpass\n"
    "sub-3\tn/a\t28\t1\t450000\t0.133\t0.44\t0.05\tpass\n"
)
#: what the legend says of `ROWS`
EACH = [
    "published (CORTET), $h$ = 0.6 mm ($n$ = 194)",
    "left, $h$ = 0.6 mm ($n$ = 1)",
    "right, $h$ = 0.6 mm ($n$ = 1)",
    "whole brain, $h$ = 1 mm ($n$ = 1)",
]


@pytest.fixture
def table(tmp_path: Path) -> Path:
    (tmp_path / "cohort_quality.tsv").write_text(HEADER + ROWS)
    return tmp_path / "cohort_quality.tsv"


@pytest.fixture
def figure(table: Path) -> Figure:
    return cohort_figure(table, limit=0.6)


def texts(axis: Axes) -> list[str]:
    return [text.get_text() for text in axis.texts]


def labels(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_each_panel_shows_every_mesh_in_front_of_the_published_ones(figure):
    each = [380, 970, 450], [0.129, 0.131, 0.133], [0.39, 0.41, 0.44], [0.03, 0.04, 0.05]
    for axis, values in zip(figure.axes, each, strict=True):
        ours = [np.asarray(points.get_offsets()) for points in axis.collections]
        if axis is not figure.axes[3]:  # nobody published it
            assert len(ours.pop(0)) == 194
        drawn = np.concatenate(ours)
        assert sorted(drawn[:, 1]) == pytest.approx(sorted(values))
        assert sorted(drawn[:, 0]) == [22, 28, 28.5]
        assert all(float(week).is_integer() for week in axis.get_xticks())
    assert [axis.get_ylabel() for axis in figure.axes] == list(PANELS.values())
    assert [texts(axis)[0] for axis in figure.axes] == ["a", "b", "c", "d"]
    assert labels(figure) == EACH
    (line,) = figure.axes[2].lines
    assert list(line.get_ydata()) == [0.6, 0.6]


def test_a_mesh_that_is_not_certified_is_crossed_out(table):
    table.write_text(HEADER + ROWS.replace("0.04\tpass", "0.04\tfail"))
    figure = cohort_figure(table)
    for axis, value in zip(figure.axes, (970, 0.131, 0.41, 0.04), strict=True):
        (crossed,) = [one for one in axis.collections if "not certified" in str(one.get_label())]
        assert np.asarray(crossed.get_offsets()).tolist() == [[28.5, value]]
    assert labels(figure)[-1] == "not certified ($n$ = 1)"


@pytest.mark.parametrize("suffix", ["pdf", "svg", "png"])
def test_files_are_the_same_every_time_and_hold_no_date(figure, tmp_path, suffix):
    first, second = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    save(figure, first, second)
    assert first.read_bytes() == second.read_bytes()
    assert b"CreationDate" not in first.read_bytes() and b"dc:date" not in first.read_bytes()
    if suffix == "svg":
        assert "gestational age (weeks)" in first.read_text(), "text stays text"
