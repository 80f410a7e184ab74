"""Tables: what is written is read back, whatever its cells hold; a column says once what files and readers see."""

from __future__ import annotations

import json

import pytest

from cortet.errors import InputError
from cortet.formats.tables import Column, described, sidecar, values, write_table
from cortet.formats.tsv import read_tsv, read_uneven_tsv, write_tsv

TEXTS = ['the "best" one', '"', '""quoted""', "it's", "\\", "a  b", "NA", "nan", "None", "1e5", "007", "#", "é"]


def test_cells_are_read_back_as_they_were_written(tmp_path):
    rows = [{"text": text, "more": f'"{text}'} for text in TEXTS]
    write_tsv(rows, ["text", "more"], tmp_path / "t.tsv")
    assert read_tsv(tmp_path / "t.tsv").to_dict("records") == rows


def test_columns_are_those_asked_for_and_what_a_row_lacks_is_missing(tmp_path):
    write_tsv([{"b": 1, "c": 2}, {"a": 1.5}], ["a", "b"], tmp_path / "t.tsv")
    assert (tmp_path / "t.tsv").read_text() == "a\tb\nn/a\t1\n1.5\tn/a\n"
    write_tsv([], ["a", "b"], tmp_path / "t.tsv")
    assert (tmp_path / "t.tsv").read_text() == "a\tb\n"
    assert read_tsv(tmp_path / "t.tsv").empty


def test_rows_are_known_by_their_lines(tmp_path):
    (tmp_path / "t.tsv").write_bytes(b"\xef\xbb\xbfa\tb\r\n\r\n1\t 2 \r3\t\n\n")
    table = read_tsv(tmp_path / "t.tsv")
    assert list(table.index) == [3, 4]
    assert table.to_dict("records") == [{"a": "1", "b": "2"}, {"a": "3", "b": ""}]


def test_a_row_of_another_length_is_named_or_made_to_fit(tmp_path):
    (tmp_path / "t.tsv").write_text("a\tb\n1\n1\t2\n1\t2\t3\n")
    with pytest.raises(InputError, match=r"2 problems\n  line 2, .*1 values for 2"):
        read_tsv(tmp_path / "t.tsv")
    table, wrong = read_uneven_tsv(tmp_path / "t.tsv")
    assert table.to_numpy().tolist() == [["1", ""], ["1", "2"], ["1", "2"]]
    assert list(wrong) == [2, 4]
    (tmp_path / "t.tsv").write_text("a\n1\n\t2\n")
    table, wrong = read_uneven_tsv(tmp_path / "t.tsv")
    assert table.to_numpy().tolist() == [["1"], [""]] and list(wrong) == [3]


def test_empty_columns_at_the_end_as_spreadsheets_leave_them_are_no_columns(tmp_path):
    (tmp_path / "t.tsv").write_text("a\tb\t\t\n1\t2\t\t\n3\t4\n")
    table, wrong = read_uneven_tsv(tmp_path / "t.tsv")
    assert table.columns.tolist() == ["a", "b"] and table.to_numpy().tolist() == [["1", "2"], ["3", "4"]] and not wrong


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\n \n", "is empty"),
        (b"\xff\n", "cannot be read"),
    ],
)
def test_what_is_no_table_is_refused(content, words, tmp_path):
    (tmp_path / "t.tsv").write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_tsv(tmp_path / "t.tsv")


# --- columns


DEPTH = Column("depth_mm", "How deep", "mm", limit="< 3", heading="Depth (mm)", form=".1f")
SIDE = Column("side", "Which side", levels={"L": "left", "R": "right"}, heading="Side")


def test_a_sidecar_has_what_is_known_and_nothing_empty(tmp_path):
    write_table([DEPTH, SIDE], [{"side": "L", "other": 1}], tmp_path / "t.tsv", tmp_path / "t.json")
    assert (tmp_path / "t.tsv").read_text() == "depth_mm\tside\nn/a\tL\n"
    explained = json.loads((tmp_path / "t.json").read_text())
    assert explained == sidecar([DEPTH, SIDE])
    assert explained["depth_mm"] == {"Description": "How deep", "Units": "mm", "Threshold": "< 3"}
    assert explained["side"] == {"Description": "Which side", "Levels": {"L": "left", "R": "right"}}
    assert described(explained["side"]) == "Which side; L: left; R: right"


def test_values_stand_at_the_places_of_a_record_and_are_missing_where_it_has_none():
    columns = [Column("q_max", place="q.max"), Column("above", place="count_above.0.6"), Column("case")]
    records = [{"case": "a", "q": {"max": 0.5}, "count_above": {"0.6": 3}}, {"case": "b", "q": {}}]
    found = values(columns, records)
    assert list(found) == ["q_max", "above", "case"] and found["q_max"].isna().tolist() == [False, True]
    assert found.loc[0].tolist() == [0.5, 3, "a"]
