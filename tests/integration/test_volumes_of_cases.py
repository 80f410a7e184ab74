"""A volume of a case: its labels are sets of the exported mesh, another volume reruns no mesh, a bad one is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cortet.formats import read_mesh, vtu
from cortet.formats.tsv import read_tsv
from cortet.formats.volumes import write_volume
from tests.integration.study import surface

pytestmark = pytest.mark.thorough


def test_a_volume_of_a_case(study):
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
    label = vtu.read(study.files("sub-b*Solver_volumes.vtu")[0]).cell_data["tissue"]
    np.testing.assert_array_equal(made.sets.cells["tissue_front"], np.flatnonzero(label == 2))
    centre = made.points[made.cells].mean(axis=1)
    clear = np.abs(centre[:, 1] - middle[1]) > 2
    np.testing.assert_array_equal((label == 2)[clear], (centre[:, 1] > middle[1])[clear])
    table = read_tsv(study.files("sub-b*Solver_volumes.tsv")[0])
    assert table["name"].tolist() == ["back", "front"]
    assert (table["background"].astype(float) < 1e-3).all()
    assert "In the volume" in study.files("sub-b*Solver_report.html")[0].read_text()
    assert "In the volume" not in study.files("sub-a*Solver_report.html")[0].read_text()
    assert study.files("sub-b*Solver_slices.png")
    tissues = read_tsv(study.outputs / "cohort/cohort_tissues.tsv")
    assert tissues[["case", "volume", "name"]].to_numpy().tolist() == [
        ["sub-b_hemi-L", "tissue", "back"],
        ["sub-b_hemi-L", "tissue", "front"],
    ]
    assert tissues["volume_ml"].tolist() == table["volume_ml"].tolist()
    assert tissues["background"].tolist() == table["background"].tolist()
    assert "cohort_tissues.tsv" in (study.outputs / "cohort/index.html").read_text()

    file.with_name("b_dseg.tsv").write_text("index\tname\n1\tback\n2\tfrontal\n")
    numbers = file.with_name("b_fa.nii.gz")
    write_volume(np.where(front, 0.4, 0).astype(np.float32), affine, numbers)
    study.write_cases([first, replace(second, volumes={"tissue": str(file), "fa": str(numbers)})])
    again = {rule for rule, case in study.jobs_of_run() if case == "sub-b"}
    assert again == {"volumes", "export", "case_page"}
    tissues = read_tsv(study.outputs / "cohort/cohort_tissues.tsv")
    assert "frontal" in tissues["name"].tolist()
    assert float(tissues["background"].iloc[-1]) == pytest.approx(0.5, abs=0.1)
    assert "background" in (study.outputs / "cohort/index.html").read_text()
    assert "tissue_frontal" in read_mesh(study.files("sub-b*Solver_tetmesh.inp")[0]).sets.cells

    write_volume(np.where(front, 2, 1).astype(np.int16), affine + 100 * np.eye(4, k=3), file)
    study.jobs_of_run(succeeds=False)
    row = study.status()["sub-b_hemi-L"]
    assert row["state"] == "failed" and "outside the volume" in row["reason"]
    assert study.status()["sub-a_hemi-L"]["state"] == "certified"
    assert study.files("sub-b*Solver_report.html")  # the mesh is certified, and has its page
