"""The developmental series shows every mesh on one scale, whole and cut, without a display."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from shapes import ball_mesh

from cortet.formats import vtu
from cortet.meshes import TetMesh
from cortet.paper.series import _lateral_side, draw_series, series_figure
from cortet.report.render import lateral_view


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)


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


def test_one_scale_for_all_ages_and_the_cut_in_colour() -> None:
    small, large = ball_mesh(radius=10.0), ball_mesh(radius=20.0)
    figure = series_figure([(22.0, {"L": small}), (30.5, {"R": large})])
    (first, first_cut), (second, second_cut) = pictures(figure)
    assert width(second) == pytest.approx(2 * width(first), rel=0.05)
    assert is_grey(first) and is_grey(second)
    assert not is_grey(first_cut) and not is_grey(second_cut)
    assert [axis.get_title() for axis in figure.axes[:2]] == ["22 weeks, left", "30.5 weeks, right"]


def test_an_unknown_age_is_said() -> None:
    figure = series_figure([(None, {"L": ball_mesh(radius=10.0)})])
    assert figure.axes[0].get_title() == "age n/a, left"


def test_both_hemispheres_have_rows_of_their_own_where_there_are_both() -> None:
    ball = ball_mesh(radius=10.0)
    figure = series_figure([(22.0, {"L": ball, "R": ball}), (30.0, {"L": ball})])
    assert [len(column) for column in pictures(figure)] == [3, 2]
    assert [axis.get_ylabel() for axis in figure.axes[:6:2]] == ["left", "right", "sagittal cut\nthrough the middle"]


def test_a_hemisphere_is_seen_from_its_own_side() -> None:
    ball = ball_mesh(radius=10.0)
    nose = TetMesh(ball.points * np.where(ball.points[:, 1:2] > 0, [1, 2, 1], 1), ball.cells)  # longer to the front
    view = {"cut": False, "half_width": 25.0, "half_height": 25.0, "width": 200}
    for side, ahead in (("L", -1), ("R", 1)):
        image = lateral_view(nose, side=side, **view)  # type: ignore[arg-type]
        columns = (image < 250).any(axis=2).sum(axis=0)
        tall = np.flatnonzero(columns > 0.95 * columns.max()).mean()
        assert np.sign(np.flatnonzero(columns).mean() - tall) == ahead


def test_it_is_drawn_from_files(tmp_path: Path) -> None:
    vtu.write(ball_mesh(radius=10.0), tmp_path / "a.vtu")
    brain = {"name": "sub-a", "age": 22.0, "meshes": {"n/a": str(tmp_path / "a.vtu")}, "certificates": {}}
    draw_series([brain], [tmp_path / "s.png", tmp_path / "s.svg"], cell_size=2.0)
    assert (tmp_path / "s.png").stat().st_size > 5000
    drawn = (tmp_path / "s.svg").read_text()
    assert all(text in drawn for text in ("22 weeks, whole brain", "sub-a", " = 2 mm"))


def test_a_brain_with_a_mesh_that_is_not_certified_says_so_below_its_name(tmp_path: Path) -> None:
    vtu.write(ball_mesh(radius=10.0), tmp_path / "a.vtu")
    for verdict in (True, False):
        content = {"schema": 1, "certified": verdict, "checks": [{"id": "worst_q"}]}
        (tmp_path / f"{verdict}.json").write_text(json.dumps(content))
    good, bad = (str(tmp_path / f"{verdict}.json") for verdict in (True, False))

    def drawn(**certificates: str) -> list[str]:
        """Text of the drawing of a brain of two hemispheres, line by line."""
        meshes = dict.fromkeys("LR", str(tmp_path / "a.vtu"))
        brain = {"name": "sub-a", "age": 22.0, "meshes": meshes, "certificates": certificates}
        draw_series([brain], [tmp_path / "s.svg"])
        return (tmp_path / "s.svg").read_text().splitlines()

    def marks(text: list[str]) -> int:
        return sum("not certified" in line and "<!--" not in line for line in text)

    assert marks(drawn(L=good, R=good)) == 0
    assert marks(drawn(L=good, R=bad)) == 1
    assert marks(drawn(L=good)) == 1, "a mesh without a certificate is not certified"


def test_names_stand_at_one_height_beside_a_brain_that_is_not_certified() -> None:
    ball = ball_mesh(radius=10.0)
    brains = [(22.0, {"L": ball}), (30.0, {"L": ball})]
    figure = series_figure(brains, names=["sub-a", "sub-b"], certified=[True, False])
    titles = [axis.get_title() for axis in figure.axes[:2]]
    assert titles == ["22 weeks, left\nsub-a\n", "30 weeks, left\nsub-b\nnot certified"]


def test_a_hemisphere_shows_its_lateral_side() -> None:
    right = ball_mesh(radius=10.0)
    right = replace(right, points=right.points + np.array([12.0, 0, 0]))
    assert [_lateral_side(right, hemi) for hemi in ("L", "R", "n/a")] == ["L", "R", "R"]
    assert _lateral_side(ball_mesh(radius=10.0), "n/a") == "L"  # a whole brain
    figure = series_figure([(22.0, {"R": right}), (24.0, {"L": right})])
    assert [axis.texts[0].get_ha() for axis in figure.axes[:2]] == ["right", "left"]
