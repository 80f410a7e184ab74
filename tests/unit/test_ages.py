"""Ages at scan: the unit that the dataset says, never years taken for weeks, and in words what was read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cortet.cli import main
from cortet.cohort.scan import scan
from cortet.cohort.sheet import read_sheet
from cortet.config import Scan
from cortet.errors import InputError


def dataset(folder: Path, column: str, values: dict[str, str], described: dict[str, Any] | None = None) -> Path:
    """One surface for each participant, their ages in participants.tsv, and its sidecar where there is one."""
    for name in values:
        (folder / f"sub-{name}/anat").mkdir(parents=True)
        (folder / f"sub-{name}/anat/sub-{name}_hemi-L_white.surf.gii").touch()
    rows = "".join(f"sub-{name}\t{value}\n" for name, value in values.items())
    (folder / "participants.tsv").write_text(f"participant_id\t{column}\n{rows}")
    if described is not None:
        (folder / "participants.json").write_text(json.dumps({column: described}))
    return folder


def ages(folder: Path, patterns: Scan | None = None) -> tuple[list[float | None], str]:
    """The ages of the cases, and all that was said."""
    said: list[str] = []
    return [case.scan_age for case in scan(folder, patterns, said.append)], "\n".join(said)


@pytest.mark.parametrize("described", [None, {"Units": "years"}, {"Description": "age of the participant"}])
def test_years_are_never_read_as_weeks(tmp_path: Path, described: dict[str, str] | None) -> None:
    found, said = ages(dataset(tmp_path, "age", {"a": "28", "b": "35"}, described))
    assert found == [None, None]
    assert "not read: column age of participants.tsv, in years" in said
    assert "it counts from birth" in said and "Where it is one: say Units: weeks in the sidecar" in said


@pytest.mark.parametrize(
    ("column", "value", "described", "weeks"),
    [
        ("age", "28.5", {"Units": "weeks"}, 28.5),
        ("age", "28.5", {"Units": "gestational weeks"}, 28.5),
        ("age", "196", {"Units": "days", "Description": "postmenstrual age"}, 28.0),
        ("gestational_age", "196", {"Units": "d"}, 28.0),
        ("scan_age", "6.5", {"Units": "months"}, 28.26),
        ("scan_age", "28.5", None, 28.5),
        ("ga", "28.5", {"Description": "at scan"}, 28.5),
        ("age", "28.5", {"Units": "weeks", "Description": "age since birth"}, None),
        ("age", "28", {"Units": "months"}, None),
    ],
)
def test_the_unit_of_the_sidecar_counts(
    tmp_path: Path, column: str, value: str, described: dict[str, str] | None, weeks: float | None
) -> None:
    found, said = ages(dataset(tmp_path, column, {"a": value}, described))
    assert found == [weeks]
    assert said.startswith(f"{'ages are from' if weeks else 'not read:'} column {column} of participants.tsv, in ")


UNKNOWN = ["a", "mois", "Jahre", "hours", "1/7 weeks", "mm/week", "10 days", "m", "weeks^2"]


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("units", UNKNOWN)
def test_units_that_are_not_understood_are_never_weeks(tmp_path: Path, units: str, named: bool) -> None:
    patterns = Scan(age_columns=["scan_age"]) if named else None
    found, said = ages(dataset(tmp_path, "scan_age", {"a": "28"}, {"Units": units}), patterns)
    assert found == [None]
    assert (
        f"not read: column scan_age of participants.tsv, in an unknown unit (its sidecar says Units: {units})" in said
    )
    assert "these Units are not understood" in said and "no sidecar has" not in said


@pytest.mark.parametrize(
    "units",
    ["weeks", "Weeks", "gestational weeks", "weeks (PMA)", "weeks of gestation", "wk", "post-menstrual weeks", "w"],
)
def test_weeks_may_be_qualified(tmp_path: Path, units: str) -> None:
    assert ages(dataset(tmp_path, "age", {"a": "28"}, {"Units": units}))[0] == [28.0]


@pytest.mark.parametrize(
    ("column", "described", "why"),
    [
        ("scan_age", {"Description": "postnatal age"}, "it counts from birth"),
        ("scan_age", {"Description": "post-natal age at scan, weeks", "Units": "weeks"}, "it counts from birth"),
        ("ga", {"LongName": "weeks of life"}, "it counts from birth"),
        ("age", {"Description": "age of the mother at conception"}, "it is the age of a parent"),
        ("age", {"Description": "maternal age at conception", "Units": "weeks"}, "it is the age of a parent"),
        ("age", {"Description": "corrected age", "Units": "weeks"}, "it counts from birth"),
        ("age", {"Description": "time ex utero", "Units": "weeks"}, "it counts from birth"),
        ("scan_age", {"Description": "30 yrs at most"}, "in years (by its description)"),
        ("scan_age", {"Description": "age (mo)"}, "in months (by its description)"),
        ("scan_age", {"Description": "age, y"}, "in years (by its description)"),
    ],
)
def test_what_a_description_says_counts_without_units(
    tmp_path: Path, column: str, described: dict[str, str], why: str
) -> None:
    found, said = ages(dataset(tmp_path, column, {"a": "28"}, described))
    assert found == [None] and why in said


def test_columns_and_keys_in_another_case_are_the_same_and_a_column_twice_is_refused(tmp_path: Path) -> None:
    folder = dataset(tmp_path, "Scan_Age", {"a": "196"})
    (folder / "participants.json").write_text('{"SCAN_AGE": {"Units": "days"}}')
    assert ages(folder)[0] == [28.0]
    (folder / "participants.tsv").write_text("participant_id\tscan_age\tSCAN_AGE\nsub-a\t28\t35\n")
    with pytest.raises(
        InputError, match=r"participants.tsv: line 1: 2 columns are called scan_age \(keep one of them\)"
    ):
        ages(folder)


def test_numbers_as_programs_write_them_are_no_ages(tmp_path: Path) -> None:
    found, said = ages(dataset(tmp_path, "scan_age", {"a": "2_5"}))
    assert found == [None] and "2_5 of sub-a: no age from 12 to 60 gestational weeks" in said


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize(
    ("said", "unit"),
    [
        ({"Description": "postmenstrual age at scan in days"}, "days"),
        ({"Description": "Gestational age (Days)"}, "days"),
        ({"LongName": "age in months", "Description": "at scan"}, "months"),
        ({"Description": "given in years"}, "years"),
    ],
)
def test_a_unit_that_only_a_description_names_is_never_read_as_weeks(
    tmp_path: Path, said: dict[str, str], unit: str, named: bool
) -> None:
    patterns = Scan(age_columns=["scan_age"]) if named else None
    folder = dataset(tmp_path, "scan_age", {"a": "30", "b": "45"}, said)
    found, told = ages(folder, patterns)
    assert found == [None, None]
    assert f"column scan_age of participants.tsv, in {unit} (by its description); a description is not a unit" in told
    assert f"(say Units: {unit} in the sidecar)" in told


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize(
    ("column", "units", "said", "other"),
    [
        ("scan_age", "weeks", {"Description": "Age in years"}, "years"),
        ("age", "weeks", {"Description": "Age in years"}, "years"),
        ("ga", "weeks", {"LongName": "GA, days", "Description": "at scan"}, "days"),
        ("scan_age", "days", {"Description": "postmenstrual age, weeks"}, "weeks"),
    ],
)
def test_units_and_a_description_that_contradict_each_other_are_both_named(
    tmp_path: Path, column: str, units: str, said: dict[str, str], other: str, named: bool
) -> None:
    patterns = Scan(age_columns=[column]) if named else None
    found, told = ages(dataset(tmp_path, column, {"a": "30", "b": "45"}, {**said, "Units": units}), patterns)
    assert found == [None, None]
    assert told.startswith(
        f"not read: column {column} of participants.tsv, in {units} (its sidecar says Units: {units}); "
        f"by its description it is in {other} (mend the Units or the description in the sidecar)"
    )


@pytest.mark.parametrize("text", ["weeks, not days", "age in weeks at the day of scan", "postmenstrual, to one day"])
def test_a_description_of_weeks_may_speak_of_days(tmp_path: Path, text: str) -> None:
    assert ages(dataset(tmp_path, "scan_age", {"a": "30"}, {"Description": text}))[0] == [30.0]


def test_a_configuration_that_names_the_column_vouches_for_weeks(tmp_path: Path) -> None:
    folder = dataset(tmp_path, "age", {"a": "28"})
    assert ages(folder, Scan(age_columns=["age"]))[0] == [28.0]
    (folder / "participants.json").write_text('{"age": {"Units": "years"}}')
    assert ages(folder, Scan(age_columns=["age"]))[0] == [None]


def test_a_value_that_is_no_gestational_age_is_named_and_left_out(tmp_path: Path) -> None:
    found, said = ages(dataset(tmp_path, "scan_age", {"a": "28", "b": "196"}))
    assert found == [28.0, None]
    assert (
        "196 of sub-b: no age from 12 to 60 gestational weeks (give one number, and its unit in the sidecar, as Units)"
        in said
    )


def test_sessions_that_share_the_age_of_their_participant_are_named(tmp_path: Path) -> None:
    folder = dataset(tmp_path, "scan_age", {"a": "28", "b": "30"})
    for session in ("1", "2"):
        (folder / f"sub-a/ses-{session}/anat").mkdir(parents=True)
        (folder / f"sub-a/ses-{session}/anat/sub-a_ses-{session}_hemi-L_white.surf.gii").touch()
    _, said = ages(folder)
    assert "sub-a: ses-1, ses-2 share the one age of their participant, 28 weeks" in said
    (folder / "sub-a/sub-a_sessions.tsv").write_text("session_id\tage\nses-1\t24\nses-2\t200\n")
    (folder / "sessions.json").write_text('{"age": {"Units": "weeks"}}')
    found, said = ages(folder)
    assert found == [28.0, 24.0, 28.0, 30.0], "what the sessions table does not say comes from the participants table"
    assert "not read: 1 of column age of sub-{participant}" in said and "as 200 of sub-a ses-2" in said
    assert (
        "share" not in said and "ages are from column age of sub-{participant}/sub-{participant}_sessions.tsv" in said
    )


@pytest.mark.parametrize("separator", [";", ",", " ", "   "])
def test_a_table_that_no_tabs_separate_is_refused_with_its_separator(tmp_path: Path, separator: str) -> None:
    folder = dataset(tmp_path, "scan_age", {"01": "28"})
    (folder / "participants.tsv").write_text(f"participant_id{separator}scan_age\nsub-01{separator}28\n")
    with pytest.raises(InputError, match=rf"participants.tsv: line 1: .*'{separator}' separates"):
        ages(folder)


def test_rows_that_match_nobody_are_counted_and_named(tmp_path: Path) -> None:
    folder = dataset(tmp_path, "scan_age", {"01": "28", "02": "29", "03": "30"})
    assert "match no surface" not in ages(folder)[1]
    text = "participant_id\tscan_age\nsub-01_ses-1mo\t28\n02\t29\nsub-03 30\nsub-99\t31\n"
    (folder / "participants.tsv").write_text(text)
    found, said = ages(folder)
    assert found == [None, 29.0, None]
    assert "participants.tsv: 3 of its rows match no surface (line 2, 'sub-01_ses-1mo 28'; line 4, 'sub-03 30" in said
    (folder / "participants.tsv").write_text(text.replace("_ses-1mo", "").replace("03 ", "03\t"))
    assert "match no surface" not in ages(folder)[1], "a row of somebody without a surface is nothing strange"


def test_a_sidecar_that_is_none_is_refused(tmp_path: Path) -> None:
    folder = dataset(tmp_path, "age", {"a": "28"})
    for text, words in (("{", "is not JSON"), ("[1]", "holds no keys")):
        (folder / "participants.json").write_text(text)
        with pytest.raises(InputError, match=rf"participants.json: {words}"):
            scan(folder)


def test_the_command_says_which_column_it_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = dataset(tmp_path / "bids", "age", {"a": "28"}, {"Units": "years"})
    assert main(["cohort", "scan", str(folder), "-o", str(tmp_path / "cohort.tsv")]) == 0
    assert "not read: column age of participants.tsv, in years" in capsys.readouterr().out
    assert [case.scan_age for case in read_sheet(tmp_path / "cohort.tsv")] == [None]


@pytest.mark.parametrize("text", ["30,5", "30 weeks", "30+4", "P30W4D", "1e400"])
def test_an_age_that_is_no_number_is_told(tmp_path: Path, text: str) -> None:
    found, said = ages(dataset(tmp_path, "scan_age", {"a": text, "b": "31", "c": "n/a", "d": ""}))
    assert found == [None, 31.0, None, None]
    assert f"not read: 1 of column scan_age of participants.tsv, in weeks (no sidecar has its Units), as {text}" in said


def test_rows_that_contradict_each_other_give_no_age(tmp_path: Path) -> None:
    folder = dataset(tmp_path, "scan_age", {"a": "30", "b": "31"})
    with (folder / "participants.tsv").open("a") as table:
        table.write("sub-a\t35\nsub-b\t31.0\n")
    found, said = ages(folder)
    assert found == [None, 31.0]
    assert "as 30 and 35 of sub-a: no age from 12 to 60 gestational weeks (give one number" in said


@pytest.mark.parametrize(
    "described",
    [{"Units": "years (not weeks)"}, {"Units": "weeks", "Description": "time since the child was born"}],
)
def test_a_unit_that_is_not_clear_or_counts_from_birth_is_not_read(tmp_path: Path, described: dict[str, str]) -> None:
    found, said = ages(dataset(tmp_path, "age", {"a": "30"}, described))
    assert found == [None] and "not read: column age of participants.tsv" in said
