"""Figures show what the table holds, and their files do not change from run to run."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from matplotlib.figure import Figure

from cortet.config.sections import Figures
from cortet.paper.pooled_quality import Pooled, pooled_quality_figure
from cortet.report import published
from cortet.report.figures import LOOKS, cohort_figure, look, mesh_quality_figures, save

HEADER = "case\themi\tscan_age\tcell_size_mm\ttets\tq_mean\tq_max\tsurface_to_boundary_mean_mm\n"
ROWS = (
    "sub-1_hemi-L\tL\t22\t0.6\t380000\t0.129\t0.39\t0.03\n"
    "sub-2_hemi-R\tR\t28.5\t0.6\t970000\t0.131\t0.41\t0.04\n"
    "sub-3\tn/a\t28\t1\t450000\t0.133\t0.44\t0.05\n"
)


@pytest.fixture
def figure(tmp_path: Path) -> Figure:
    table = tmp_path / "cohort_quality.tsv"
    table.write_text(HEADER + ROWS)
    return cohort_figure(table, limit=0.6)


def test_the_published_cohort_is_that_of_the_paper() -> None:
    rows = published.cohort()
    worst = rows["q_max"]
    assert len(rows) == 194
    assert (worst.min(), worst.max()) == pytest.approx((0.462, 0.561), abs=5e-4)
    assert np.median(worst) == pytest.approx(0.508, abs=5e-4)
    assert rows["q_mean"].mean() == pytest.approx(0.129, abs=5e-4)


def test_each_panel_shows_every_mesh_in_front_of_the_published_ones(figure: Figure) -> None:
    labels = ["tetrahedra (thousands)", "mean $q$", r"$q_\mathrm{max}$", "surface to mesh, mean (mm)"]
    assert [axis.get_ylabel() for axis in figure.axes] == labels
    each = [380, 970, 450], [0.129, 0.131, 0.133], [0.39, 0.41, 0.44], [0.03, 0.04, 0.05]
    for axis, values in zip(figure.axes, each, strict=True):
        ours = [np.asarray(points.get_offsets()) for points in axis.collections]
        if axis is not figure.axes[3]:  # nobody published it
            assert len(ours.pop(0)) == 194
        drawn = np.concatenate(ours)
        assert sorted(drawn[:, 1]) == pytest.approx(sorted(values))
        assert sorted(drawn[:, 0]) == [22, 28, 28.5]
        assert axis.get_xlabel() == "gestational age (weeks)"
        assert all(float(week).is_integer() for week in axis.get_xticks())


def test_without_ages_meshes_stand_by_case(tmp_path: Path) -> None:
    table = tmp_path / "cohort_quality.tsv"
    table.write_text(HEADER + "".join(f"sub-{n}\tL\tn/a\t0.6\t{n}000\t0.129\t0.4\t0.03\n" for n in (4, 5)))
    axis = cohort_figure(table).axes[0]
    (points,) = axis.collections
    assert np.asarray(points.get_offsets()).tolist() == [[1, 4], [2, 5]]
    assert axis.get_xlabel().startswith("case")
    table.write_text(HEADER + "sub-4\tL\tn/a\t0.6\t4000\t0.129\t0.4\t0.03\n")
    assert all(float(case).is_integer() for case in cohort_figure(table).axes[0].get_xticks())


def test_meshes_of_unknown_age_stand_beyond_the_axis_of_ages(tmp_path: Path) -> None:
    table = tmp_path / "cohort_quality.tsv"
    table.write_text(HEADER + ROWS + "sub-4_hemi-L\tL\tn/a\t0.6\t390000\t0.129\t0.4\t0.03\n")
    for axis, value in zip(cohort_figure(table).axes, (390, 0.129, 0.4, 0.03), strict=True):
        assert axis.get_xlim()[0] > 15, "no age is near 0"
        theirs = value != 0.03  # nobody published that
        beside = axis.collections[1 + theirs]
        ((x, y),) = np.asarray(beside.get_offsets())
        assert x > 1 and y == pytest.approx(value) and beside.get_transform() != axis.transData
        assert not beside.get_clip_on() and "age\nn/a" in [text.get_text() for text in axis.texts]


def test_a_panel_may_stand_alone(tmp_path: Path) -> None:
    (tmp_path / "table.tsv").write_text(HEADER + ROWS)
    (axis,) = cohort_figure(tmp_path / "table.tsv", limit=0.6, panels=["q_max"]).axes
    assert axis.get_ylabel() == r"$q_\mathrm{max}$" and [line.get_ydata()[0] for line in axis.lines] == [0.6]


def test_panels_have_letters(figure: Figure) -> None:
    assert [axis.texts[0].get_text() for axis in figure.axes] == ["a", "b", "c", "d"]


def test_the_legend_counts_and_the_limit_is_drawn(figure: Figure) -> None:
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [
        "published (CORTET), $h$ = 0.6 mm ($n$ = 194)",
        "left, $h$ = 0.6 mm ($n$ = 1)",
        "right, $h$ = 0.6 mm ($n$ = 1)",
        "whole brain, $h$ = 1 mm ($n$ = 1)",
    ]
    (line,) = figure.axes[2].lines
    assert list(line.get_ydata()) == [0.6, 0.6]


def test_meshes_of_other_cells_stand_beside_published_q_only_and_the_panels_say_so(tmp_path: Path) -> None:
    table = tmp_path / "cohort_quality.tsv"
    table.write_text(HEADER + ROWS.replace("\t0.6\t", "\t2\t"))
    figure = cohort_figure(table, limit=0.6, target=0.3)
    assert [max(len(points.get_offsets()) for points in axis.collections) for axis in figure.axes] == [1, 194, 194, 1]
    said = ["grey: $h$ = 0.6 mm" in [text.get_text() for text in axis.texts] for axis in figure.axes]
    assert said == [False, True, True, False]
    assert [line.get_ydata()[0] for line in figure.axes[2].lines] == [0.6, 0.3]
    assert "published (CORTET), $h$ = 0.6 mm ($n$ = 194)" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_mesh_that_is_not_certified_is_crossed_out(tmp_path: Path) -> None:
    table = tmp_path / "cohort_quality.tsv"
    first, *others = (HEADER + ROWS).splitlines()
    verdicts = ("pass", "fail", "pass")
    table.write_text("\n".join([f"{first}\tverdict", *map("\t".join, zip(others, verdicts, strict=True)), ""]))
    figure = cohort_figure(table)
    for axis, value in zip(figure.axes, (970, 0.131, 0.41, 0.04), strict=True):
        (crossed,) = [one for one in axis.collections if "not certified" in str(one.get_label())]
        assert np.asarray(crossed.get_offsets()).tolist() == [[28.5, value]]
    assert figure.legends[0].get_texts()[-1].get_text() == "not certified ($n$ = 1)"


def test_a_journal_chooses_width_and_letters(tmp_path: Path) -> None:
    assert list(LOOKS) == list(get_args(Figures.model_fields["journal"].annotation))
    table = tmp_path / "cohort_quality.tsv"
    table.write_text(HEADER + ROWS)
    with look("plos"):
        figure = cohort_figure(table)
    assert figure.get_figwidth() == pytest.approx(7.5) and figure.axes[0].xaxis.label.get_size() == 8
    assert cohort_figure(table).get_figwidth() == 7.2


def test_files_are_the_same_every_time_and_hold_no_date(figure: Figure, tmp_path: Path) -> None:
    for suffix in ("pdf", "svg", "png"):
        first, second = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
        save(figure, first, second)
        assert first.read_bytes() == second.read_bytes()
        assert b"CreationDate" not in first.read_bytes()
        assert b"dc:date" not in first.read_bytes()


def test_text_in_the_svg_stays_text(figure: Figure, tmp_path: Path) -> None:
    save(figure, tmp_path / "a.svg")
    assert "gestational age (weeks)" in (tmp_path / "a.svg").read_text()


def test_pooled_quality_has_a_row_per_setting_before_the_published_distributions() -> None:
    counts = np.zeros(200, np.int32)
    counts[[20, 100]] = 99, 1
    figure = pooled_quality_figure(
        [
            Pooled("default", 1, {"S1-S2": counts, "S1-S4": counts}, target=0.3),
            Pooled("published", 3, {"S1-S2": counts, "S1-S3": counts}),
        ],
        cell_size=1.0,
        limit=0.6,
    )
    (bulk, tail), (_, second) = np.reshape(figure.axes, (2, 2))
    assert bulk.get_title(loc="left") == "setting default, $h$ = 1 mm: 1 mesh, 100 elements"
    assert len(bulk.patches) == 5 and len(tail.lines) == 7 and len(second.lines) == 6
    assert bulk.patches[3].get_data().values[20] == 99  # %
    q, above = tail.lines[3].get_data()
    assert above[np.isclose(q, 0.3)] == 1e4 and q.max() == 0.5  # one in a hundred is above 0.3, none above 0.505
    assert [line.get_xdata()[0] for line in tail.lines[-2:]] == [0.6, 0.3]
    (legend,) = figure.legends
    assert {"generated", "cleaned", "relocated"} < {text.get_text() for text in legend.get_texts()}
    figure.draw_without_rendering()
    lefts = [round(text.get_window_extent().x0) for text in legend.get_texts()]
    assert len(set(lefts[:3])) == 1 and lefts[3] > lefts[0]  # published ones are the first column


@pytest.mark.parametrize(("name", "columns"), [("this mesh", 2), ("sub-01_ses-02_hemi-L_" * 3, 1)])
def test_the_legend_of_a_mesh_lies_beside_its_curves(name: str, columns: int) -> None:
    counts = np.ones(200, np.int32)
    for figure in mesh_quality_figures({name: counts}, limit=0.6):
        figure.draw_without_rendering()
        (legend,), (axis,) = figure.legends, figure.axes
        assert legend.get_window_extent().y0 > axis.get_window_extent().y1 and not axis.get_legend()
        assert legend._ncols == columns and legend.get_window_extent().x0 >= 0


def test_the_published_tail_ends_where_the_paper_says() -> None:
    counts = np.ones(200, np.int32)
    figure = pooled_quality_figure([Pooled("default", 1, {"S1-S2": counts})], cell_size=1.0)
    theirs = figure.axes[1].lines[:3]
    assert [line.get_xdata().max() for line in theirs] == pytest.approx([0.82, 0.80, 0.56], abs=0.006)
