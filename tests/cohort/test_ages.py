"""Ages at scan: the unit that the dataset says, never years taken for weeks, and in words what was read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cortet.cohort.scan import scan
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


#: column, its entry in the sidecar, value -> weeks, or a keyword of the reason why it is not read
READ: list[tuple[str, dict[str, str] | None, str, float | str]] = [
    ("scan_age", None, "28.5", 28.5),
    ("ga", {"Description": "at scan"}, "28.5", 28.5),
    ("gestational_age", {"Units": "d"}, "196", 28.0),
    ("scan_age", {"Units": "Weeks"}, "28", 28.0),
    # the column age of BIDS is in years from birth
    ("age", None, "28", "counts from birth"),
    ("age", {"Units": "weeks"}, "28", "counts from birth"),
    # a description of ages that count from birth, and of those that only mention it
    ("ga", {"LongName": "weeks of life"}, "28", "counts from birth"),
    ("scan_age", {"Description": "post-natal age, weeks", "Units": "weeks"}, "28", "counts from birth"),
    ("scan_age", {"Description": "postmenstrual age: gestational age at birth and weeks after birth"}, "28", 28.0),
    # other units are never weeks
    *(
        ("scan_age", {"Units": units}, "28", f"in {units}")
        for units in ("months", "years", "mois", "1/7 weeks", "10 days", "m")
    ),
    # values that are no gestational ages
    *(("scan_age", None, text, f"{text} in column") for text in ("196", "2_5", "30,5", "30 weeks", "P30W4D", "1e400")),
]


@pytest.mark.parametrize(("column", "described", "value", "found"), READ)
def test_an_age_is_read_by_the_unit_of_the_dataset_or_the_reason_is_given(tmp_path, column, described, value, found):
    known, said = ages(dataset(tmp_path, column, {"a": value}, described))
    if isinstance(found, str):
        assert known == [None]
        assert "not read: " in said and f"column {column} of participants.tsv" in said and found in said
    else:
        assert known == [found] and said.startswith(f"ages read from column {column} of participants.tsv (")


def test_a_configuration_may_name_the_column_age_whose_unit_the_sidecar_still_states(tmp_path):
    named = Scan(age_columns=["age"])
    folder = dataset(tmp_path, "age", {"a": "28"})
    assert ages(folder, named)[0] == [28.0]
    (folder / "participants.json").write_text(json.dumps({"age": {"Units": "years"}}))
    found, said = ages(folder, named)
    assert found == [None] and "in years" in said


def test_the_ages_of_a_table_that_names_no_participants_are_nobodys(tmp_path):
    folder = dataset(tmp_path, "scan_age", {"a": "28"})
    (folder / "participants.tsv").write_text("subject\tscan_age\nsub-b\t30\n")
    assert ages(folder)[0] == [None]


def test_a_sessions_table_counts_before_the_age_of_the_participant(tmp_path):
    folder = dataset(tmp_path, "scan_age", {"a": "28", "b": "30"})
    for session in ("1", "2"):
        (folder / f"sub-a/ses-{session}/anat").mkdir(parents=True)
        (folder / f"sub-a/ses-{session}/anat/sub-a_ses-{session}_hemi-L_white.surf.gii").touch()
    (folder / "sub-a/sub-a_sessions.tsv").write_text("session_id\tga\nses-1\t168\nses-2\t2000\n")
    (folder / "sessions.json").write_text('{"ga": {"Units": "days"}}')
    found, said = ages(folder)
    assert found == [28.0, 24.0, 28.0, 30.0], "what the sessions table does not say comes from the participants table"
    assert "not read: 2000 in column ga of sub-{participant}" in said


@pytest.mark.parametrize("separator", [";", ",", "   "])
def test_a_table_that_no_tabs_separate_is_refused(tmp_path, separator):
    folder = dataset(tmp_path, "scan_age", {"01": "28"})
    (folder / "participants.tsv").write_text(f"participant_id{separator}scan_age\nsub-01{separator}28\n")
    with pytest.raises(InputError, match=rf"participants.tsv: .*'{separator}'"):
        ages(folder)


def test_rows_that_contradict_each_other_give_no_age(tmp_path):
    folder = dataset(tmp_path, "scan_age", {"a": "30", "b": "31"})
    with (folder / "participants.tsv").open("a") as table:
        table.write("sub-a\t35\nsub-b\t31.0\n")
    found, said = ages(folder)
    assert found == [None, 31.0]
    assert "not read: 30 and 35 in column scan_age" in said


@pytest.mark.parametrize("row", ["sub-b 30", "sub-b_ses-1mo\t30"])
def test_rows_that_match_nobody_are_counted_and_the_first_is_named(tmp_path, row):
    """A blank in place of a tab, or a session in the wrong column: the age was unknown, without a word."""
    folder = dataset(tmp_path, "scan_age", {"a": "28", "b": "30"})
    (folder / "participants.tsv").write_text(f"participant_id\tscan_age\nsub-a\t28\n{row}\n")
    found, said = ages(folder)
    assert found == [28.0, None]
    assert "1 of 2 rows of participants.tsv match no surface, the first is line 3, 'sub-b" in said


def test_rows_of_participants_without_a_surface_are_no_news(tmp_path):
    folder = dataset(tmp_path, "scan_age", {"a": "28"})
    with (folder / "participants.tsv").open("a") as table:
        table.write("sub-z\t30\n")
    assert "match no surface" not in ages(folder)[1]


def test_sessions_that_share_the_age_of_their_participant_are_named(tmp_path):
    """Two scans weeks apart had the same age, without a word."""
    folder = dataset(tmp_path, "scan_age", {"a": "28"})
    (folder / "sub-a/anat/sub-a_hemi-L_white.surf.gii").unlink()
    for session in ("1", "2"):
        (folder / f"sub-a/ses-{session}/anat").mkdir(parents=True)
        (folder / f"sub-a/ses-{session}/anat/sub-a_ses-{session}_hemi-L_white.surf.gii").touch()
    found, said = ages(folder)
    assert found == [28.0, 28.0] and "sub-a: the sessions 1, 2 share the one age of their participant" in said
