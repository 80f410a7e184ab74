"""What a run does: files that jobs read, parameters, what failed and what is over all cases."""

from __future__ import annotations

import re
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
from cortet.folding.plan import Folds
from cortet.formats.hashing import sha256
from cortet.paper.experiments import Experiments

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


def test_a_case_with_a_cell_size_of_its_own_is_meshed_at_that_size_alone():
    fine = replace(GOOD, participant="fine", cell_size=0.8)
    asked = plan(GOOD, fine, generate={"cell_size": [2.0, 1.5]}, fold={"cases": "all"})
    meshes = asked.each_case(asked.layout.certificate)
    assert {mesh[:2] for mesh in meshes} == {(GOOD.name, 2000), (GOOD.name, 1500), (fine.name, 800)}
    assert [row["cell_size_mm"] for row in Folds(asked).runs().values() if row["case"] == fine.name] == [0.8]


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


def test_a_bypassed_stage_is_not_read_from():
    asked, published = plan(), mesh_job(GOOD, setting="Published")
    assert asked.mesh_before("clean", mesh_job(GOOD)).endswith("desc-latticeGenerated_tetmesh.vtu")
    assert asked.mesh_before("relocate", published).endswith("desc-latticeTransferred_tetmesh.vtu")
    assert asked.mesh_before("clean", published).endswith("desc-latticePublishedRelocated_tetmesh.vtu")
    without = plan(reconnect={"enabled": False})
    assert without.mesh_before("solver_ready", mesh_job(GOOD)).endswith("desc-latticeCleaned_tetmesh.vtu")


def test_stages_that_settings_share_run_by_those_of_the_line():
    asked = plan(clean={"thresholds": [0.6]}, transfer={"interior": "harmonic"})
    published = mesh_job(GOOD, setting="Published")
    assert asked.arguments("transfer", published)["interior"] == "harmonic"
    assert asked.arguments("clean", published)["boundary"] == "free"
    assert asked.arguments("clean", mesh_job(GOOD))["boundary"] == "slide"


def test_an_inner_surface_is_told_that_it_is_one():
    inner, outer = job(PAIR, inner="white"), job(PAIR)
    assert plan().arguments("gate", inner)["inside"] and "inside" not in plan().arguments("gate", outer)
    assert plan().locations("gate", inner) == {"source": "white.surf.gii"}
    assert plan().locations("gate", outer) == {"source": "pial.surf.gii"}


def test_names_of_files_are_no_parameters():
    assert "source" not in plan().arguments("gate", job(GOOD))
    assert plan().stages_before("gate", job(GOOD)) == ["repair"]


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


def test_folds_are_asked_for_by_case_and_variant():
    asked = plan(fold={"cases": ["sub-good_hemi-L"], "variants": {"stiff": {"core_stiffness": 2.0}}})
    runs = Folds(asked).runs()
    assert [row["variant"] for row in runs.values()] == [None, "stiff"]
    assert all(path.startswith("out/sub-good/simulation/") for path in runs)
    assert [Folds(asked).arguments(mesh_job(GOOD, variant=name))["core_stiffness"] for name in ("Stiff", "")] == [
        2.0,
        None,
    ]


def test_pictures_of_a_fold_show_the_real_brains_of_its_hemisphere():
    asked = plan(GOOD, PAIR, fold={"real_surfaces": {22: "22_{hemi}.surf.gii", 28.5: "28.surf.gii"}})
    assert Folds(asked).real_surfaces(job(GOOD)) == {"22": "22_L.surf.gii", "28.5": "28.surf.gii"}
    assert Folds(asked).real_surfaces(job(PAIR)) == {"22": "22_R.surf.gii", "28.5": "28.surf.gii"}
    whole = replace(GOOD, hemi=None)
    assert Folds(plan(whole, fold=asked.config.fold.model_dump())).real_surfaces(job(whole)) == {"28.5": "28.surf.gii"}


def test_pictures_of_a_fold_show_a_map_of_its_weeks():
    weeks = {"surfaces": [22, 28.5, 40], "variants": {"short": {"end": 26.0}}}
    fold = plan(fold={"picture": "cortex_stress", **weeks})
    place = "out/sub-good/simulation/sub-good_hemi-L_res-2000um_desc-latticeFolded/sub-good_hemi-L_week-28.5_"
    shown = Folds(fold).pictured(mesh_job(GOOD, variant=""))
    assert list(shown) == ["28.5", "40"]
    assert shown["28.5"] == [f"{place}white.surf.gii", f"{place}cortexstress.shape.gii"]
    assert Folds(fold).pictured(mesh_job(GOOD, variant="Short")) == {}
    assert Folds(plan(fold=weeks)).pictured(mesh_job(GOOD, variant="")) == {}
    assert not {"picture", "real_surfaces", "variants", "cases"} & set(Folds(fold).arguments(mesh_job(GOOD)))


def test_maps_are_of_a_hemispheres_resampled_cases():
    assert list(plan().maps("L")) == ["sub-made_hemi-L"]


@pytest.mark.parametrize("cell_size", ["500", "2000"])
def test_a_job_asks_for_more_with_more_tetrahedra_and_after_it_was_killed(cell_size):
    asked = mesh_job(GOOD) | {"res": cell_size}
    assert plan().megabytes("clean", asked, attempt=3) == 4 * plan().megabytes("clean", asked, attempt=1)
    assert plan().minutes("clean", asked) >= plan().minutes("clean", mesh_job(GOOD))
    assert plan().tets(job(GOOD)) == 0


def test_what_one_case_lacks_is_for_its_job_to_say(tmp_path):
    """A plan is of all cases: it fails for none of them."""
    left = replace(GOOD, participant="left", sphere=Path("sphere.surf.gii"))
    whole = replace(left, participant="whole", hemi=None)
    made = plan(GOOD, left, whole, resample={"template": str(tmp_path / "{hemi}.surf.gii")})
    for case in (left, whole):
        surface, mesh = job(case), mesh_job(case)
        assert made.facts(surface)["source"] == made.facts(mesh)["source"] == "good.surf.gii"
        assert made.recorded_line(mesh) and made.paths(mesh) and made.input_sha256(mesh) and made.sphere(surface) == []
        assert made.template(surface) == []
    assert made.arguments("resample", job(whole))["template"] == str(tmp_path / "{hemi}.surf.gii")
    assert made.arguments("resample", job(left))["template"] == str(tmp_path / "L.surf.gii")


def test_planning_loads_nothing_heavy():
    """Every job plans, so each library here would cost each of them a quarter of a second and more."""
    heavy = ("numba", "scipy", "nibabel", "pymeshlab", "gmsh", "meshio", "pandas", "matplotlib")
    code = f"import sys, cortet.over_all; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_experiments_say_what_their_meshes_cost_at_most():
    ablation = {"meshers": ["cgal", "tetgen"], "time_limit": 7}
    sections = {"experiments": {"ablation": ablation, "resolution": {"cell_size": [2.0]}}}
    (said,) = Experiments(plan(GOOD, **sections)).costs()
    assert re.search(
        ": meshes of lattice: 1, .* CPU min; meshes of cgal: 1, .* CPU min; of tetgen: 1, up to 7 min", said
    )
    assert "--config" not in said
    (said,) = Experiments(Plan({"": load({"output": "out"})}, (GOOD,))).costs()
    assert "cgal" not in said.partition("--config")[0] and "[default, cgal, published]" in said.partition("--config")[2]
