"""The files of a citation: each cites what the run used, and the references are there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from cortet.report.citation import cited, write_citation

METHODS = "Of 2 meshes, q = 1 - √2 · 6V / l³ < 0.6 in 100 % of sub-01_hemi-L."
CERTIFICATES: list[dict[str, Any]] = [
    {"versions": {"numpy": "2.0", "pygalmesh": "0.10", "python": "3.11"}, "reports": {"repair": {}}},
    {"versions": {"numpy": "2.0", "tetgen": "0.6"}, "reports": {}},
]


@pytest.fixture
def files(tmp_path: Path) -> dict[str, str]:
    paths = [str(tmp_path / f"CITATION.{suffix}") for suffix in ("md", "bib", "tex", "html")]
    write_citation(METHODS, CERTIFICATES, *paths)
    return {Path(path).suffix: Path(path).read_text(encoding="utf-8") for path in paths}


def test_what_was_used_is_cited() -> None:
    assert cited(CERTIFICATES) == ["cortet", "cortetsoftware", "tetgen", "cgal", "numpy"]
    assert "workbench" in cited([{"versions": {}, "reports": {"resample": {"vertices": 40962}}}])


def test_every_key_that_is_cited_is_an_entry(files: dict[str, str]) -> None:
    entries = re.findall(r"^@\w+\{(\w+),$", files[".bib"], flags=re.MULTILINE)
    assert entries == cited(CERTIFICATES)
    assert re.findall(r"@(\w+)", files[".md"]) == entries
    assert re.search(r"\\cite\{(.*)\}\.", files[".tex"])[1].split(",") == entries
    assert re.findall(r'<li id="(\w+)">', files[".html"]) == re.findall(r'href="#(\w+)"', files[".html"]) == entries
    assert files[".bib"].count("{") == files[".bib"].count("}")


def test_each_form_has_the_paragraph_as_it_needs_it(files: dict[str, str]) -> None:
    assert files[".md"].startswith(METHODS)
    assert r"$\surd$2 $\cdot$ 6V / l\textsuperscript{3} \textless{} 0.6 in 100 \% of sub-01\_hemi-L" in files[".tex"]
    assert files[".tex"].isascii()
    assert "6V / l³ &lt; 0.6" in files[".html"]
