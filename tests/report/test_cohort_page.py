"""The page of a cohort: failures, then the worst elements; every case leads to its page."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pandas as pd

from cortet.cohort.states import COLUMNS
from cortet.formats.atomic import write_json
from cortet.formats.tables import names
from cortet.formats.tsv import write_tsv
from cortet.report.cohort_page import ordered, write_cohort_page

MESH = {"cell_size_mm": "0.6", "mesher": "cgal"}
#: a picture of no pixel
DOT = "data:image/webp;base64,"


WORST = [
    {**MESH, "state": "certified", "q_mean": "0.129", "case": case, "q_max": q}
    for case, q in zip("abcdef", ("0.5", "0.51", "0.49", "0.5", "0.58", "0.505"), strict=True)
]


def other(case: str, state: str, **more: Any) -> dict[str, Any]:
    return {**MESH, "case": case, "state": state, **more}


def written(folder: Path, rows: list[dict[str, Any]]) -> str:
    """The page of a cohort of these rows of the status, and of its quality table."""
    write_tsv(rows, names(COLUMNS), folder / "status.tsv")
    tables = folder / "quality.tsv", folder / "quality.json"
    write_tsv(WORST, list(WORST[0]), tables[0])
    write_json({"q_max": {"Description": "Largest q", "Threshold": "< 0.6"}}, tables[1])
    meshes = [
        {**row, "cell_size_mm": 0.6, "scan_age": 26.0, "page": f"../{row['case']}.html", "thumbnail": DOT}
        for row in rows
    ]
    write_cohort_page(folder / "status.tsv", tables, folder / "index.html", meshes=meshes)
    return (folder / "index.html").read_text(encoding="utf-8")


def test_failures_come_first_then_the_worst_elements():
    rows = [*WORST, other("x", "excluded"), other("y", "failed"), other("z", "uncertified")]
    assert "".join(ordered(pd.DataFrame(rows).fillna("n/a"))["case"]) == "yzebfadcx"


def test_every_case_leads_to_its_page_whatever_the_order_of_the_tables(tmp_path):
    page = written(tmp_path, WORST)
    assert set(re.findall(r'<th scope="row"><a href="\.\./(\w+)\.html">', page)) == set("abcdef")
    assert "limit &lt; 0.6" in page
    values = re.findall(r'data-value="([\d.]+)">0\.\d{4}</td>', page)
    assert {float(value) for value in values} == {0.129, *(float(row["q_max"]) for row in WORST)}, "to sort by"
    assert written(tmp_path, WORST[::-1]) == page
