"""What is wrong with one row of the sheet, or with a file that it names, fails that case and no other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tests.integration.study import Study, surface


def named_right(path: Path) -> None:
    """Let a surface say that it is of the right hemisphere."""
    text = path.read_text()
    said = "<MetaData><MD><Name>AnatomicalStructurePrimary</Name><Value>CortexRight</Value></MD></MetaData>"
    path.write_text(text.replace("<MetaData/>", said, 1).replace("<MetaData />", said, 1))
    assert "CortexRight" in path.read_text()


def test_a_fault_of_one_row_fails_its_case_alone(tmp_path: Path) -> None:
    study = Study(tmp_path)
    image = replace(study.case("image"), affine=tmp_path / "gone.nii.gz")
    for number, case in enumerate((study.case("good"), study.case("other"), image)):
        study.add_case(case, surface(number))
    named_right(tmp_path / "surfaces/other.surf.gii")
    ran = study.jobs_of_run("--keep-going", "cohort", succeeds=False)
    assert ("export", "sub-good") in ran
    assert {rule for rule, case in ran if case in ("sub-other", "sub-image")} <= {"repair", "case_page"}
    status = study.status()
    assert status["sub-good_hemi-L"]["state"] == "certified"
    reason = status["sub-other_hemi-L"]["reason"]
    assert "other.surf.gii: is of hemisphere R, as its AnatomicalStructurePrimary says, but its row says L" in reason
    assert "mend the column hemi" in reason
    assert "gone.nii.gz: cannot be read as an image" in status["sub-image_hemi-L"]["reason"]
