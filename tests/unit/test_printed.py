"""One table in five forms, each with the same cells."""

from __future__ import annotations

import json
from pathlib import Path

from cortet.report.table_files import Shown, Table, mean_and_sd, median_and_range, number, write, write_view

TABLE = Table(
    "Things & others",
    {"name": {"Description": "Name"}, "value": {"Description": "Value", "Units": "mm"}},
    (
        Shown("q_max", lambda row: row["name"], "the <name>"),
        Shown("v (mm)", lambda row: number(row["value"], 1), "the value"),
    ),
    group=lambda row: row["name"],
)
ROWS = [{"name": "a & b", "value": 1.25}, {"name": "c > d ± e", "value": None}]


def texts(folder: Path) -> dict[str, str]:
    paths = [folder / f"t.{suffix}" for suffix in ("tsv", "json", "tex", "md", "html")]
    write(TABLE, ROWS, *paths)
    return {path.suffix: path.read_text() for path in paths}


def test_the_tsv_has_the_columns_that_its_sidecar_explains(tmp_path: Path) -> None:
    written = texts(tmp_path)
    assert written[".tsv"].splitlines() == ["name\tvalue", "a & b\t1.25", "c > d ± e\tn/a"]
    assert list(json.loads(written[".json"])) == ["name", "value"]


def test_latex_is_escaped_and_has_rules_between_groups(tmp_path: Path) -> None:
    latex = texts(tmp_path)[".tex"]
    assert r"q\_max & v (mm) \\" in latex
    assert r"a \& b & 1.2 \\" in latex
    assert r"c $>$ d $\pm$ e & n/a \\" in latex
    assert latex.index(r"\toprule") < latex.index(r"\bottomrule")
    assert latex.count(r"\midrule") == 2


def test_readers_find_every_column_explained(tmp_path: Path) -> None:
    written = texts(tmp_path)
    assert "- **q_max**: the <name>" in written[".md"]
    assert "<dt>q_max</dt><dd>the &lt;name&gt;</dd>" in written[".html"]
    assert "<td>a &amp; b</td>" in written[".html"]


def test_numbers_are_given_as_the_paper_gives_them() -> None:
    assert mean_and_sd(0.1349, 0.001) == "0.135 ± 0.001"
    assert mean_and_sd(0.1349, None) == "0.135"
    assert median_and_range(0.78, 0.746, 0.82) == "0.780 [0.746-0.820]"
    assert median_and_range(0, 0, 0, digits=0) == "0"
    assert median_and_range(None, None, None) == "n/a"


def test_a_tsv_can_be_viewed_with_what_its_sidecar_says(tmp_path: Path) -> None:
    table, sidecar = tmp_path / "t.tsv", tmp_path / "t.json"
    table.write_text("case\tq\nsub-1\t0.4\n")
    sidecar.write_text(
        json.dumps({"case": {"Description": "Name"}, "q": {"Description": "Worst q", "Threshold": "< 0.6"}})
    )
    write_view(table, sidecar, tmp_path / "t.html", title="Quality")
    page = (tmp_path / "t.html").read_text()
    assert "<th>case</th><th>q</th>" in page and "<td>sub-1</td><td>0.4</td>" in page
    assert "<dt>q</dt><dd>Worst q; threshold: &lt; 0.6</dd>" in page
