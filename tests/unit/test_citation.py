"""The files of a citation: each cites what the run used, and the references are there."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from cortet.config import load
from cortet.pipeline import mesh_surface
from cortet.report.citation import cited, write_citation
from tests.unit.shapes import ball_surface

METHODS = "Of 2 meshes, q = 1 - √2 · 6V / l³ < 0.6 in 100 % of sub-01_hemi-L."
CERTIFICATES: list[dict[str, Any]] = [
    {"reports": {"generate": {"mesher": "cgal", "backend": "pygalmesh"}}},
    {"reports": {"generate": {"mesher": "lattice", "backend": "tetgen"}}},
]


@pytest.fixture
def files(tmp_path: Path) -> dict[str, str]:
    paths = [str(tmp_path / f"CITATION.{suffix}") for suffix in ("md", "bib", "tex", "html")]
    write_citation(METHODS, CERTIFICATES, *paths)
    return {Path(path).suffix: Path(path).read_text(encoding="utf-8") for path in paths}


def test_what_was_used_is_cited() -> None:
    assert cited(CERTIFICATES) == ["cortet", "cortetsoftware", "tetgen", "cgal", "numpy", "scipy", "numba"]
    more = {"resample": {"vertices": 40962}, "relocate": {"passes": 5}, "smooth_surface": {"iterations": 3}}
    assert {"workbench", "gmsh", "pymeshlab"} <= {*cited([{"reports": more}])}


def test_what_is_only_installed_is_not_cited() -> None:
    """The certificate of a real mesh names every library that is installed here."""
    certificate = mesh_surface(ball_surface(3, 12.0), load({"generate": {"cell_size": 4.0}})).certificate
    assert {"gmsh", "pymeshlab"} <= certificate.versions.keys()
    assert not {"gmsh", "pymeshlab", "cgal"} & {*cited([asdict(certificate)])}


def test_every_key_that_is_cited_is_an_entry(files: dict[str, str]) -> None:
    entries = re.findall(r"^@\w+\{(\w+),$", files[".bib"], flags=re.MULTILINE)
    assert entries == cited(CERTIFICATES)
    assert re.findall(r"@(\w+)", files[".md"]) == entries
    assert re.search(r"\\cite\{(.*)\}\.", files[".tex"])[1].split(",") == entries
    assert re.findall(r'<li id="(\w+)">', files[".html"]) == entries
    assert re.findall(r'href="#(\w+)"', files[".html"]) == ["main", *entries]
    assert files[".bib"].count("{") == files[".bib"].count("}")


def test_each_form_has_the_paragraph_as_it_needs_it(files: dict[str, str]) -> None:
    assert files[".md"].startswith(METHODS)
    assert r"$\surd$2 $\cdot$ 6V / l\textsuperscript{3} \textless{} 0.6 in 100 \% of sub-01\_hemi-L" in files[".tex"]
    assert files[".tex"].isascii()
    assert "6V / l³ &lt; 0.6" in files[".html"]
