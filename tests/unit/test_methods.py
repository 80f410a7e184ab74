"""The methods paragraph says what was run, on how many, and what was left out."""

from __future__ import annotations

import copy
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from cubes import cube_mesh

from cortet.cohort.sheet import Case
from cortet.config import load
from cortet.config.sections import Certify
from cortet.geometry.topology import boundary_surface
from cortet.measure.certify import certify
from cortet.report.methods import methods_text, write_methods
from cortet.stages import record_of

CASES = [
    Case("01", None, "L", 22.5, Path("a.surf.gii")),
    Case("01", None, "R", 22.5, Path("b.surf.gii")),
    Case("02", None, None, 30.0, "phantom"),
    Case("03", None, "L", None, Path("c.surf.gii"), include=False, exclude_reason="motion"),
]


def certificate(case: Case, setting: str = "cgal", **limits: Any) -> dict[str, Any]:
    mesh, config = cube_mesh(3, side=6.0), load({"setting": setting})
    stages = [stage for stage in ("smooth_surface", "relocate", "clean", "reconnect") if config.enabled(stage)]
    content = certify(
        mesh,
        boundary_surface(mesh)[0],
        Certify(**limits),
        case=case.name,
        parameters={
            "generate": record_of(config, "generate", {"cell_size": 0.6, "mesher": "cgal"}),
            **{stage: record_of(config, stage, {"gestational_age": 28.0, "cell_size": 0.6}) for stage in stages},
        },
        reports={"generate": {"topology_ok": True, "reason": "", "backend": "pygalmesh"}},
    )
    return json.loads(json.dumps(asdict(content)))


@pytest.fixture(scope="module")
def records() -> list[dict[str, Any]]:
    return [certificate(case) for case in CASES[:3]]


def test_it_counts_surfaces_participants_and_hemispheres(records: list[dict[str, Any]]) -> None:
    text = methods_text(records, CASES, {})
    assert "3 closed cortical surfaces (1 of them synthetic) of 2 participants" in text
    assert "(1 left hemisphere, 1 right hemisphere, 1 whole brain; gestational age at scan 22.5-30 weeks)" in text


def test_it_tells_of_ages_that_are_not_known(records: list[dict[str, Any]]) -> None:
    ageless = [replace(case, scan_age=None) for case in CASES[:3]]
    unsmoothed = copy.deepcopy(records)
    for record in unsmoothed:
        del record["parameters"]["smooth_surface"]
    text = methods_text(unsmoothed, ageless, {})
    assert "1 whole brain; age at scan not known)" in text and "smoothed" not in text
    for record in records:
        record["parameters"]["smooth_surface"]["method"] = "published"
    text = methods_text([unsmoothed[0], *records[1:]], [ageless[0], *CASES[1:]], {})
    assert "gestational age at scan 22.5-30 weeks, of 1 of them not known)" in text
    assert "Surfaces of known age were smoothed by age" in text


def test_it_names_what_was_left_out_and_why(records: list[dict[str, Any]]) -> None:
    text = methods_text(records, CASES, {"sub-02": "open surface"})
    assert "1 surface had been excluded: sub-03_hemi-L (motion)." in text
    assert "1 surface could not be meshed: sub-02 (open surface)." in text
    assert "No surface was excluded." in methods_text(records, CASES[:3], {})
    text = methods_text(records, CASES, {"sub-02": "derivatives/cortet/sub-02/b.vtu: is not closed"})
    assert "sub-02 (b.vtu: is not closed)" in text


def test_it_gives_the_parameters_of_each_stage_that_ran(records: list[dict[str, Any]]) -> None:
    text = methods_text(records, CASES, {})
    assert "cell size h = 0.6 mm by CGAL Mesh_3 through pygalmesh" in text
    assert "facet angle 25 degrees, facet distance 0.5, 0.2, 0.1, 0.05 h" in text
    assert "5 passes of Gmsh's Relocate3D (boundary nodes fixed)" in text
    assert "q > 0.7, 0.5, 0.3" in text and "local swaps" in text
    published = methods_text([certificate(CASES[0], "published")], CASES, {})
    assert "Relocate3D (boundary nodes free)" in published
    assert "swaps" not in published and "sweeps" not in published


def test_repaired_surfaces_are_told(records: list[dict[str, Any]]) -> None:
    repaired = copy.deepcopy(records[0])
    repaired["reports"]["repair"] = {
        "repaired": True,
        "steps": [{"done": "holes filled", "count": 1200, "of": "faces"}],
    }
    text = methods_text([repaired, *records[1:]], CASES, {})
    assert f"Of these surfaces, 1 had been repaired: {repaired['case']} (holes filled: 1,200 faces)." in text
    assert "repaired" not in methods_text(records, CASES, {})


def test_the_fallback_is_told(records: list[dict[str, Any]]) -> None:
    fallback = copy.deepcopy(records[0])
    fallback["reports"]["generate"]["backend"] = "tetgen"
    text = methods_text([fallback, *records[1:]], CASES, {})
    assert "2 meshes) and the fallback lattice, where CGAL's boundary had another topology (1)." in text


def test_it_gives_the_outcome_and_the_versions(records: list[dict[str, Any]]) -> None:
    text = methods_text([*records[:2], certificate(CASES[2], q_max=0.1)], CASES, {})
    assert "Of 3 meshes, 2 had a worst q below 0.6" in text
    assert "Not certified: sub-02 (worst q" in text
    assert f"NumPy {records[0]['versions']['numpy']}" in text
    assert "use a smaller" not in text and "TetGen" not in text  # no advice, and no program that was not used


def test_it_is_written_from_certificate_files(records: list[dict[str, Any]], tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text(json.dumps(records[0]))
    write_methods([str(tmp_path / "c.json")], CASES, {}, tmp_path / "methods.md")
    assert (tmp_path / "methods.md").read_text().startswith("Tetrahedral meshes were made of 1 closed")
    assert "\n1. The authors of CORTET" in (tmp_path / "methods.md").read_text()
