"""Fields from files of their own: named by the sheet, one value per vertex, or refused."""

from __future__ import annotations

from pathlib import Path

import nibabel as nib
import numpy as np
import pytest
from shapes import ball_surface

from cortet.errors import InputError
from cortet.solver_files.fields import with_fields


def shape_file(path: Path, **arrays: np.ndarray) -> Path:
    darrays = [
        nib.gifti.GiftiDataArray(values.astype(np.float32), "NIFTI_INTENT_SHAPE", meta={"Name": name})
        for name, values in arrays.items()
    ]
    nib.save(nib.gifti.GiftiImage(darrays=darrays), path)
    return path


def test_a_field_takes_the_name_the_sheet_gives_it(tmp_path: Path) -> None:
    ball = ball_surface(1)
    values = np.arange(len(ball.points))
    file = shape_file(tmp_path / "a.shape.gii", anything=values)
    np.testing.assert_array_equal(with_fields(ball, {"thickness": file}).point_data["thickness"], values)


def test_each_array_of_a_file_becomes_a_field(tmp_path: Path) -> None:
    ball = ball_surface(1)
    values = np.ones(len(ball.points))
    file = shape_file(tmp_path / "a.func.gii", mean=values, sd=2 * values)
    assert with_fields(ball, {"growth": file}).point_data.keys() == {"growth_mean", "growth_sd"}


BAD = np.where(np.isin(np.arange(42), [5, 7]), np.nan, 1.0)


@pytest.mark.parametrize(
    ("called", "array", "values", "word"),
    [
        ("thickness", "thickness", np.ones(7), "7 values for 42"),
        ("thickness", "thickness", BAD, "thickness.* 2 vertices.*vertex 5"),
        ("growth_to_31", "growth_to_29", np.ones(42), "growth_to_31.*growth_to_29"),
        ("thickness", "thickness", None, "No such file|cannot be read"),
    ],
)
def test_a_file_without_a_value_for_each_vertex_is_refused_before_anything_is_meshed(
    called: str, array: str, values: np.ndarray | None, word: str, tmp_path: Path
) -> None:
    file = tmp_path / "a.shape.gii"
    if values is not None:
        shape_file(file, **{array: values})
    with pytest.raises(InputError, match=word) as caught:
        with_fields(ball_surface(1), {called: file})
    assert "a.shape.gii" in str(caught.value)


def test_growth_is_named_by_the_age_that_it_leads_to(tmp_path: Path) -> None:
    file = shape_file(tmp_path / "growth.func.gii", growth_to_29=np.ones(42))
    assert "growth_to_29" in with_fields(ball_surface(1), {"growth_to_29": file}).point_data
