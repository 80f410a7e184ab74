"""What a run does: files that jobs read, parameters, what failed and what is over all cases."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cortet.cohort.jobs import Mesh, existing_of
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import PHANTOM, Case
from cortet.config import load
from cortet.formats.hashing import sha256

GOOD = Case("good", None, "L", 24.0, Path("good.surf.gii"))
PAIR = Case("pair", None, "R", None, Path("pial.surf.gii"), inner={"white": Path("white.surf.gii")})
MADE = Case("made", None, "L", 30.0, PHANTOM, sphere=PHANTOM)
OUT = Case("out", None, "L", 24.0, Path("out.surf.gii"), include=False, exclude_reason="motion")


def plan(*cases: Case, failures: Mapping[Mesh, Any] | None = None, **sections: Any) -> Plan:
    data = {"output": "out", "generate": {"cell_size": 2.0}, **sections}
    settings = {"": load(data), "Published": load({**data, "setting": "published"})}
    return Plan(settings, cases or (GOOD, PAIR, MADE, OUT), failures or {})


def job(case: Case, **wildcards: str) -> dict[str, str]:
    return {"folder": case.folder, "case": case.name, **wildcards}


def mesh_job(case: Case, **wildcards: str) -> dict[str, str]:
    return job(case, res="2000", mesher="lattice", **wildcards)


def test_every_included_case_is_asked_for_at_every_size_by_every_mesher():
    asked = plan(generate={"cell_size": [2.0, 1.0], "meshers": ["lattice", "cgal"]})
    meshes = asked.each_case(asked.layout.certificate)
    assert len(meshes) == 3 * 2 * 2 and ("sub-out_hemi-L", 2000, "lattice") not in meshes


def test_the_line_of_a_case_follows_from_its_row():
    def line(case: Case, **more: str) -> list[str]:
        return [stage.name for stage in plan().line(mesh_job(case, **more))]

    assert "separate" in line(PAIR) and "separate" not in line(GOOD)
    assert line(MADE)[0] == "resample"
    assert "smooth_surface" in line(GOOD, setting="Published") and "smooth_surface" not in line(
        PAIR, setting="Published"
    )


def test_a_run_says_of_cases_without_an_age_what_is_not_done_with_them_and_no_more():
    by_age = {"smooth_surface": {"method": "published"}}
    for sections, said in (
        ({}, []),
        (by_age, ["smoothed"]),
        ({"fold": {"cases": "all"}}, ["folded"]),
        ({"fold": {"cases": 1}, **by_age}, ["smoothed or folded"]),
        ({"fold": {"cases": [GOOD.name]}}, []),
    ):
        notices = plan(**sections).notices()
        begin = [f"1 not {what} because the gestational age is unknown: {PAIR.name} (" for what in said]
        assert [notice.startswith(one) for notice, one in zip(notices, begin, strict=True)] == [True] * len(said)
    assert plan(GOOD, MADE, **by_age).notices() == []


def test_a_missing_file_is_no_input_and_a_phantom_is_made(tmp_path):
    there = replace(GOOD, surface=tmp_path / "there.surf.gii", fields={"t": tmp_path / "none.gii"})
    (tmp_path / "there.surf.gii").write_text("surface")
    asked = plan(there, PAIR, MADE)
    assert asked.surface(job(there)) == str(tmp_path / "there.surf.gii")
    assert existing_of(asked.field_paths)(job(there)) == []
    assert asked.field_paths(job(there)) == {"t": str(tmp_path / "none.gii")}
    assert asked.surface(job(PAIR)) == [] == asked.inner_source(job(PAIR, inner="white"))
    assert asked.surface(job(MADE)) == "out/{folder}/anat/{case}_desc-phantom_white.surf.gii"
    assert asked.input_sha256(job(there)) == {"surface": sha256(tmp_path / "there.surf.gii")}
    assert asked.input_sha256(job(PAIR)) == {"surface": None}
    assert asked.input_sha256(job(PAIR, inner="white")) == {"inner_white": None}
    assert asked.input_sha256(mesh_job(PAIR)) == {"surface": None, "inner_white": None}
    assert asked.input_sha256(job(MADE)) == {}


def test_what_failed_before_its_certificate_is_not_measured():
    early, late = ("sub-good_hemi-L", 2000, "lattice"), ("sub-pair_hemi-R", 2000, "lattice")
    failure = {"state": "failed", "reason": "a hole", "log": "x.log"}
    asked = plan(failures={early: {"stage": "gate", **failure}, late: {"stage": "export", **failure}})
    assert [path for path in asked.measured_certificates() if "sub-good" in path] == []
    assert len(asked.measured_certificates()) == 2 and len(asked.exported_files()) == 2
    assert asked.unmeasured() == {"sub-good_hemi-L": "a hole"}
    states = {row["case"]: (row.get("state"), "certificate" in row) for row in asked.status()}
    assert states == {
        "sub-good_hemi-L": ("failed", False),
        "sub-pair_hemi-R": ("failed", True),
        "sub-made_hemi-L": (None, True),
        "sub-out_hemi-L": ("excluded", False),
    }
    assert not asked.is_measured(early) and asked.is_measured(late)


def test_a_hole_that_no_case_has_is_told():
    (notice,) = plan(export={"formats": ["vtu"], "holes": ["white", "ventrcle"]}).notices()
    assert notice == "export.holes: no case has an inner surface ventrcle, they have white"
    assert plan().notices() == []


@pytest.mark.parametrize("cell_size", ["500", "2000"])
def test_a_job_asks_for_more_with_more_tetrahedra_and_after_it_was_killed(cell_size):
    asked = mesh_job(GOOD) | {"res": cell_size}
    assert plan().megabytes("clean", asked, attempt=3) == 4 * plan().megabytes("clean", asked, attempt=1)
    assert plan().minutes("clean", asked) >= plan().minutes("clean", mesh_job(GOOD))
    assert plan().tets(job(GOOD)) == 0


def test_planning_loads_nothing_heavy():
    """Every job plans, so each library here would cost each of them a quarter of a second and more."""
    heavy = ("numba", "scipy", "nibabel", "pymeshlab", "gmsh", "meshio", "pandas", "matplotlib")
    code = f"import sys, cortet.over_all; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
