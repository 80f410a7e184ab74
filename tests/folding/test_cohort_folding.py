"""The table of all folds holds what each run wrote, failures and stops first; variants are checked and drawn."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from shapes import ball_mesh

from cortet.config import load
from cortet.config.fold import Settings
from cortet.errors import InputError
from cortet.folding.cohort_folding import COLUMNS, cohort_folding_figure, write_cohort_folding
from cortet.folding.fold import fold
from cortet.formats.tables import names
from cortet.formats.tsv import read_tsv


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """A ball folded for a tenth of a week, once with a growth that inverts it."""
    found = []
    for variant, changed in ((None, {}), ("wild", {"growth_rate": 1000.0, "end": 40.0, "record_interval": 0.5})):
        folder = tmp_path_factory.mktemp("run")
        small = {"gestational_age": 22.0, "end": 22.1, "force": True}
        fold(ball_mesh(2, radius=10.0), folder, Settings(**{**small, **changed}))
        run = {"case": "sub-a_hemi-L", "variant": variant, "cell_size_mm": 0.6, "mesher": "lattice", "hemisphere": "L"}
        found.append({**run, "folder": str(folder)})
    return found


def test_every_run_is_a_row_and_what_went_wrong_comes_first(runs, tmp_path):
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


def test_the_figure_has_a_curve_per_run_over_real_brains_of_its_kind(runs):
    figure = cohort_folding_figure(runs)
    for axis in figure.axes:
        named = [line for line in axis.lines if not str(line.get_label()).startswith("_")]
        assert [line.get_label() for line in named] == [f"sub-a_hemi-L{name}, $h$ = 0.6 mm" for name in ("", " wild")]
        assert sum(len(points.get_offsets()) for points in axis.collections) > 10
    (legend,) = figure.legends
    assert len({text.get_text() for text in legend.get_texts()}) == 2 + 4
    both = cohort_folding_figure([*runs, {**runs[0], "case": "sub-c", "hemisphere": None}])
    assert len(both.legends[0].get_texts()) == 3 + 4 and len(both.axes[0].collections) == 4 + 1


@pytest.mark.parametrize(
    "variant",
    [{"thicknes": 1.0}, {"thickness": -1.0}, {}, {"cases": "all"}, {"real_surfaces": {}}, {"picture": "depth"}],
)
def test_a_variant_changes_keys_of_fold_that_there_are(variant):
    config = load({"fold": {"variants": {"thin": {"thickness": 1.0}}}})
    assert config.fold.variants["thin"] == {"thickness": 1.0} and "variants" not in config.fold.values()
    with pytest.raises((InputError, ValidationError), match="fold"):
        load({"fold": {"variants": {"thin": variant}}})
