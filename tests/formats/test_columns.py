"""A column says once what the file, its sidecar, printed tables and pages make of it."""

from __future__ import annotations

import json

import pytest

from cortet.formats.tables import Column, described, headed, names, sidecar, values, write_table

DEPTH = Column("depth_mm", "How deep", "mm", limit="< 3", heading="Depth (mm)", form=".1f")
SIDE = Column("side", "Which side", levels={"L": "left", "R": "right"}, heading="Side")


@pytest.mark.parametrize(
    ("value", "text", "number"),
    [(2.345, "2.3", 2.345), ("2.345", "2.3", 2.345), (None, "n/a", None), ("n/a", "n/a", None), ("deep", "deep", None)],
)
def test_a_number_is_written_in_its_form_and_what_is_none_as_it_stands(value, text, number):
    assert DEPTH.text({"depth_mm": value}) == text
    assert DEPTH.number({"depth_mm": value}) == number


def test_a_form_may_be_a_function_of_the_row_and_without_one_the_text_is_that_of_the_file():
    both = Column("a", heading="a + b", form="{a} + {b}".format_map)
    assert both.text({"a": 1, "b": 2}) == "1 + 2"
    assert Column("a").text({"a": 1 / 3}) == "0.333333" and Column("a").number({"a": 1}) is None


def test_readers_see_columns_with_a_heading_and_the_last_of_a_name():
    columns = [Column("hidden"), SIDE, DEPTH, Column("side", "better", heading="Side")]
    assert names(headed(columns)) == ["side", "depth_mm"]
    assert names(headed(columns, first=("depth_mm", "absent"))) == ["depth_mm", "side"]
    assert headed(columns)[0].description == "better"


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
