"""One table in three forms, each with the same cells."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from cortet.formats.tables import Column
from cortet.report.table_files import Table, mean_and_sd, median_and_range, number, write

TABLE = Table(
    "Things & others",
    (Column("name", "the <name>", heading="q_max"), Column("value", "the value", "mm", heading="v (mm)", form=".1f")),
    first=(),
    group=("name",),
)
ROWS = pd.DataFrame([{"name": "a & b", "value": 1.25}, {"name": "c > d ± e 1-2 |", "value": None}])


def texts(folder: Path, table: Table = TABLE, rows: pd.DataFrame = ROWS) -> dict[str, str]:
    """The table in every form, by suffix."""
    paths = [folder / f"t.{suffix}" for suffix in ("tsv", "json", "tex")]
    write(table, rows, *paths)
    return {path.suffix: path.read_text() for path in paths}


def test_latex_is_escaped_and_has_rules_between_groups(tmp_path):
    latex = texts(tmp_path)[".tex"]
    assert r"\begin{tabular}{@{}lr@{}}" in latex and r"$q_\mathrm{max}$ & v (mm) \tabularnewline" in latex
    assert r"a \& b & 1.2 \tabularnewline" in latex
    assert r"c $>$ d $\pm$ e 1--2 | & n/a \tabularnewline" in latex
    assert latex.index(r"\toprule") < latex.index(r"\bottomrule") and latex.count(r"\midrule") == 2


@pytest.mark.parametrize("count", [0, 99])
def test_nothing_of_a_large_table_is_left_out_and_an_empty_one_has_its_headings(count, tmp_path):
    rows = pd.DataFrame({"name": [f"case {number} {'long ' * 50}" for number in range(count)], "value": 1.0})
    with pd.option_context("styler.render.max_elements", 8):
        written = texts(tmp_path, rows=rows)
    assert "v (mm)" in written[".tex"]
    assert len(set(re.findall(r"case (\d+)( long){50}", written[".tex"]))) == count


def test_numbers_are_given_as_the_paper_gives_them():
    assert mean_and_sd(0.1349, 0.001) == "0.135 ± 0.001"
    assert mean_and_sd(0.1349, 0.0004) == "0.1349 ± 0.0004"  # never "± 0.000"
    assert mean_and_sd(37.57, 22.15, 2) == "38 ± 22" and mean_and_sd(9452.0, 602.0, 0) == "9,452 ± 602"
    assert mean_and_sd(0.1349, None) == mean_and_sd(0.1349, 0.0) == mean_and_sd(0.1349, 0.2, n=1) == "0.135"
    assert mean_and_sd(0.129, 0.001 * 2**0.5, n=2) == "0.129 [0.128-0.130]"
    assert mean_and_sd(0.129, 0.0001, n=2) == "0.129"
    assert mean_and_sd(float("nan"), float("nan")) == "n/a" and mean_and_sd(1.0, float("inf")) == "1.000"
    assert number(15955.4, 0) == "15,955"
    assert median_and_range(0.78, 0.746, 0.82) == "0.780 [0.746-0.820]"
    assert median_and_range(0, 0, 0, digits=0) == "0" and median_and_range(None, None, None) == "n/a"
