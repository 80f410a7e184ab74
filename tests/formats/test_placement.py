"""Coordinates that are not mm: taken to mm where a unit or an affine is named."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest
from shapes import ball_surface

from cortet.config import load
from cortet.errors import InputError
from cortet.formats.gifti import write_surface
from cortet.formats.placement import matrix, placed, require_precision
from cortet.geometry.topology import enclosed_volume
from cortet.meshes import CoordinateFrame, TriSurface
from cortet.pipeline import run
from cortet.stages.generate import generate

#: voxels of 0.5 x 0.5 x 0.8 mm, the first axis to the left
AFFINE = [[-0.5, 0, 0, 60], [0, 0.5, 0, -50], [0, 0, 0.8, -40], [0, 0, 0, 1]]


def in_voxels(surface: TriSurface) -> TriSurface:
    whole = np.linalg.inv(np.array(AFFINE))
    return TriSurface(surface.points @ whole[:3, :3].T + whole[:3, 3], surface.faces[:, ::-1])


@pytest.mark.parametrize(("unit", "factor"), [("m", 1000.0), ("um", 0.001)])
def test_units(unit, factor):
    ball, frame = ball_surface(), CoordinateFrame("NIFTI_XFORM_TALAIRACH")
    surface = TriSurface(ball.points / factor, ball.faces, frame=frame)
    made = placed(surface, matrix(unit, None))
    assert made.points == pytest.approx(ball.points) and np.array_equal(made.faces, surface.faces)
    assert made.frame == CoordinateFrame()
    assert matrix("mm", None) is None and placed(surface, None) is surface


def test_an_affine_of_rows_or_of_an_image(tmp_path):
    surface = ball_surface(3, 20.0)
    image = tmp_path / "t2.nii.gz"
    nibabel.save(nibabel.Nifti1Image(np.zeros((2, 2, 2), np.uint8), np.array(AFFINE)), image)
    for affine in (AFFINE, image, str(image)):
        made = placed(in_voxels(surface), matrix("mm", affine))
        assert made.points == pytest.approx(surface.points, abs=1e-4)
        assert enclosed_volume(made.points, made.faces) > 0  # voxels mirror space
    metres = [[value / 1000 for value in row] for row in AFFINE[:3]] + AFFINE[3:]
    assert np.array(matrix("m", metres)) == pytest.approx(np.array(AFFINE))


@pytest.mark.parametrize(
    ("unit", "affine", "word"),
    [
        ("inch", None, "inch"),
        ("mm", [[1, 0, 0, 0]] * 4, "last row"),
        ("mm", [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "4 x 4"),
        ("mm", [[1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], "flattens"),
        ("mm", "none.nii.gz", "none.nii.gz"),
        ("mm", "text.nii", "text.nii.* image"),
        ("mm", "x.surf.gii", "x.surf.gii.* image"),
    ],
)
def test_what_is_no_placement_is_refused(unit, affine, word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("text.nii").write_text("no image")
    write_surface(ball_surface(), tmp_path / "x.surf.gii")
    with pytest.raises(InputError, match=word):
        matrix(unit, affine)


def test_the_line_places_what_it_reads_and_records_how():
    surface = ball_surface(3, 20.0)
    config = load({"gate": {"affine": AFFINE}, "generate": {"cell_size": 4.0}})
    steps = {}
    for step in run(in_voxels(surface), config):
        steps[step.stage] = step
        if step.stage == "gate":
            break
    assert steps["gate"].result.points == pytest.approx(surface.points, abs=1e-4)
    assert steps["gate"].parameters["to_mm"] == config.placement()
    assert steps["gate"].report["faces_reoriented"] == 0
    assert "to_mm" not in next(run(surface, load({}))).parameters


def test_coordinates_that_a_file_holds_coarsely_are_said_or_refused(caplog):
    """At 1e5 mm numbers of single precision are 1/128 mm apart, at 1e6 mm 1/16."""
    ball = ball_surface()
    require_precision(ball.points + 1e4, 0.6)
    assert not caplog.text
    require_precision(ball.points + 1e5, 0.6)
    assert "0.0078 mm" in caplog.text
    with pytest.raises(InputError, match="0.062 mm.* 10.4%"):
        generate(TriSurface(ball.points + 1e6, ball.faces), cell_size=0.6)
