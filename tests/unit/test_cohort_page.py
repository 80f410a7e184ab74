"""The page of a cohort: failures, then outliers, then the rest; every case leads to its page."""

from __future__ import annotations

import base64
import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.image import imsave

from cortet.cohort.status import COLUMNS
from cortet.folding.cohort_folding import COLUMNS as FOLDING
from cortet.folding.cohort_folding import panel
from cortet.formats.atomic import write_json
from cortet.formats.tables import names
from cortet.formats.tsv import write_tsv
from cortet.neighbours import OnPage
from cortet.report.cohort_page import ordered, with_outliers, write_cohort_page

WORST = {"a": 0.50, "b": 0.51, "c": 0.49, "d": 0.50, "e": 0.58, "f": 0.505, "h": 0.495, "i": 0.50, "j": 0.50, "k": 0.50}
MESH = {"cell_size_mm": "0.6", "mesher": "cgal", "state": "certified", "q_mean": "0.129"}


def measured(**values: float) -> list[dict[str, str]]:
    return [{**MESH, "case": case, "q_max": str(q)} for case, q in values.items()]


def other(case: str, state: str) -> dict[str, str]:
    return {"case": case, "state": state, "cell_size_mm": "0.6", "mesher": "cgal"}


#: a picture of no pixel
DOT = "data:image/webp;base64,"


def written(folder: Path, rows: list[dict[str, Any]], quality: list[dict[str, Any]] | None = None) -> str:
    """The page of a cohort of these rows of the status and of the quality table."""
    write_tsv(rows, names(COLUMNS), folder / "status.tsv")
    tables = None
    if quality:
        tables = folder / "quality.tsv", folder / "quality.json"
        write_tsv(quality, list(quality[0]), tables[0])
        write_json({"q_max": {"Description": "Largest q", "Threshold": "< 0.6"}}, tables[1])
    pages = [
        {**row, "cell_size_mm": 0.6, "scan_age": 26.0, "page": f"../{row['case']}.html", "thumbnail": DOT}
        for row in rows
        if row["state"] != "excluded"
    ]
    write_cohort_page(folder / "status.tsv", tables, folder / "index.html", meshes=pages)
    return (folder / "index.html").read_text(encoding="utf-8")


def cases(page: str) -> list[str]:
    return re.findall(r'<th scope="row">(?:<a [^>]*>)?(\w+)', page)


def checked(rows: list[dict[str, str]]) -> pd.DataFrame:
    return with_outliers(pd.DataFrame(rows).fillna("n/a"), 0.6)


def test_an_outlier_is_more_than_halfway_from_the_others_to_the_limit() -> None:
    rows = checked(measured(**dict.fromkeys("abc", 0.3), d=0.44, e=0.46, f=0.25)).set_index("case")
    assert pd.to_numeric(rows["outlier"]).to_dict() == pytest.approx(
        {"a": 0, "b": 0, "c": 0, "d": 0.14 / 0.3, "e": 0.16 / 0.3, "f": 0}
    )
    assert list(rows.index[rows["outlying"] != ""]) == ["e"] and "0.460" in rows.loc["e", "outlying"]


def test_good_meshes_that_differ_by_chance_are_no_outliers() -> None:
    assert not any(checked(measured(**dict.fromkeys("abcdefgh", 0.3), i=0.324, j=0.33))["outlying"])


def test_without_a_limit_or_where_most_are_beyond_it_there_are_no_outliers() -> None:
    rows = pd.DataFrame(measured(a=0.3, b=0.3, c=0.5))
    assert not any(with_outliers(rows, None)["outlying"])
    assert not any(checked(measured(a=0.7, b=0.7, c=0.3))["outlying"])


def test_failures_come_first_then_the_farthest_outlier() -> None:
    rows = [*measured(**WORST), other("x", "excluded"), other("y", "failed"), other("z", "uncertified")]
    names = list(ordered(checked(rows))["case"])
    assert names[:3] == ["y", "z", "e"] and names[-1] == "x"


def test_meshes_of_other_cell_sizes_are_not_compared() -> None:
    coarse = [{**row, "cell_size_mm": "1"} for row in measured(g=0.59)]
    table = checked([*measured(**WORST), *coarse])
    assert list(table.loc[table["outlying"] != "", "case"]) == ["e"]


def test_every_case_leads_to_its_page(tmp_path: Path) -> None:
    rows = [{**MESH, "case": name, "stage": "certify"} for name in WORST]
    page = written(tmp_path, rows, measured(**WORST))
    assert set(re.findall(r'<a href="\.\./(\w+)\.html">', page)) == set(WORST)
    assert cases(page)[0] == "e"
    assert "limit &lt; 0.6" in page


