"""The files of a citation: each cites what the run used, and the references are there."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cortet.config import load
from cortet.meshes import TriSurface
from cortet.pipeline import mesh_surface
from cortet.report.citation import cited, write_citation
from tests.unit.shapes import ball_surface

METHODS = "Of 2 meshes, q = 1 - √2 · 6V / l³ < 0.6 in 100 % of sub-01_hemi-L."
BALL = ball_surface(3, 12.0)


def certificate(setting: str, surface: TriSurface = BALL, **options: Any) -> dict[str, Any]:
    """Of a real mesh, as `cortet.measure.certify` makes it; it names every library that is installed here."""
    config = load({"setting": setting, "generate": {"cell_size": 4.0}, "resample": {"subdivisions": 3}})
    return asdict(mesh_surface(surface, config, **options).certificate)


@pytest.fixture(scope="module")
def certificates() -> list[dict[str, Any]]:
    return [certificate("cgal"), certificate("default")]


@pytest.fixture
def files(certificates: list[dict[str, Any]], tmp_path: Path) -> dict[str, str]:
    paths = [str(tmp_path / f"CITATION.{suffix}") for suffix in ("md", "bib")]
    write_citation(METHODS, certificates, *paths)
    return {Path(path).suffix: Path(path).read_text(encoding="utf-8") for path in paths}


def test_what_was_used_is_cited(certificates: list[dict[str, Any]]) -> None:
    assert cited(certificates) == ["cortet", "cortetsoftware", "tetgen", "cgal", "gmsh", "numpy", "scipy", "numba"]
    assert "workbench" in cited([certificate("default", sphere=BALL)])
    noise = np.random.default_rng(0).normal(1, 0.01, (len(BALL.points), 1))
    smoothed = certificate("default", TriSurface(BALL.points * noise, BALL.faces), gestational_age=24.0)
    assert {"pymeshlab", "taubin"} <= {*cited([smoothed])}


def test_what_is_only_installed_is_not_cited(certificates: list[dict[str, Any]]) -> None:
    default = certificates[1]
    assert {"gmsh", "pymeshlab"} <= default["versions"].keys()
    assert not {"gmsh", "pymeshlab", "cgal", "workbench"} & {*cited([default])}


def test_every_key_that_is_cited_is_an_entry(certificates: list[dict[str, Any]], files: dict[str, str]) -> None:
    entries = re.findall(r"^@\w+\{(\w+),$", files[".bib"], flags=re.MULTILINE)
    assert entries == cited(certificates)
    assert re.findall(r"@(\w+)", files[".md"]) == entries
    assert files[".bib"].count("{") == files[".bib"].count("}")


def test_the_markdown_begins_with_the_paragraph(files: dict[str, str]) -> None:
    assert files[".md"].startswith(METHODS)
