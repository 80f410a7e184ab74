"""Surfaces of FreeSurfer are read as GIfTI files are."""

from pathlib import Path

import nibabel.freesurfer.io as freesurfer
import numpy as np
import pytest
from shapes import ball_surface

from cortet.cohort.scan import scan
from cortet.errors import InputError
from cortet.formats.gifti import read_surface

BALL = ball_surface(2, 20.0)


def written(path: Path, **footer: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    known = {"head": np.array([2, 0, 20], np.int32), "valid": "1  # volume info valid", "filename": "x.mgz"}
    known |= {"volume": np.array([256] * 3), "voxelsize": np.ones(3), "xras": np.array([-1.0, 0, 0])}
    known |= {"yras": np.array([0, 0, -1.0]), "zras": np.array([0, 1.0, 0]), "cras": np.array([1.0, 2.0, 3.0])}
    freesurfer.write_geometry(str(path), BALL.points, BALL.faces, volume_info=known | footer)
    return path


def test_a_surface_is_read_with_its_place_in_the_scanner(tmp_path):
    surface = read_surface(written(tmp_path / "lh.white"))
    assert np.array_equal(surface.faces, BALL.faces)
    assert np.allclose(surface.points, BALL.points, atol=1e-5)
    assert surface.frame.xformspace == "NIFTI_XFORM_SCANNER_ANAT"
    assert np.array(surface.frame.matrix).reshape(4, 4)[:3, 3].tolist() == [1, 2, 3]


@pytest.mark.parametrize("kept", [3, 40, 2000])
def test_a_truncated_file_is_refused(tmp_path, kept):
    path = written(tmp_path / "lh.white")
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"lh\.white: no complete FreeSurfer surface"):
        read_surface(path)


def test_a_subjects_folder_is_scanned(tmp_path):
    for hemi in ("lh", "rh"):
        written(tmp_path / f"sub-01/surf/{hemi}.white")
    (tmp_path / "participants.tsv").write_text("participant_id\tscan_age\nsub-01\t30\n")
    assert [(case.participant, case.hemi, case.scan_age) for case in scan(tmp_path)] == [
        ("01", "L", 30.0),
        ("01", "R", 30.0),
    ]
