"""Inner surfaces, volumes, spheres and folds of cases: what is new or edited reruns its case and no other."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cortet.cohort.sheet import PHANTOM
from cortet.formats import read_mesh, vtu
from cortet.formats.gifti import read_surface, write_surface
from cortet.formats.tsv import read_tsv
from cortet.formats.volumes import write_volume
from cortet.geometry.icosphere import icosphere
from cortet.meshes import REGION, TriSurface
from tests.integration.study import STATUS, Study, scaled, surface
from tests.integration.test_reruns import COHORT, FROM_GATE, jobs

pytestmark = pytest.mark.thorough


def test_cases_with_and_without_inner_surfaces(study):
    study.config["export"] = {"formats": ["abaqus"], "layers": 1}
    study.config["certify"] |= {"max_surface_distance": 1.0}
    inner = study.folder / "surfaces/b_white.surf.gii"
    without, case = study.cases()
    study.write_cases([without, replace(case, inner={"white": inner})])
    write_surface(surface(1), inner)
    scaled(inner, 0.7)
    first = study.jobs_of_run(STATUS)
    assert {case for rule, case in first if rule == "separate"} == {"sub-b"}
    assert {rule for rule, case in first if case == "sub-a"} == {"solver_ready", "export"}, "it had been meshed before"

    assert study.status()["sub-b_hemi-L"]["state"] == "certified"
    certificate = json.loads(study.files("sub-b*Solver_certificate.json")[0].read_text())
    assert [region["name"] for region in certificate["regions"]] == ["cortex", "white"]
    assert certificate["reports"]["separate"]["surfaces"][0]["vertices_moved"] == 0
    mesh = vtu.read(study.files("sub-b*Ordered_tetmesh.vtu")[0])
    assert np.unique(mesh.cell_data[REGION]).tolist() == [1, 2]
    assert REGION not in vtu.read(study.files("sub-a*Ordered_tetmesh.vtu")[0]).cell_data
    assert "NAME=white_interface" in study.files("sub-b*Solver_tetmesh.inp")[0].read_text()

    outer = study.files("sub-b_hemi-L_desc-gated_white.surf.gii")[0]
    gated = outer.stat().st_mtime_ns
    scaled(inner, 0.65 / 0.7)
    again = study.jobs_of_run(STATUS)
    assert {case for _, case in again} == {"sub-b", "-"}
    assert {rule for rule, case in again if case == "sub-b"} >= {"gate", "separate", "generate", "export"}
    assert outer.stat().st_mtime_ns == gated, "the outer surface is as it was"
    assert not study.planned_jobs(STATUS)
    study.run("participants")
    pages = [study.files(f"sub-{name}_*_report.html")[0].read_text() for name in "ab"]
    assert ["Layers of the cortex" in page for page in pages] == [False, True]
    assert study.status()["sub-b_hemi-L"]["state"] == "certified"


def test_the_labels_of_a_volume_are_sets_another_volume_reruns_no_mesh_and_a_bad_one_is_said(study):
    study.config["export"] = {"formats": ["abaqus"]}
    given = surface(1)  # of the second case
    middle = given.points.mean(axis=0)
    affine = np.eye(4)
    affine[:3, 3] = np.floor(given.points.min(axis=0)) - 2
    shape = np.ceil(given.points.max(axis=0) - affine[:3, 3]).astype(int) + 3
    front = np.indices(shape)[1] + affine[1, 3] > middle[1]
    file = study.folder / "surfaces/b_dseg.nii.gz"
    first, second = study.cases()
    study.write_cases([first, replace(second, volumes={"tissue": str(file)})])
    write_volume(np.where(front, 2, 1).astype(np.int16), affine, file)
    file.with_name("b_dseg.tsv").write_text("index\tname\n1\tback\n2\tfront\n")
    ran = study.jobs_of_run()
    assert {rule for rule, case in ran if case == "sub-b"} == {"volumes", "export", "case_page"}
    assert {rule for rule, case in ran if case == "sub-a"} == {"export", "case_page"}

    made = read_mesh(study.files("sub-b*Solver_tetmesh.inp")[0])
    label = vtu.read(study.files("sub-b*Ordered_volumes.vtu")[0]).cell_data["tissue"]
    np.testing.assert_array_equal(made.sets.cells["tissue_front"], np.flatnonzero(label == 2))
    shown = ["In the volume" in study.files(f"sub-{name}*Solver_report.html")[0].read_text() for name in "ab"]
    assert shown == [False, True] and study.files("sub-b*Solver_slices.png")
    assert read_tsv(study.outputs / "cohort/cohort_tissues.tsv")["name"].tolist() == ["back", "front"]

    file.with_name("b_dseg.tsv").write_text("index\tname\n1\tback\n2\tfrontal\n")
    again = {rule for rule, case in study.jobs_of_run() if case == "sub-b"}
    assert again == {"volumes", "export", "case_page"}
    assert "frontal" in read_tsv(study.outputs / "cohort/cohort_tissues.tsv")["name"].tolist()
    assert "tissue_frontal" in read_mesh(study.files("sub-b*Solver_tetmesh.inp")[0]).sets.cells

    write_volume(np.where(front, 2, 1).astype(np.int16), affine + 100 * np.eye(4, k=3), file)
    study.jobs_of_run(succeeds=False)
    row = study.status()["sub-b_hemi-L"]
    assert row["state"] == "failed" and "outside the volume" in row["reason"]
    assert study.status()["sub-a_hemi-L"]["state"] == "certified"
    assert study.files("sub-b*Solver_report.html")  # the mesh is certified, and has its page


def test_contacts_of_a_case_are_loads_of_its_mesh_other_ones_rerun_it_alone_and_wrong_ones_are_said(study):
    study.config["generate"] = {"cell_size": [4.0]}  # of the mesher that makes cells smaller
    first, second = study.cases()
    top = surface(1).points[surface(1).points[:, 2].argmax()].tolist()
    file = study.folder / "surfaces/sub-b_electrodes.tsv"

    def contacts(*rows: str) -> None:
        file.write_text("\n".join(["name\tx\ty\tz\tsize", *(row.replace(" ", "\t") for row in rows)]) + "\n")

    study.write_cases([first, replace(second, electrodes=file)])
    at = " ".join(f"{value:.3f}" for value in top)
    contacts(f"A1 {at} 28.3")
    study.jobs_of_run()
    assert {row["state"] for row in study.status().values()} == {"certified"}
    certificate = json.loads(study.files("sub-b*Solver_certificate.json")[0].read_text())
    (contact,) = certificate["electrodes"]
    assert (contact["name"], contact["kind"], contact["radius_mm"]) == ("A1", "disc", pytest.approx(3, abs=0.01))
    made = read_mesh(study.files("sub-b*Solver_sets.vtu")[0])
    assert made.point_data["electrode_A1"].sum() == pytest.approx(1, abs=1e-12)
    assert len(made.sets.faces["electrode_A1"]) == contact["faces"]
    sizes = [json.loads(study.files(f"sub-{name}*Generated_quality.json")[0].read_text())["tets"] for name in "ab"]
    assert sizes[1] > 1.1 * sizes[0], "its cells are smaller around the contact"
    shown = ["Contacts" in study.files(f"sub-{name}*Solver_report.html")[0].read_text() for name in "ab"]
    assert shown == [False, True]
    file.touch()
    assert not study.planned_jobs(STATUS)

    contacts(f"A1 {at} 28.3", f"B1 {at.replace(at.split()[2], '0')} n/a")
    assert {case for _, case in study.jobs_of_run(STATUS)} == {"sub-b", "-"}
    assert len(json.loads(study.files("sub-b*Solver_certificate.json")[0].read_text())["electrodes"]) == 2
    system = file.with_name("sub-b_coordsystem.json")
    system.write_text('{"iEEGCoordinateSystem": "ACPC", "iEEGCoordinateUnits": "mm"}')
    study.jobs_of_run(STATUS, succeeds=False)
    row = study.status()["sub-b_hemi-L"]
    assert row["state"] == "failed" and "space ACPC" in row["reason"]
    system.unlink()
    file.unlink()
    study.jobs_of_run(STATUS, succeeds=False)
    assert "sub-b_electrodes.tsv" in study.status()["sub-b_hemi-L"]["reason"]
    assert study.status()["sub-a_hemi-L"]["state"] == "certified"


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

    both = json.loads((study.outputs / "cohort/hemi-L_desc-mean_maps.json").read_text())
    assert both["Cases"] == ["sub-b_hemi-L", "sub-c_hemi-L"]
    assert both["CasesOfMap"] == {"height": 1, "thickness": 1, "distance_to_boundary": 2}
    mean = read_surface(study.outputs / "cohort/hemi-L_desc-mean_white.surf.gii")
    assert np.abs(mean.points - meshed["b"].points).max() < 1e-4
    assert (study.outputs / "cohort/figure-maps_hemi-L.png").stat().st_size > 10_000

    sphere = Path(study.cases()[1].sphere or "")
    old = read_surface(sphere)
    write_surface(TriSurface(old.points @ [[0, 1, 0], [1, 0, 0], [0, 0, -1]], old.faces), sphere)
    again = study.planned_jobs()
    assert {case for _, case in again} == {"sub-b", "-"} and ("resample", "sub-b") in again
    assert ("cohort_page", "-") in again


def test_all_cases_are_folded_under_every_variant(study):
    real = shutil.copy(study.folder / "surfaces/a.surf.gii", study.folder / "real_L.surf.gii")
    study.config["fold"] = {
        "force": True,
        "cases": "all",
        "real_surfaces": {24.2: "real_{hemi}.surf.gii"},
        "end": 24.2,
        "thickness": 3.0,
        "frame_interval": 0.2,
        "surfaces": [24.1],
        "picture": "depth",
        "variants": {
            "wild": {"thickness": 2.0, "growth_rate": 2000.0, "end": 40.0, "record_interval": 0.5, "surfaces": []}
        },
    }
    jobs = study.jobs_of_run()
    assert {("fold", "sub-a"), ("fold", "sub-b"), ("cohort_page", "-")} <= jobs
    with (study.outputs / "cohort/cohort_folding.tsv").open(newline="") as file:
        rows = {(row["case"], row["variant"]): row for row in csv.DictReader(file, delimiter="\t")}
    assert set(rows) == {(f"sub-{name}_hemi-L", variant) for name in "ab" for variant in ("n/a", "wild")}
    states = {key: row["state"] for key, row in rows.items()}
    assert {state for (_, variant), state in states.items() if variant != "wild"} == {"folded"}
    assert {state for (_, variant), state in states.items() if variant == "wild"} == {"inverted"}
    assert float(rows["sub-a_hemi-L", "wild"]["thickness_mm"]) == 2.0
    assert float(rows["sub-a_hemi-L", "n/a"]["thickness_mm"]) == 3.0
    page = (study.outputs / "cohort/index.html").read_text()
    assert page.count("by age") == 4 and "FoldedWild/folding.gif" in page
    home = sorted(study.outputs.glob("sub-*/**/simulation/*Folded/*_week-24.1_*"))
    assert {("folded_surface", "sub-a"), ("folded_surface", "sub-b")} <= jobs and len(home) == 2 * 15
    a = [read_surface(file) for file in home if file.name == "sub-a_hemi-L_week-24.1_white.surf.gii"]
    given = read_surface(study.folder / "surfaces/a.surf.gii")
    assert [np.array_equal(one.faces, given.faces) for one in a] == [True] and (a[0].points != given.points).any()
    assert study.planned_jobs() == set()
    scaled(real, 1.1)
    assert study.planned_jobs() == {("fold_figures", "sub-a"), ("fold_figures", "sub-b")}


def test_a_phantom_comes_with_its_sphere(tmp_path):
    study = Study(tmp_path)
    study.config |= {"phantom": {"subdivisions": 4}, "resample": {"subdivisions": 3}}
    study.write_cases([replace(study.case("p"), surface=PHANTOM, sphere=PHANTOM)])
    study.run("derivatives/cortet/sub-p/anat/sub-p_hemi-L_desc-gated_white.surf.gii")
    assert len(read_surface(study.files("*desc-gated_white.surf.gii")[0]).points) == 642


def test_without_intermediates_only_what_changed_runs_again(study):
    study.config["keep_intermediates"] = False
    assert study.planned_jobs() == set()
    deleted = study.run("--delete-temp-output")
    assert deleted.returncode == 0, deleted.stdout + deleted.stderr
    assert len(study.files("*_tetmesh.vtu")) == len(study.files("*Ordered_tetmesh.vtu")) == 2
    assert study.planned_jobs() == set()

    study.config["clean"] = {"thresholds": [0.65]}
    assert study.planned_jobs() == jobs(FROM_GATE - {"gate", "smooth_surface"}, "a", "b") | COHORT
    del study.config["clean"]

    first, second = study.files("*_sets.vtu")
    before = first.read_bytes(), second.read_bytes()
    scaled(study.folder / "surfaces/a.surf.gii", 1.05)
    assert study.jobs_of_run() == jobs(FROM_GATE, "a") | COHORT
    assert first.read_bytes() != before[0] and second.read_bytes() == before[1]
    assert len(study.files("*_tetmesh.vtu")) == 2
    assert study.planned_jobs() == set()
