"""The table of all folds holds what each run wrote, failures and stops first; variants are checked and drawn."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from shapes import ball_mesh

from cortet.config import load
from cortet.errors import InputError
from cortet.folding.cohort_folding import COLUMNS, cohort_folding_figure, write_cohort_folding
from cortet.folding.fold import fold
from cortet.folding.section import Settings
from cortet.formats.tables import names
from cortet.formats.tsv import read_tsv


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """A ball folded for a tenth of a week, once with a growth that inverts it."""
    found = []
    for variant, changed in ((None, {}), ("wild", {"growth_rate": 1000.0, "end": 40.0, "record_interval": 0.5})):
        folder = tmp_path_factory.mktemp("run")
        small = {"gestational_age": 22.0, "end": 22.1, "allow_volume": True}
        fold(ball_mesh(2, radius=10.0), folder, Settings(**{**small, **changed}))
        run = {"case": "sub-a_hemi-L", "variant": variant, "cell_size_mm": 0.6, "mesher": "lattice", "hemisphere": "L"}
        found.append({**run, "folder": str(folder)})
    return found


def test_every_run_is_a_row_and_what_went_wrong_comes_first(runs: list[dict[str, Any]], tmp_path: Path) -> None:
    failed = {**runs[0], "case": "sub-b_hemi-L", "reason": "fold: killed"}
    del failed["folder"]
    files = ("folds.tsv", "folds.json", "folds.svg", "folds.png")
    write_cohort_folding(runs, [failed], [tmp_path / name for name in files])
    table = read_tsv(tmp_path / "folds.tsv")
    assert list(table.columns) == names(COLUMNS) == list(json.loads((tmp_path / "folds.json").read_text()))
    assert table["state"].tolist() == ["failed", "inverted", "folded"]
    assert table["case"].tolist() == ["sub-b_hemi-L", "sub-a_hemi-L", "sub-a_hemi-L"]
    assert table["reason"].iloc[0] == "fold: killed" and "inverted" in table["reason"].iloc[1]
    assert table["variant"].tolist() == ["n/a", "wild", "n/a"]
    verdict = json.loads((Path(runs[0]["folder"]) / "verdict.json").read_text())
    assert float(table["min_j"].iloc[2]) == pytest.approx(verdict["min_j"], rel=1e-5)
    assert float(table["end_weeks"].iloc[2]) == pytest.approx(22.1)
    assert (tmp_path / "folds.png").stat().st_size > 10_000


def test_the_figure_has_a_curve_per_run_over_real_brains(runs: list[dict[str, Any]]) -> None:
    figure = cohort_folding_figure(runs)
    for axis in figure.axes:
        named = [line for line in axis.lines if not str(line.get_label()).startswith("_")]
        assert [line.get_label() for line in named] == [f"sub-a_hemi-L{name}, $h$ = 0.6 mm" for name in ("", " wild")]
        assert [line.get_linestyle() for line in named] == ["-", "--"]
        assert sum(len(points.get_offsets()) for points in axis.collections) > 10
        assert axis.get_xticks().tolist() == [22, 26, 30, 34, 38, 42]
    (legend,) = figure.legends
    figure.draw_without_rendering()
    assert legend.get_window_extent().y0 > max(axis.get_window_extent().y1 for axis in figure.axes)  # over no curve
    names = [text.get_text() for text in legend.get_texts()]
    assert len(names) == len(set(names)) == 2 + 4


def test_halves_and_whole_brains_stand_over_real_ones_of_their_kind(runs: list[dict[str, Any]]) -> None:
    figure = cohort_folding_figure([*runs, {**runs[0], "case": "sub-c", "hemisphere": None}])
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(names) == len(set(names)) == 3 + 4
    assert len(figure.axes[0].collections) == 4 + 1


def test_runs_that_have_a_name_in_the_legend_have_a_colour_of_their_own(runs: list[dict[str, Any]]) -> None:
    cases = [{**runs[0], "case": f"sub-{number}_hemi-L"} for number in range(10)]
    lines = [line for line in cohort_folding_figure(cases).axes[0].lines if str(line.get_label()).startswith("sub-")]
    assert len({line.get_color() for line in lines}) == 10


def test_variants_change_keys_of_fold() -> None:
    config = load({"fold": {"cases": "all", "variants": {"thin": {"thickness": 1.0}, "stiff": {"core_stiffness": 2}}}})
    assert config.fold.variants["thin"] == {"thickness": 1.0}
    assert "variants" not in config.fold.values()


@pytest.mark.parametrize(
    "variants",
    [
        {"thin": {"thicknes": 1.0}},
        {"thin": {"thickness": -1.0}},
        {"thin": {}},
        {"thin": {"cases": "all"}},
        {"thin": {"real_surfaces": {}}},
        {"thin": {"picture": "depth"}},
        {"T n": {}},
    ],
)
def test_a_variant_that_cannot_be_is_refused(variants: dict[str, Any]) -> None:
    with pytest.raises((InputError, ValidationError), match="fold"):
        load({"fold": {"variants": variants}})
