"""When and how wide a flat cortex of the growing model folds, by exact theory."""

from __future__ import annotations

import sys

import fold_theory
import numpy as np
import pytest
from fold_theory import (
    AGES,
    WAVELENGTHS,
    Grown,
    Onset,
    born,
    grown_at,
    is_stable,
    laws,
    smooth_profile,
    width,
)

from cortet.folding.body import Material
from cortet.folding.growth import VOLUME, usual

MATERIAL = Material(mu_core=0.2)


def simple_onset(material: Material, across: float) -> Onset:
    """Of a layer that folds at a growth along of 0.225 if it is 5 times as stiff, and 8 of its thicknesses wide."""
    return Onset(0.045 / material.mu_core, 8.0 * (1 + across), set_by_layer=True)


def stretch_at(age: float) -> float:
    volumes = usual(VOLUME, np.array([22.0, age]))
    return float(np.cbrt(volumes[1] / volumes[0]))


def test_what_has_grown_is_counted_from_22_weeks_and_relative_to_the_core() -> None:
    model = laws(0.045, -0.02)
    assert grown_at(model, 22.0) == pytest.approx((0, 0, 1))
    stretch = stretch_at(34)
    assert grown_at(model, 34.0) == pytest.approx(Grown(0.54, 0.76 / stretch - 1, stretch))


def test_cortex_is_stable_before_the_age_at_which_its_folds_are_born_and_not_after_it() -> None:
    model = laws(0.045, -0.02)
    found = born(model, MATERIAL)
    assert found is not None
    waves = [found.wavelength, *np.geomspace(*WAVELENGTHS, 20)]

    def resists(age: float) -> list[bool]:
        grown = grown_at(model, age)
        return [is_stable(grown.along, 2 * np.pi / w, 1.0, MATERIAL, smooth_profile, grown.across) for w in waves]

    assert all(resists(found.age - 0.01))
    assert not resists(found.age + 0.01)[0]


def test_a_cortex_that_grows_as_its_core_does_never_folds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fold_theory, "onset", simple_onset)
    assert born(laws(0.0, 0.0), MATERIAL) is None
    monkeypatch.setattr(fold_theory, "onset", lambda *_, **__: Onset(0.1, 0.3, set_by_layer=False))
    assert born(laws(0.045, 0.0), MATERIAL) is None, "it creases"


def test_tables(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(fold_theory, "onset", simple_onset)
    command = ["--rate", "0.045", "--thickness", "1.1", "--thickness-rate", "0", "--stiffness", "1", "5", "10", "100"]
    monkeypatch.setattr(sys, "argv", ["fold_theory.py", "ages", *command])
    fold_theory.main()
    ages, thicknesses = capsys.readouterr().out.split("\n\n")
    rows = [line.split() for line in ages.splitlines()[2:]]
    # a growth along of 0.045 has come after a week, and so on; without a thickness rate the cortex stays 1.1 mm thick
    assert [(row[0], row[1], row[2], row[4]) for row in rows] == [
        ("1", "23.0", "0.045", "8.00"),
        ("5", "27.0", "0.225", "8.00"),
        ("10", "32.0", "0.450", "8.00"),
        ("100", "does", "not", "until"),
    ]
    at_birth, later, firsts = rows[1][5], rows[1][6:9], rows[1][9:]
    assert at_birth == "8.8"
    assert later == [f"{8.8 * stretch_at(age) / stretch_at(27):.1f}" for age in AGES]
    assert firsts == ["8.8", "8.8", "8.8"]
    assert rows[2][6] == "-", "not yet born"
    assert float(thicknesses.splitlines()[2].split()[1]) == pytest.approx(
        12 / (8 * stretch_at(34) / stretch_at(27)), abs=0.01
    )


def test_with_that_thickness_folds_are_as_wide_as_they_should_be() -> None:
    model = laws(0.045, -0.02)
    assert width(6.0, 12 / width(6.0, 1.0, model, 34.0), model, 34.0) == pytest.approx(12)


def test_a_thickness_of_nothing_is_refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["fold_theory.py", "ages", "--thickness-rate", "-0.05"])
    with pytest.raises(SystemExit):
        fold_theory.main()
    assert "nothing is left" in capsys.readouterr().err
