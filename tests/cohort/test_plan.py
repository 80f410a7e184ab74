"""What a run does: files that jobs read, parameters, what failed and what is over all cases."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cortet.cohort.jobs import Jobs
from cortet.cohort.plan import Plan
from cortet.cohort.sheet import PHANTOM, Case
from cortet.config import load

GOOD = Case("good", None, "L", 24.0, Path("good.surf.gii"))
PAIR = Case("pair", None, "R", None, Path("pial.surf.gii"), inner={"white": Path("white.surf.gii")})
MADE = Case("made", None, "L", 30.0, PHANTOM, sphere=PHANTOM)
OUT = Case("out", None, "L", 24.0, Path("out.surf.gii"), include=False, exclude_reason="motion")


def jobs(*cases: Case, **sections: Any) -> Jobs:
    data = {"output": "out", "generate": {"cell_size": 2.0}, **sections}
    settings = {"": load(data), "Published": load({**data, "setting": "published"})}
    return Jobs(Plan(settings, cases or (GOOD, PAIR, MADE, OUT)))


def job(case: Case, **wildcards: str) -> dict[str, str]:
    return {"folder": case.folder, "case": case.name, **wildcards}


def mesh_job(case: Case, **wildcards: str) -> dict[str, str]:
    return job(case, res="2000", mesher="lattice", **wildcards)


def test_the_line_of_a_case_follows_from_its_row():
    def line(case: Case, **more: str) -> list[str]:
        return [stage.name for stage in jobs().inputs.line(mesh_job(case, **more))]

    assert "separate" in line(PAIR) and "separate" not in line(GOOD)
    assert line(MADE)[0] == "resample"
    assert line(PAIR, setting="Published")[:3] == line(PAIR)[:3] == ["repair", "gate", "smooth_surface"], "one surface"
    assert "reconnect" not in line(PAIR, setting="Published")
    by_age = jobs(smooth_surface={"method": "published"})
    assert [step.name for step in by_age.inputs.line(mesh_job(PAIR))][2] == "separate", "its age is not known"


def test_stages_that_settings_share_run_by_those_of_the_line():
    asked = jobs(clean={"thresholds": [0.6]}, transfer={"interior": "harmonic"})
    published = mesh_job(GOOD, setting="Published")
    steps = asked.steps(["transfer", "clean"], published)
    assert steps["transfer"]["settings"] == {"transfer": {"interior": "harmonic"}}
    assert steps["clean"]["settings"]["clean"]["boundary"] == "free"


@pytest.mark.parametrize("cell_size", ["500", "2000"])
def test_a_job_asks_for_more_with_more_tetrahedra_and_after_it_was_killed(cell_size):
    asked = mesh_job(GOOD) | {"res": cell_size}
    assert jobs().megabytes("clean", asked, attempt=3) == 4 * jobs().megabytes("clean", asked, attempt=1)
    assert jobs().minutes("clean", asked) >= jobs().minutes("clean", mesh_job(GOOD))
    assert jobs().tets(job(GOOD)) == 0


def test_a_failure_counts_as_long_as_the_plan_has_its_job(tmp_path):
    """It counted by the times of files, which copying a study changes, or as long as its file lay there."""
    surface = tmp_path / "x.surf.gii"
    surface.write_text("a")
    case = replace(GOOD, surface=surface)

    def number(rule: str, case: Case = case, **sections: Any) -> str:
        return jobs(case, PAIR, **sections).made_from(rule, mesh_job(case))

    assert number("clean") == number("clean") != number("reconnect")
    assert number("clean", clean={"thresholds": [0.6]}) != number("clean")
    assert number("generate", clean={"thresholds": [0.6]}) == number("generate"), "it comes before S4"
    assert number("export", clean={"thresholds": [0.6]}) != number("export") != number("export", export={"formats": []})
    moved = tmp_path / "moved.surf.gii"
    moved.write_text("a")
    assert number("clean", replace(case, surface=moved)) == number("clean"), "names of files decide nothing"
    moved.write_text("b")
    assert number("clean", replace(case, surface=moved)) != number("clean")
    white = job(PAIR, region="_inner-white")
    assert jobs().made_from("gate", white) and not jobs(replace(PAIR, inner={})).made_from("gate", white)
