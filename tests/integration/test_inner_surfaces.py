"""A sheet with and without inner surfaces: one that is new or edited reruns its case and leaves the other as it is."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from cortet.formats import vtu
from cortet.formats.gifti import write_surface
from cortet.meshes import REGION, TriSurface
from tests.integration.study import STATUS, surface

pytestmark = pytest.mark.thorough


def shrunk(one: TriSurface, factor: float) -> TriSurface:
    return replace(one, points=one.points * factor)


def test_cases_with_and_without_inner_surfaces(study):
    study.config["export"] = {"formats": ["abaqus"], "layers": 1}
    study.config["certify"] |= {"max_surface_distance": 1.0}
    inner = study.folder / "surfaces/b_white.surf.gii"
    without, case = study.cases()
    study.write_cases([without, replace(case, inner={"white": inner})])
    write_surface(shrunk(surface(1), 0.7), inner)
    first = study.jobs_of_run(STATUS)
    assert {case for rule, case in first if rule == "separate"} == {"sub-b"}
    assert {rule for rule, case in first if case == "sub-a"} == {"solver_ready", "export"}, "it had been meshed before"

    assert study.status()["sub-b_hemi-L"]["state"] == "certified"
    certificate = json.loads(study.files("sub-b*Solver_certificate.json")[0].read_text())
    assert [region["name"] for region in certificate["regions"]] == ["cortex", "white"]
    assert certificate["reports"]["separate"]["surfaces"][0]["vertices_moved"] == 0
    mesh = vtu.read(study.files("sub-b*Solver_tetmesh.vtu")[0])
    assert np.unique(mesh.cell_data[REGION]).tolist() == [1, 2]
    assert REGION not in vtu.read(study.files("sub-a*Solver_tetmesh.vtu")[0]).cell_data
    assert "NAME=white_interface" in study.files("sub-b*Solver_tetmesh.inp")[0].read_text()

    outer = study.files("sub-b_hemi-L_desc-gated_white.surf.gii")[0]
    gated = outer.stat().st_mtime_ns
    write_surface(shrunk(surface(1), 0.65), inner)
    again = study.jobs_of_run(STATUS)
    assert {case for _, case in again} == {"sub-b", "-"}
    assert {rule for rule, case in again if case == "sub-b"} >= {"gate", "separate", "generate", "export"}
    assert outer.stat().st_mtime_ns == gated, "the outer surface is as it was"
    assert not study.planned_jobs(STATUS)
    study.run("participants")
    pages = [study.files(f"sub-{name}_*_report.html")[0].read_text() for name in "ab"]
    assert ["Layers of the cortex" in page for page in pages] == [False, True]
    assert study.status()["sub-b_hemi-L"]["state"] == "certified"
