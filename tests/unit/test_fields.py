"""Fields from files of their own: named by the sheet, one value per vertex, or refused."""

from __future__ import annotations

import hashlib
from pathlib import Path

import nibabel as nib
import numpy as np
import pytest
from shapes import ball_surface

from cortet.errors import InputError
from cortet.fields import field_sources, with_fields


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


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.shape\.gii"):
        with_fields(ball_surface(1), {"thickness": tmp_path / "none.shape.gii"})


def label_file(path: Path, keys: np.ndarray, names: dict[int, str]) -> Path:
    table = nib.gifti.GiftiLabelTable()
    for key, name in names.items():
        label = nib.gifti.GiftiLabel(key)
        label.label = name
        table.labels.append(label)
    array = nib.gifti.GiftiDataArray(keys.astype(np.int32), "NIFTI_INTENT_LABEL", meta={"Name": "parcels"})
    nib.save(nib.gifti.GiftiImage(labeltable=table, darrays=[array]), path)
    return path


def test_every_field_says_where_it_came_from(tmp_path: Path) -> None:
    ones = np.ones(42)
    files = {
        "growth": shape_file(tmp_path / "a.func.gii", mean=ones, sd=ones),
        "area": label_file(tmp_path / "b.label.gii", ones, {0: "Medial wall", 1: "V1"}),
    }
    sources = field_sources(files, {"growth": "1/week", "growth_sd": "1"})
    assert with_fields(ball_surface(1), files).point_data.keys() == sources.keys()
    assert {name: (source.kind, source.units) for name, source in sources.items()} == {
        "growth_mean": ("scalar", "1/week"),
        "growth_sd": ("scalar", "1"),
        "area": ("label", "unknown"),
    }
    assert sources["area"].labels == {0: "Medial wall", 1: "V1"} and sources["growth_sd"].labels == {}
    assert sources["area"].sha256 == hashlib.sha256((tmp_path / "b.label.gii").read_bytes()).hexdigest()


def test_names_hold_no_sign_that_a_solver_stumbles_over(tmp_path: Path) -> None:
    file = shape_file(tmp_path / "a.func.gii", **{"mean (mm)": np.ones(42), "sd": np.ones(42)})
    assert with_fields(ball_surface(1), {"a b": file}).point_data.keys() == {"a_b_mean_mm_", "a_b_sd"}
