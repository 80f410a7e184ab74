"""The figures of the paper: meshes of all ages on one scale, and the quality of all elements after each stage."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from shapes import ball_mesh

from cortet.formats import vtu
from cortet.paper.series import Brain, draw_series, series_figure

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


def test_it_is_drawn_from_files_and_marks_a_brain_that_is_not_certified(tmp_path):
    vtu.write(BALL, tmp_path / "a.vtu")
    for verdict in (True, False):
        content = {"schema": 1, "certified": verdict, "checks": [{"id": "worst_q"}]}
        (tmp_path / f"{verdict}.json").write_text(json.dumps(content))
    good, bad = (str(tmp_path / f"{verdict}.json") for verdict in (True, False))
    meshes = dict.fromkeys("LR", str(tmp_path / "a.vtu"))
    for certificates, marks in (({"L": good, "R": good}, 0), ({"L": good, "R": bad}, 1), ({"L": good}, 1)):
        brain = {"name": "sub-a", "age": 22.0, "meshes": meshes, "certificates": certificates}
        draw_series([brain], [tmp_path / "s.svg"], cell_size=2.0)
        lines = (tmp_path / "s.svg").read_text().splitlines()
        assert sum("not certified" in line and "<!--" not in line for line in lines) == marks
    assert all(text in "".join(lines) for text in ("22 weeks", "sub-a", " = 2 mm"))
    figure = series_figure([Brain(22.0, {"L": BALL}, "sub-a"), Brain(30.0, {"L": BALL}, "sub-b", certified=False)])
    assert [axis.get_title().count("\n") for axis in figure.axes[:2]] == [2, 2], "names stand at one height"
