"""One table in five forms, each with the same cells."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pandas as pd

from cortet.formats.tables import Column
from cortet.report.table_files import Table, mean_and_sd, median_and_range, number, write

TABLE = Table(
    "Things & others",
    (Column("name", "the <name>", heading="q_max"), Column("value", "the value", "mm", heading="v (mm)", form=".1f")),
    first=(),
    group=("name",),
)
ROWS = pd.DataFrame([{"name": "a & b", "value": 1.25}, {"name": "c > d ± e 1-2 |", "value": None}])


def texts(folder: Path) -> dict[str, str]:
    paths = [folder / f"t.{suffix}" for suffix in ("tsv", "json", "tex", "md", "html")]
    write(TABLE, ROWS, *paths)
    return {path.suffix: path.read_text() for path in paths}


def cells(page: str, tag: str) -> list[str]:
    return re.findall(rf"<{tag}[^>]*>([^<]*)</{tag}>", page)


def test_the_tsv_has_the_columns_that_its_sidecar_explains(tmp_path: Path) -> None:
    written = texts(tmp_path)
    assert written[".tsv"].splitlines() == ["name\tvalue", "a & b\t1.25", "c > d ± e 1-2 |\tn/a"]
    assert list(json.loads(written[".json"])) == ["name", "value"]


def test_latex_is_escaped_and_has_rules_between_groups(tmp_path: Path) -> None:
    latex = texts(tmp_path)[".tex"]
    assert r"\begin{tabular}{@{}lr@{}}" in latex and r"$q_\mathrm{max}$ & v (mm) \tabularnewline" in latex
    assert r"a \& b & 1.2 \tabularnewline" in latex
    assert r"c $>$ d $\pm$ e 1--2 | & n/a \tabularnewline" in latex
    assert latex.index(r"\toprule") < latex.index(r"\bottomrule")
    assert latex.count(r"\midrule") == 2


def test_readers_find_every_column_explained(tmp_path: Path) -> None:
    written = texts(tmp_path)
    assert "- ***q*<sub>max</sub>**: the <name>" in written[".md"]
    assert "|---------:|" in written[".md"]
    assert "<dt>q_max</dt><dd>the &lt;name&gt;</dd>" in written[".html"]
    assert cells(written[".html"], "th") == ["q_max", "v (mm)", "a &amp; b", "c &gt; d ± e 1-2 |"]
    assert cells(written[".html"], "td") == ["1.2", "n/a"]
    assert r"c > d ± e 1-2 \|" in written[".md"]


def test_html_has_a_rule_where_a_group_starts(tmp_path: Path) -> None:
    assert re.findall(r'<tr(?: class="(\w+)")?>', texts(tmp_path)[".html"]) == ["", "", "rule"]


def test_nothing_of_a_large_table_is_left_out(tmp_path: Path) -> None:
    paths = [tmp_path / f"t.{suffix}" for suffix in ("tex", "md", "html")]
    rows = pd.DataFrame({"name": [f"case {number} {'long ' * 50}" for number in range(99)], "value": 1.0})
    with pd.option_context("styler.render.max_elements", 8):
        write(TABLE, rows, *paths)
    assert [len(set(re.findall(r"case (\d+)( long){50}", path.read_text()))) for path in paths] == [99, 99, 99]


def test_a_table_without_rows_has_its_headings_in_every_form(tmp_path: Path) -> None:
    paths = [tmp_path / f"t.{suffix}" for suffix in ("tex", "md", "html")]
    write(TABLE, ROWS[:0], *paths)
    assert all("v (mm)" in path.read_text() for path in paths)


def test_numbers_are_given_as_the_paper_gives_them() -> None:
    assert mean_and_sd(0.1349, 0.001) == "0.135 ± 0.001"
    assert mean_and_sd(0.1349, None) == "0.135"
    assert mean_and_sd(0.1349, 0.0004) == "0.1349 ± 0.0004"  # never "± 0.000"
    assert mean_and_sd(37.57, 22.15, 2) == "38 ± 22" and mean_and_sd(9452.0, 602.0, 0) == "9,452 ± 602"
    assert mean_and_sd(0.1349, 0.0) == mean_and_sd(0.1349, 0.2, n=1) == "0.135"
    assert mean_and_sd(0.129, 0.001 * 2**0.5, n=2) == "0.129 [0.128-0.130]"
    assert mean_and_sd(0.129, 0.0001, n=2) == "0.129"
    assert mean_and_sd(float("nan"), float("nan")) == "n/a" and mean_and_sd(1.0, float("inf")) == "1.000"
    assert number(15955.4, 0) == "15,955"
    assert median_and_range(0.78, 0.746, 0.82) == "0.780 [0.746-0.820]"
    assert median_and_range(0, 0, 0, digits=0) == "0"
    assert median_and_range(None, None, None) == "n/a"


def test_numbers_stand_at_the_right_and_have_a_minus_sign(tmp_path: Path) -> None:
    columns = (Column("case", heading="Case"), Column("v", heading="slope & 1 - h", form=lambda row: row["v"]))
    rows = [{"case": "a-1", "v": "-2.90 ± 0.01"}, {"case": "b-1", "v": "-3.1 [-3.2--2.9]"}, {"case": "c", "v": "n/a"}]
    write(Table("Slopes", columns, first=()), rows, tmp_path / "t.tex", tmp_path / "t.md", tmp_path / "t.html")
    latex = (tmp_path / "t.tex").read_text()
    assert r"\begin{tabular}{@{}lr@{}}" in latex and r"Case & slope \& 1 $-$ $h$ \tabularnewline" in latex
    assert r"a-1 & $-$2.90 $\pm$ 0.01 \tabularnewline" in latex
    assert '<td class="n">-2.90 ± 0.01</td>' in (tmp_path / "t.html").read_text()
    assert "-2.90 ± 0.01 |" in (tmp_path / "t.md").read_text()


def test_without_headings_readers_see_what_the_tsv_has_and_what_its_sidecar_says(tmp_path: Path) -> None:
    columns = (Column("case", "Name"), Column("q", "Worst q", limit="< 0.6", heading="Worst", form=".1f"))
    write(Table("Quality", columns), [{"case": "sub-1", "q": 0.4444444444, "other": 1}], tmp_path / "t.html")
    page = (tmp_path / "t.html").read_text()
    assert cells(page, "th") == ["case", "q", "sub-1"] and cells(page, "td") == ["0.444444"]
    assert "<dt>q</dt><dd>Worst q; threshold: &lt; 0.6</dd>" in page


def test_a_column_may_have_any_name(tmp_path: Path) -> None:
    columns = tuple(Column(name, "Carried") for name in ("case", "attributes", "class"))
    write(Table("Sheet", columns), [{"case": "a", "attributes": "b", "class": "c"}], tmp_path / "t.html")
    assert cells((tmp_path / "t.html").read_text(), "td") == ["b", "c"]