def test_what_is_not_known_of_all_meshes_comes_from_the_quality_table(tmp_path: Path) -> None:
    rows = [{**MESH, "case": name, "stage": "certify"} for name in WORST]
    write_tsv(rows, names(COLUMNS), tmp_path / "status.tsv")
    measures = [{**row, "hemi": "L", "q_max": 0.5} for row in rows]
    write_tsv(measures, ["case", "cell_size_mm", "mesher", "hemi", "q_mean", "q_max"], tmp_path / "quality.tsv")
    write_json({}, tmp_path / "quality.json")
    pages = [{**row, "page": "x.html"} for row in rows]
    tables = (tmp_path / "quality.tsv", tmp_path / "quality.json")
    for meshes in (pages, []):
        write_cohort_page(tmp_path / "status.tsv", tables, tmp_path / "index.html", meshes=meshes)
        assert (tmp_path / "index.html").read_text(encoding="utf-8").count("<td>L</td>") == len(WORST)


def test_a_cohort_in_which_everything_failed_has_a_page_too(tmp_path: Path) -> None:
    failed = {**other("a", "failed"), "stage": "gate", "reason": "<script>alert(1)</script> (mend it)"}
    page = written(tmp_path, [failed, {"case": "b", "state": "excluded", "reason": "motion"}])
    assert cases(page) == ["a", "b"]
    assert re.findall(r'<th scope="row"><a href="(.*?)">', page) == ["../a.html"]
    assert "gate: &lt;script&gt;alert(1)&lt;/script&gt; (mend it)" in page and "motion" in page
    assert "<script>alert" not in page
    assert '<td class="n" data-value="26.0">26</td>' in page


def test_the_page_is_the_same_file_every_time(tmp_path: Path) -> None:
    rows = [{**MESH, "case": name, "stage": "certify"} for name in WORST]
    assert written(tmp_path, rows, measured(**WORST)) == written(tmp_path, rows[::-1], measured(**WORST))


def test_numbers_can_be_sorted_as_numbers(tmp_path: Path) -> None:
    page = written(tmp_path, [{**MESH, "case": name} for name in WORST], measured(**WORST))
    values = re.findall(r'data-value="([\d.]+)">0\.\d{4}</td>', page)
    assert sorted({float(value) for value in values} - {0.129}) == sorted(set(WORST.values()))
    with (tmp_path / "quality.tsv").open(newline="") as file:
        assert len(list(csv.DictReader(file, delimiter="\t"))) == len(WORST)


def test_folds_are_shown_with_what_stopped_them_and_where_their_pictures_are(tmp_path: Path) -> None:
    mesh = {"case": "a", "cell_size_mm": 0.6, "mesher": "cgal"}
    rows = [
        {**mesh, "variant": "thin", "state": "failed", "reason": "fold: killed"},
        {**mesh, "variant": None, "state": "folded", "reason": "folded", "gyrification_index": 1.23456, "min_j": 0.5},
    ]
    write_tsv(rows, names(FOLDING), tmp_path / "folds.tsv")
    (tmp_path / "folds.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"><text>curves</text></svg>')
    write_tsv([other("a", "certified")], names(COLUMNS), tmp_path / "status.tsv")
    folds = [{**mesh, "variant": variant, "folder": f"../a/Folded{variant or ''}"} for variant in (None, "thin")]
    shown = panel(tmp_path / "folds.tsv", tmp_path / "folds.svg", folds)
    write_cohort_page(
        tmp_path / "status.tsv",
        None,
        tmp_path / "index.html",
        meshes=[{**mesh, "page": "a.html"}],
        more=[OnPage([str(tmp_path / "folds.tsv")], [], None, lambda: None, lambda: [shown])],
    )
    page = (tmp_path / "index.html").read_text()
    section = page[page.index('id="folds"') :]
    assert section.index("fold: killed") < section.index("1.235")
    assert 'href="../a/Folded/folding.gif"' in section and "Foldedthin" not in section
    assert "folds.tsv" in section and "curves</text>" in section


def test_maps_on_the_common_mesh_are_part_of_the_page(tmp_path: Path) -> None:
    picture = tmp_path / "maps.png"
    imsave(picture, np.zeros((4, 6, 3)))
    write_tsv([other("a", "certified")], names(COLUMNS), tmp_path / "status.tsv")
    page = tmp_path / "index.html"
    write_cohort_page(tmp_path / "status.tsv", None, page, meshes=[], maps={"R": picture})
    (shown,) = re.findall(r'<img src="data:image/png;base64,(.*?)" width="6" height="4" alt="(.*?)">', page.read_text())
    assert base64.b64decode(shown[0]) == picture.read_bytes() and "right hemispheres" in shown[1]


def test_a_case_has_its_thumbnail_and_an_excluded_one_has_none(tmp_path: Path) -> None:
    page = written(tmp_path, [other("sub-a", "failed"), other("sub-b", "excluded")])
    assert re.findall(r'<img class="thumbnail" src="([^"]*)"', page) == [DOT]
