"""The cohort sheet: what a row means, which cases are chosen, and that bad rows are named with line and column."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cortet.cohort.selection import ageless_notice, chosen, folded
from cortet.cohort.sheet import COLUMNS, Case, add_to_sheet, read_sheet, write_sheet
from cortet.errors import InputError

GOOD = "007\t01\tL\t27.5\tdata/a.surf.gii\tyes\tn/a"
SYNTHETIC = "007\t01\tR\t30\tphantom\tyes\tn/a"


def sheet(folder: Path, *rows: str, extra: str = "") -> Path:
    path = folder / "cohort.tsv"
    path.write_text("\t".join(COLUMNS) + extra + "\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


#: row, further columns and their values, attributes of the case; files are relative to the folder of the sheet
ROWS: list[tuple[str, dict[str, str], dict[str, Any]]] = [
    (GOOD, {}, {"name": "sub-007_ses-01_hemi-L", "folder": "sub-007/ses-01", "scan_age": 27.5}),
    ("sub-007\tn/a\tn/a\t27.5\t/abs/a.surf.gii\tyes\tn/a", {}, {"name": "sub-007", "surface": Path("/abs/a.surf.gii")}),
    (GOOD.replace("data/a", "data/a  b"), {}, {"surface": Path("data/a  b.surf.gii")}),
    (SYNTHETIC, {}, {"is_phantom": True}),
    ("007\t01\tL\tn/a\ta.gii\tno\tmotion", {}, {"include": False, "exclude_reason": "motion", "scan_age": None}),
    ('007\t01\tL\t30\ta.gii\tno\tthe "left" one', {"note": '"'}, {"exclude_reason": 'the "left" one'}),
    (GOOD, {"scanner": "1", "site": "n/a"}, {"extra": {"scanner": "1", "site": "n/a"}}),
    (GOOD, {"unit": "m", "affine": "n/a"}, {"unit": "m"}),
    (GOOD, {"unit": "n/a"}, {"unit": None}),
    (GOOD, {"cell_size": "1.001"}, {"cell_size": 1.001}),
    (GOOD, {"cell_size": "n/a"}, {"cell_size": None}),
    (GOOD, {"sphere": "a.sphere.gii"}, {"sphere": Path("a.sphere.gii"), "extra": {}}),
    (GOOD, {"electrodes": "e_electrodes.tsv"}, {"electrodes": Path("e_electrodes.tsv"), "extra": {}}),
    (GOOD, {"electrodes": "n/a"}, {"electrodes": None}),
    (SYNTHETIC, {"sphere": "phantom", "inner": "phantom"}, {"sphere": "phantom", "inner": {"white": "phantom"}}),
    (GOOD, {"field_thickness": "t.shape.gii"}, {"fields": {"thickness": Path("t.shape.gii")}}),
    (
        GOOD,
        {"inner": "white.surf.gii", "inner_ventricle": "v.surf.gii"},
        {"inner": {"white": Path("white.surf.gii"), "ventricle": Path("v.surf.gii")}},
    ),
]


def below(folder: Path, value: Any) -> Any:
    """The value of an attribute with the files below a folder."""
    if isinstance(value, dict):
        return {key: below(folder, one) for key, one in value.items()}
    return folder / value if isinstance(value, Path) else value


@pytest.mark.parametrize(("row", "more", "attributes"), ROWS)
def test_a_row_becomes_a_case_and_is_written_as_it_was_read(tmp_path, row, more, attributes):
    extra = "".join(f"\t{name}" for name in more)
    cases = read_sheet(sheet(tmp_path, "\t".join([row, *more.values()]), extra=extra))
    assert {name: getattr(cases[0], name) for name in attributes} == below(tmp_path, attributes)
    write_sheet(cases, tmp_path / "again.tsv")
    assert read_sheet(tmp_path / "again.tsv") == cases


#: words that would lead a file name out of its folder, into a shell or to no file at all
NO_LABELS = ("../x", "..", "a\\b", "$(reboot)", "a b", "a\x00b", "{case}", "*", "-rf", "a.b", "\u0430bc")
#: row, further columns and their values, column that the error names, keyword of the remedy
BAD: list[tuple[str, dict[str, str], str, str]] = [
    *((GOOD.replace("007", label), {}, "participant_id", "BIDS label") for label in ("00/7", "n/a", *NO_LABELS)),
    (GOOD.replace("01", "ses_1"), {}, "session_id", "BIDS label"),
    (GOOD.replace("\tL", "\tleft-ish"), {}, "hemi", "use L, R"),
    (GOOD.replace("27.5", "190"), {}, "scan_age", "gestational weeks"),
    (GOOD.replace("27.5", "nan"), {}, "scan_age", "gestational weeks"),
    (GOOD.replace("27.5", "old"), {}, "scan_age", "n/a if the age is unknown"),
    (SYNTHETIC.replace("30", "n/a"), {}, "scan_age", "phantom"),
    (SYNTHETIC.replace("\tR", "\tn/a"), {}, "hemi", "phantom"),
    (GOOD.replace("data/a.surf.gii", "n/a"), {}, "surface", "is not a file"),
    (GOOD.replace("data/a", "{x}"), {}, "surface", "braces"),
    (GOOD.replace("007", "x" * 41), {}, "participant_id", "at most 40"),
    *((GOOD.replace("data/a", name), {}, "surface", "") for name in ("a\x00b", "a\x1bb", "*", "x" * 5000)),
    (GOOD.replace("yes", "maybe"), {}, "include", "use yes or no"),
    (GOOD.replace("yes", "no"), {}, "exclude_reason", "is not a reason"),
    (GOOD, {"unit": "inch"}, "unit", "use mm"),
    (GOOD, {"affine": "t2.nii.gz"}, "affine", "to mm first"),
    *((GOOD, {"cell_size": text}, "cell_size", "multiple") for text in ("0", "-1", "fine", "0.80001", "1e9", "nan")),
    (GOOD, {"sphere": "phantom"}, "sphere", "use phantom in both columns"),
    (SYNTHETIC, {"sphere": "a.gii"}, "sphere", "use phantom in both columns"),
    (GOOD, {"inner_core": "a.gii"}, "inner_core", "use another name"),
    (SYNTHETIC, {"inner": "a.gii"}, "inner", "use phantom in both columns"),
    (SYNTHETIC, {"inner_v": "a.gii"}, "inner_v", "use files in both columns"),
    (GOOD, {"inner": "a.gii", "inner_White": "b.gii"}, "inner", "case is ignored"),
]


@pytest.mark.parametrize(("row", "more", "column", "remedy"), BAD)
def test_a_bad_row_is_named_with_line_column_and_remedy(tmp_path, row, more, column, remedy):
    extra = "".join(f"\t{name}" for name in more)
    with pytest.raises(InputError) as error:
        read_sheet(sheet(tmp_path, "\t".join([row, *more.values()]), extra=extra))
    assert f"line 2, column {column}: " in str(error.value) and remedy in str(error.value)


def test_all_bad_rows_are_named_at_once(tmp_path):
    one, other = (GOOD.replace("007", label) for label in ("S1", "s1"))
    rows = (one, other, GOOD.replace("007", "0 8"), GOOD.replace("27.5", "x").replace("007", "9"), "8\tn/a")
    with pytest.raises(InputError) as error:
        read_sheet(sheet(tmp_path, *rows))
    message = str(error.value)
    assert "4 problems" in message
    assert "line 3, columns participant_id, session_id, hemi: sub-s1_ses-01_hemi-L is already in line 2" in message
    assert "line 4, column participant_id: '0 8'" in message
    assert "line 5, column scan_age: 'x'" in message
    assert "line 6, all columns: 2 values for 7 columns" in message


@pytest.mark.parametrize(
    ("text", "keyword"),
    [
        ("", "empty"),
        ("participant_id,hemi\n1,L\n", "no column participant_id"),
        ("\t".join([*COLUMNS, "hemi"]) + "\n", "same name"),
        ("\t".join([*COLUMNS, "inner", "inner_white"]) + "\n", "same region"),
        ("\t".join(COLUMNS) + "\n", "no rows"),
    ],
)
def test_a_sheet_that_is_no_sheet_is_refused(tmp_path, text, keyword):
    path = tmp_path / "cohort.tsv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"(?s)cohort\.tsv: .*{keyword}"):
        read_sheet(path)


def test_a_sheet_is_complete_or_as_it_was(tmp_path):
    path = sheet(tmp_path, GOOD)
    before = path.read_bytes()
    (case,) = read_sheet(path)
    with pytest.raises(UnicodeEncodeError):
        write_sheet([case, replace(case, participant="8", surface=Path("\ud800"))], path)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_new_cases_are_appended_and_every_row_stays(tmp_path):
    edited = GOOD.replace("yes\tn/a", 'no\tthe "left" one') + "\t3T"
    gone = GOOD.replace("007", "900") + "\tn/a"
    path = sheet(tmp_path, gone, edited, extra="\tscanner")
    before = path.read_text()
    new = Case("008", None, "R", 30.0, tmp_path / "data/b.surf.gii")
    found = [Case("007", "01", "L", 20.0, tmp_path / "other.surf.gii"), new]
    assert add_to_sheet(found, path) == [new]
    assert path.read_text() == before + "sub-008\tn/a\tR\t30\tdata/b.surf.gii\tyes\tn/a\tn/a\n"
    assert add_to_sheet(found, path) == []


def test_cases_are_chosen_by_name_by_number_over_the_ages_or_all():
    cases = [Case(str(age), None, "L", age, "phantom") for age in (30, 22, 36, 26, 34)]
    assert chosen(cases, "all") == cases
    assert [case.scan_age for case in chosen(cases, 3)] == [22, 30, 36]
    assert [case.scan_age for case in chosen(cases, 1)] == [22]
    assert len(chosen(cases, 9)) == 5 and chosen(cases, 0) == []
    assert chosen(cases, ["sub-36_hemi-L"]) == [cases[2]]
    with pytest.raises(InputError, match="the sheet includes no case sub-40_hemi-L"):
        chosen(cases, ["sub-40_hemi-L"])


def marked(tmp_path: Path, *words: str, column: str = "fold") -> list[Case]:
    rows = (GOOD.replace("007", f"a{number}") + f"\t{word}" for number, word in enumerate(words))
    return read_sheet(sheet(tmp_path, *rows, extra=f"\t{column}"))


def test_the_column_fold_says_what_is_folded_where_the_configuration_does_not(tmp_path):
    cases = marked(tmp_path, "yes", "no", "n/a")
    assert folded(cases, None) == cases[:1], "as in BIDS, n/a says nothing"
    assert folded(cases, "all") == cases and folded(cases, []) == []
    assert folded(marked(tmp_path, "3T", "7T", column="scanner"), None) == []
    with pytest.raises(InputError, match="column fold of sub-a1_ses-01_hemi-L: 'maybe'"):
        folded(marked(tmp_path, "yes", "maybe"), None)


def test_a_case_without_an_age_is_told_and_not_folded(tmp_path):
    rows = (GOOD + "\tyes", GOOD.replace("007", "008").replace("27.5", "n/a") + "\tyes")
    old, ageless = read_sheet(sheet(tmp_path, *rows, extra="\tfold"))
    assert folded([old, ageless], "all") == [old] and folded([ageless, old], 2) == [old]
    for which in (None, [ageless.name]):
        with pytest.raises(InputError, match="sub-008_ses-01_hemi-L: .* age is unknown"):
            folded([old, ageless], which)
    (notice,) = ageless_notice([old, ageless], smoothed=True, folded=True)
    assert "smooth or fold 1 of 2 cases" in notice
    assert ageless_notice([old], smoothed=True, folded=True) == []
