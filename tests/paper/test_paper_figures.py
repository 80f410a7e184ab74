"""The figure of all ages: one scale, the cut in colour, and a mark on what is not certified."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from shapes import ball_mesh

from cortet.paper.series import Brain, series_figure

BALL = ball_mesh(radius=10.0)


def pictures(figure: Figure) -> list[list[np.ndarray]]:
    """The pictures of each column, from the top."""
    columns: dict[int, list[np.ndarray]] = {}
    for axis in figure.axes:
        for image in axis.images:
            columns.setdefault(axis.get_subplotspec().colspan.start, []).append(np.asarray(image.get_array()))
    return [columns[number] for number in sorted(columns)]


def width(image: np.ndarray) -> int:
    """Pixels between the outermost ones that are not white."""
    drawn = np.flatnonzero((image < 250).any(axis=(0, 2)))
    return int(np.ptp(drawn))


def is_grey(image: np.ndarray) -> bool:
    return int(np.ptp(image.astype(int), axis=2).max()) < 30


def test_one_scale_for_all_ages_and_the_cut_in_colour(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    figure = series_figure([Brain(22.0, {"L": BALL}), Brain(None, {"R": ball_mesh(radius=20.0)})])
    (first, first_cut), (second, second_cut) = pictures(figure)
    assert width(second) == pytest.approx(2 * width(first), rel=0.05)
    assert is_grey(first) and is_grey(second)
    assert not is_grey(first_cut) and not is_grey(second_cut)
    assert [axis.get_title() for axis in figure.axes[:2]] == ["22 weeks, left", "age n/a, right"]
    both = series_figure([Brain(22.0, {"L": BALL, "R": BALL}), Brain(30.0, {"L": BALL})])
    assert [len(column) for column in pictures(both)] == [3, 2], "each hemisphere has a row"
    assert [axis.get_ylabel() for axis in both.axes[:4:2]] == ["left", "right"]
    marked = series_figure([Brain(30.0, {"L": BALL}, "sub-b", certified=False)])
    assert "not certified" in " ".join(text.get_text() for text in marked.findobj(Text))
