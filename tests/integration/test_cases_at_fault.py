"""What is wrong with one row of the sheet, or with a file that it names, fails that case and no other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cortet.formats.gifti import write_fields
from tests.integration.study import STATUS, Study, surface

pytestmark = pytest.mark.thorough


def named_right(path: Path) -> None:
    """Let a surface say that it is of the right hemisphere."""
    text = path.read_text()
    said = "<MetaData><MD><Name>AnatomicalStructurePrimary</Name><Value>CortexRight</Value></MD></MetaData>"
    path.write_text(text.replace("<MetaData/>", said, 1).replace("<MetaData />", said, 1))
    assert "CortexRight" in path.read_text()


def test_a_fault_of_one_row_fails_its_case_alone(tmp_path):
    study = Study(tmp_path)
    inner = replace(study.case("inner"), inner={"white": tmp_path / "none.surf.gii"})
    sphere = replace(study.case("sphere"), sphere=tmp_path / "sphere.surf.gii")
    field = replace(study.case("field"), fields={"thickness": tmp_path / "gone.shape.gii"})
    thick = tmp_path / "surfaces/good_thickness.shape.gii"
    good = replace(study.case("good"), fields={"thickness": thick})
    for number, case in enumerate((good, study.case("other"), inner, sphere, field)):
        study.add_case(case, surface(number))
    write_fields({"thickness": np.ones(len(surface(0).points))}, thick)
    named_right(tmp_path / "surfaces/other.surf.gii")
    study.config["resample"] = {"subdivisions": 3}
    ran = study.jobs_of_run("--keep-going", STATUS, succeeds=False)
    assert ("export", "sub-good") in ran
    assert {rule for rule, case in ran if case == "sub-other"} <= {"gate", "case_page"}
    status = study.status()
    assert status["sub-good_hemi-L"]["state"] == "certified"
    reason = status["sub-other_hemi-L"]["reason"]
    assert "other.surf.gii: is hemisphere R" in reason
    assert "correct the column hemi" in reason
    for name, stage, words in (
        ("inner", "gate", ["none.surf.gii: no such file"]),
        ("sphere", "resample", ["sphere.surf.gii: no such file", "column sphere of the cohort sheet"]),
        ("field", "fields", ["gone.shape.gii"]),
    ):
        row = status[f"sub-{name}_hemi-L"]
        assert (row["state"], row["stage"]) == ("failed", stage)
        assert all(word in row["reason"] for word in words), row["reason"]
