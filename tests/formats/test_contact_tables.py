"""Tables of contacts, as people have them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from cortet.errors import InputError
from cortet.formats.electrodes import contacts_of
from cortet.meshes import CoordinateFrame

HERE = CoordinateFrame()
SCANNER = "NIFTI_XFORM_SCANNER_ANAT"
#: as FreeSurfer's: the centre of the volume lies at x = 5 mm of the scanner
SHIFTED = CoordinateFrame("NIFTI_XFORM_UNKNOWN", SCANNER, (1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))


def table(folder: Path, *rows: str, system: str | None = None, unit: str = "mm") -> Path:
    file = folder / "sub-01_electrodes.tsv"
    file.write_text("\n".join(["name\tx\ty\tz\tsize", *(row.replace(" ", "\t") for row in rows)]) + "\n")
    if system:
        record = {"iEEGCoordinateSystem": system, "iEEGCoordinateUnits": unit}
        (folder / "sub-01_coordsystem.json").write_text(json.dumps(record))
    return file


def test_size_is_the_area_of_a_contact(tmp_path):
    first, second = contacts_of(table(tmp_path, "A1 1 2 3 4.15", "A2 -1 2 3 n/a"), HERE)
    assert (first.name, first.point, first.radius) == ("A1", (1, 2, 3), pytest.approx(1.1494, abs=1e-4))
    assert (second.point, second.radius) == ((-1, 2, 3), None)


def test_units_of_a_dataset_are_those_that_it_states(tmp_path):
    (found,) = contacts_of(table(tmp_path, "A1 0.01 0.02 0.03 n/a", system="Other", unit="m"), HERE)
    assert found.point == pytest.approx((10, 20, 30))


@pytest.mark.parametrize(("unit", "x"), [("cm", 0.1), ("m", 0.001), ("um", 1000)])
def test_size_is_in_mm2_whatever_the_unit_of_the_coordinates(tmp_path, unit, x):
    (found,) = contacts_of(table(tmp_path, f"A1 {x} 0 0 3.14159265", system="Other", unit=unit), HERE)
    assert (found.point[0], found.radius) == (pytest.approx(1), pytest.approx(1))


def test_a_space_that_only_the_name_of_a_table_states_is_refused(tmp_path):
    file = table(tmp_path, "A1 1 2 3 1").rename(tmp_path / "sub-01_space-MNI152Lin_electrodes.tsv")
    with pytest.raises(InputError, match="space MNI152Lin"):
        contacts_of(file, SHIFTED)
    own = file.rename(tmp_path / "sub-01_space-Other_electrodes.tsv")
    assert contacts_of(own, SHIFTED)[0].point == (1, 2, 3)


def test_a_unit_that_is_no_word_is_refused(tmp_path):
    file = table(tmp_path, "A1 1 2 3 1", system="Other")
    (tmp_path / "sub-01_coordsystem.json").write_text(
        '{"iEEGCoordinateSystem": "Other", "iEEGCoordinateUnits": ["mm"]}'
    )
    with pytest.raises(InputError, match="unit .*'mm'"):
        contacts_of(file, HERE)


def test_numbers_are_names_in_memory_as_in_a_file():
    frame = pd.DataFrame({"name": [1, 2], "x": [1, 2], "y": [0, 0], "z": [0, 0]})
    assert [one.name for one in contacts_of(frame, HERE)] == ["1", "2"]


def test_coordinates_of_the_scanner_are_brought_to_those_of_the_surface(tmp_path):
    file = table(tmp_path, "A1 10 20 30 n/a", system="ScanRAS")
    assert contacts_of(file, SHIFTED)[0].point == pytest.approx((5, 20, 30))
    assert contacts_of(file, CoordinateFrame(SCANNER, SCANNER))[0].point == pytest.approx((10, 20, 30))
    with pytest.raises(InputError, match="does not state its location in the scanner"):
        contacts_of(file, HERE)


@pytest.mark.parametrize("system", ["MNI152NLin2009aSym", "fsaverage", "ACPC", "Pixels"])
def test_another_space_is_refused_by_its_name(tmp_path, system):
    with pytest.raises(InputError, match=f"space {system}"):
        contacts_of(table(tmp_path, "A1 1 2 3 1", system=system), SHIFTED)


def test_coordinates_of_pixels_are_refused(tmp_path):
    with pytest.raises(InputError, match="unit pixels"):
        contacts_of(table(tmp_path, "A1 1 2 3 1", system="Other", unit="pixels"), HERE)


def test_a_table_in_memory_is_read_like_a_file():
    frame = pd.DataFrame({"name": ["A1", "A2"], "x": [1, 2], "y": [0, 0], "z": [0, 0], "radius": [2.0, np.nan]})
    assert [(one.name, one.radius) for one in contacts_of(frame, HERE)] == [("A1", 2.0), ("A2", None)]


def test_coordinates_by_name_are_in_the_unit_of_the_surface():
    (found,) = contacts_of({"A1": (0.1, 0.2, 0.3, 0.01)}, HERE, to_mm=10.0)
    assert found.point == pytest.approx((1, 2, 3)) and found.radius == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("A1 n/a n/a n/a 1", "contacts without coordinates: A1 "),
        ("A1 1 nan 3 1", "electrode A1 has the coordinates 1, nan, 3"),
        ("A1 1 2 3 -4", "electrode A1 has the radius or size -4"),
        ("A1 1 2 3 big", "electrode A1 has the radius or size big"),
        ("b1 1 2 3 1", "two contacts have the name B1"),
        ("a/b 1 2 3 1", "'a/b' cannot be the name of a contact"),
        (f"{'a' * 41} 1 2 3 1", "cannot be the name of a contact .*at most 40"),
        ("A1 1,5 2 3 1", "coordinates 1,5, 2, 3 .*decimal points"),
    ],
)
def test_rows_that_cannot_be_are_refused_with_line_and_value(tmp_path, row, words):
    with pytest.raises(InputError, match=words):
        contacts_of(table(tmp_path, "B1 9 9 9 1", row), HERE)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"A1": (1, 2)}, r"electrode A1: \(1, 2\) are no coordinates"),
        ({"A1": "1,2,3"}, "are no coordinates"),
        ({"A1": (1, 2, 3, 0)}, "radius or size 0"),
        ({"A1": {1, 2, 3}}, "are no coordinates"),
        ({"A1": {"x": 1, "y": 2, "z": 3}}, "are no coordinates"),
        ({}, "no contact"),
        ([1, 2, 3], "list is no table of contacts"),
        (pd.DataFrame({"name": ["A1"], "x": [1]}), "has no column y"),
        (pd.DataFrame([["A1", 1, 2, 3, 9]], columns=["name", "x", "y", "z", "x"]), "has two columns x"),
        (pd.DataFrame({"name,x,y,z": ["A1,1,2,3"]}), "has no column name .*separated by tabs"),
    ],
)
def test_objects_that_are_no_contacts_are_refused(given, words):
    with pytest.raises(InputError, match=words):
        contacts_of(given, HERE)
