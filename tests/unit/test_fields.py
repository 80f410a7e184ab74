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


def test_a_field_of_another_surface_is_refused(tmp_path: Path) -> None:
    file = shape_file(tmp_path / "a.shape.gii", thickness=np.ones(7))
    with pytest.raises(InputError, match=r"a\.shape\.gii: 7 values for 42 vertices"):
        with_fields(ball_surface(1), {"thickness": file})


def test_a_value_that_is_not_finite_is_refused_before_anything_is_meshed(tmp_path: Path) -> None:
    values = np.ones(42)
    values[[5, 7]] = np.nan
    file = shape_file(tmp_path / "a.shape.gii", thickness=values)
    with pytest.raises(InputError, match="the field thickness is not finite at 2 vertices, the first is vertex 5"):
        with_fields(ball_surface(1), {"thickness": file})


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.shape\.gii"):
        with_fields(ball_surface(1), {"thickness": tmp_path / "none.shape.gii"})


def test_growth_named_for_another_age_is_refused(tmp_path: Path) -> None:
    file = shape_file(tmp_path / "growth.func.gii", growth_to_29=np.ones(42))
    with pytest.raises(InputError, match=r"up to 29 weeks, but the field is named growth_to_31 \(name it growth_to_29"):
        with_fields(ball_surface(1), {"growth_to_31": file})
    assert "growth_to_29" in with_fields(ball_surface(1), {"growth_to_29": file}).point_data
