"""A sheet with and without spheres: those that have one are put onto the common mesh, with their fields."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cortet.cohort.sheet import PHANTOM
from cortet.formats.gifti import read_surface, write_surface
from cortet.geometry.icosphere import icosphere
from cortet.meshes import TriSurface
from tests.integration.study import Study, surface

pytestmark = pytest.mark.thorough


@pytest.fixture
def spheres(study: Study) -> Study:
    """Three eggs, of which the last two have spheres, the second a field and an inner surface, the third in metres."""
    study.config["resample"] = {"subdivisions": 4}
    study.config["certify"] |= {"max_surface_distance": 1.0}
    folder, egg = study.folder / "surfaces", surface(1)
    without, *cases = *study.cases(), study.case("c")
    cases = [replace(case, sphere=folder / f"{case.participant}.sphere.surf.gii") for case in cases]
    for case in cases:
        write_surface(replace(egg, points=5 * egg.points / np.linalg.norm(egg.points, axis=1)[:, None]), case.sphere)
    white, height = (folder / f"b_{what}.gii" for what in ("white.surf", "height.shape"))
    write_surface(replace(egg, points=0.7 * egg.points), white)
    write_surface(replace(egg, point_data={"height": egg.points[:, 2]}), height)
    write_surface(replace(egg, points=egg.points / 1000), folder / "c.surf.gii")
    mm, metres = cases
    study.write_cases(
        [without, replace(mm, inner={"white": white}, fields={"height": height}), replace(metres, unit="m")]
    )
    return study


def test_cases_with_spheres_share_triangles_and_the_others_stay_as_they_are(spheres):
    study = spheres
    first = study.jobs_of_run()
    assert {case for rule, case in first if rule == "resample"} == {"sub-b", "sub-c"}
    assert [path.name[:5] for path in study.files("*_inner-white_desc-resampled_white.surf.gii")] == ["sub-b"]
    meshed = {name: read_surface(study.files(f"sub-{name}_hemi-L_desc-smoothed_white.surf.gii")[0]) for name in "abc"}
    assert len(meshed["a"].points) == 642
    assert all((meshed[name].faces == icosphere(4).faces).all() for name in "bc")
    assert np.abs(meshed["b"].points - meshed["c"].points).max() < 1e-4, "the same egg in mm and in m"
    (fields,) = study.files("sub-b*desc-fields_white.surf.gii")
    egg = read_surface(fields)
    assert egg.point_data["height"] == pytest.approx(egg.points[:, 2], abs=0.3)

    report = json.loads(study.files("sub-b*Solver_certificate.json")[0].read_text())["reports"]["resample"]
    assert report["vertices"] == report["inner"]["white"]["vertices"] == 2562
    maps = read_surface(study.files("sub-b*desc-latticeSolver_maps.surf.gii")[0])
    assert np.abs(maps.points - meshed["b"].points).max() == 0 and "distance_to_boundary" in maps.point_data
    both = json.loads((study.outputs / "cohort/hemi-L_desc-mean_maps.json").read_text())
    assert both["Cases"] == ["sub-b_hemi-L", "sub-c_hemi-L"]
    assert both["CasesOfMap"] == {"height": 1, "thickness": 1, "distance_to_boundary": 2}
    mean = read_surface(study.outputs / "cohort/hemi-L_desc-mean_white.surf.gii")
    assert np.abs(mean.points - meshed["b"].points).max() < 1e-4
    assert (study.outputs / "cohort/figure-maps_hemi-L.png").stat().st_size > 10_000

    rows = study._table("cohort_quality", "case")
    assert rows["sub-a_hemi-L"]["resample_native_to_resampled_max_mm"] == "n/a"
    assert float(rows["sub-b_hemi-L"]["resample_native_to_resampled_max_mm"]) == pytest.approx(
        report["native_to_resampled_mm"]["max"], rel=1e-3
    )
    assert "On the common mesh" in study.files("sub-b*report.html")[0].read_text()

    sphere = Path(study.cases()[1].sphere or "")
    old = read_surface(sphere)
    write_surface(TriSurface(old.points @ [[0, 1, 0], [1, 0, 0], [0, 0, -1]], old.faces), sphere)
    again = study.planned_jobs()
    assert {case for _, case in again} == {"sub-b", "-"} and ("resample", "sub-b") in again
    assert ("cohort_page", "-") in again


def test_a_phantom_comes_with_its_sphere(tmp_path):
    study = Study(tmp_path)
    study.config |= {"phantom": {"subdivisions": 4}, "resample": {"subdivisions": 3}}
    study.write_cases([replace(study.case("p"), surface=PHANTOM, sphere=PHANTOM)])
    assert {("phantom", "sub-p"), ("resample", "sub-p")} <= study.planned_jobs()
    study.run("derivatives/cortet/sub-p/anat/sub-p_hemi-L_desc-gated_white.surf.gii")
    assert len(read_surface(study.files("*desc-gated_white.surf.gii")[0]).points) == 642
