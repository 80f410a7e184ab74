"""The methods paragraph says what was run, on how many, what was left out, and cites what the run used."""

from __future__ import annotations

import copy
import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cubes import cube_mesh
from shapes import ball_surface

from cortet.cohort.sheet import Case
from cortet.config import load
from cortet.config.sections import Certify
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import certify
from cortet.meshes import TriSurface
from cortet.pipeline import mesh_surface
from cortet.report.methods import cited, methods_text, write_citation
from cortet.stages import STAGES
from cortet.stages.stage import About, State

CASES = [
    Case("01", None, "L", 22.5, Path("a.surf.gii")),
    Case("01", None, "R", 22.5, Path("b.surf.gii")),
    Case("02", None, None, 30.0, "phantom"),
    Case("03", None, "L", None, Path("c.surf.gii"), include=False, exclude_reason="motion"),
]
BALL = ball_surface(3, 12.0)


def certificate(case: Case, setting: str = "cgal", **limits: Any) -> dict[str, Any]:
    mesh, config = cube_mesh(3, side=6.0), load({"setting": setting})
    stages = [stage for stage in ("smooth_surface", "relocate", "clean", "reconnect") if config.enabled(stage)]
    content = certify(
        mesh,
        boundary_surface(mesh)[0],
        Certify(**limits),
        case=case.name,
        parameters={
            stage: STAGES[stage].record(config, About(gestational_age=28.0, cell_size=0.6, mesher="cgal"))
            for stage in ("generate", *stages)
        },
        reports={"generate": {"topology_ok": True, "reason": "", "backend": "pygalmesh"}},
    )
    return json.loads(json.dumps(asdict(content)))


@pytest.fixture(scope="module")
def made() -> list[dict[str, Any]]:
    return [certificate(case) for case in CASES[:3]]


@pytest.fixture
def records(made: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Contents of certificates that a test may change."""
    return copy.deepcopy(made)


def meshed(setting: str, surface: TriSurface = BALL, sphere: TriSurface | None = None, **known: Any) -> dict[str, Any]:
    """The certificate of a real mesh, which names every library that is installed here."""
    config = load({"setting": setting, "generate": {"cell_size": 4.0}, "resample": {"subdivisions": 3}})
    return asdict(mesh_surface(State(surface, sphere), config, About(**known)).certificate)


def test_it_counts_surfaces_and_names_what_was_left_out(records):
    text = methods_text(records, CASES, {"sub-02": "derivatives/cortet/sub-02/b.vtu: is not closed"})
    assert "3 closed cortical surfaces (1 of them synthetic) of 2 participants" in text
    assert "1 left hemisphere, 1 right hemisphere, 1 whole brain; gestational age at scan 22.5-30 weeks" in text
    assert "sub-03_hemi-L (motion)" in text and "sub-02 (b.vtu: is not closed)" in text
    assert "No surface was excluded." in methods_text(records, CASES[:3], {})


def test_what_was_used_is_cited_and_nothing_that_is_only_installed():
    cgal, default = meshed("cgal"), meshed("default")
    assert cited([cgal, default]) == ["cortet", "cortetsoftware", "tetgen", "cgal", "gmsh", "numpy", "scipy", "numba"]
    assert {"gmsh", "pymeshlab"} <= default["versions"].keys()
    assert not {"gmsh", "pymeshlab", "cgal", "workbench"} & {*cited([default])}
    assert "workbench" in cited([meshed("default", sphere=BALL)])
    noise = np.random.default_rng(0).normal(1, 0.01, (len(BALL.points), 1))
    smoothed = meshed("default", TriSurface(BALL.points * noise, BALL.faces), gestational_age=24.0)
    assert {"pymeshlab", "taubin"} <= {*cited([smoothed])}


def test_every_reference_of_the_files_is_an_entry(records, tmp_path):
    paragraph, (cites, entries) = "Of 2 meshes, √2.", (tmp_path / name for name in ("c.md", "c.bib"))
    write_citation(paragraph, records, str(cites), str(entries))
    keys = re.findall(r"^@\w+\{(\w+),$", entries.read_text(), flags=re.MULTILINE)
    assert keys == cited(records) == re.findall(r"@(\w+)", cites.read_text())
    assert entries.read_text().count("{") == entries.read_text().count("}")
    assert cites.read_text().startswith(paragraph)
