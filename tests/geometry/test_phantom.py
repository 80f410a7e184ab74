"""Synthetic cortices: valid surfaces of the size of real ones."""

from __future__ import annotations

import numpy as np
import pytest

from cortet.errors import InputError
from cortet.phantoms import phantom
from cortet.stages.gate import gate

#: weeks, volume in mL and area in mm2 of real hemispheres
REAL = [(22, 19.8, 4775), (28, 50.0, 9858), (36, 81, 21400)]


@pytest.mark.parametrize(("weeks", "volume", "area"), REAL)
def test_size_is_that_of_a_real_hemisphere(weeks, volume, area):
    _, report = gate(phantom(weeks), source="phantom")
    assert report.volume_ml == pytest.approx(volume, rel=0.01)
    assert report.area_mm2 == pytest.approx(area, rel=0.05)


def test_left_and_right_are_mirror_images_beside_the_midline():
    left, right = (phantom(27, hemisphere=side, subdivisions=3) for side in "LR")
    assert left.points[:, 0].max() < 0 < right.points[:, 0].min()
    assert np.array_equal(left.points * [-1, 1, 1], right.points)
    assert np.array_equal(left.faces[:, ::-1], right.faces)


@pytest.mark.parametrize(
    ("weeks", "others", "word"),
    [
        (20, {}, "21 to 38"),
        (39, {}, "21 to 38"),
        (30, {"hemisphere": "left"}, "L or R"),
        (28, {"subdivisions": 40}, "2 to 7"),
        (28, {"seed": -1}, "seed"),
    ],
)
def test_what_there_is_no_phantom_of_is_refused(weeks, others, word):
    with pytest.raises(InputError, match=word):
        phantom(weeks, **others)
