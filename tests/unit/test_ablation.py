"""The tables of the experiments hold what the records hold; what failed is a row, or part of one, that says so."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from cubes import cube_mesh
from latex import require_fits

from cortet.formats.tables import names
from cortet.measure.quality import summarise
from cortet.paper.ablation import ABLATION, ablation_table, write_ablation
from cortet.paper.records import Origin, by_origin
from cortet.report.records import STAGES, write_stages


def record(mean: float, worst: float, above: int) -> dict[str, Any]:
    content = asdict(summarise(cube_mesh(2)))
    content["q"] |= {"mean": mean, "max": worst}
    content["count_above"]["0.6"] = above
    return content


def at(case: str, stage: str, setting: str | None = None, mesher: str = "cgal", size: float = 0.6) -> Origin:
    return Origin(f"sub-{case}", size, mesher, setting, stage)


def rows_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows of a table, with None where there is no value."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def ours(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [row for row in rows_of(table) if row["source"] == "this cohort"]


def saved(folder: Path, origin: Origin | dict[str, str], content: dict[str, Any]) -> str:
    """File of a record that says whose it is; its name says nothing."""
    path = folder / f"{len(list(folder.iterdir()))}.json"
    path.write_text(json.dumps({"origin": origin if isinstance(origin, dict) else asdict(origin), **content}))
    return str(path)


def test_a_record_says_whose_it_is(tmp_path: Path) -> None:
    origins = [at("a", "Cleaned", "published"), at("a", "Generated", size=1.0)]
    paths = [saved(tmp_path, origin, record(0.1, 0.5, 0)) for origin in origins]
    assert list(by_origin(paths)) == origins


def test_stages_are_summarised_over_the_meshes_in_their_order() -> None:
    records = {
        at("a", "Cleaned", "published"): record(0.128, 0.50, 0),
        at("b", "Cleaned", "published"): record(0.130, 0.52, 0),
        at("a", "Generated"): record(0.134, 0.75, 800),
        at("b", "Generated"): record(0.136, 0.81, 1000),
        at("a", "Cleaned", "default"): record(0.12, 0.4, 0),
        at("b", "Cleaned", "default"): record(0.12, 0.4, 0),
    }
    first, second, third = ours(ablation_table(records, {}, {}, {}))
    assert [(row["stages"], row["setting"]) for row in (first, second, third)] == [
        ("S1-S2", None),
        ("S1-S4", "default"),
        ("S1-S4", "published"),
    ]
    assert first["q_mean_mean"] == pytest.approx(0.135)
    assert first["q_mean_sd"] == pytest.approx(0.0014142, rel=1e-4)
    assert (first["q_max_median"], first["q_max_min"], first["q_max_max"]) == (pytest.approx(0.78), 0.75, 0.81)
    assert (first["q_above_0.6_median"], first["q_above_0.6_total"]) == (900, 1800)
    assert (first["meshes"], first["failed"], first["tets_total"]) == (2, 0, 96)


def test_a_mean_that_cleaning_raises_is_explained() -> None:
    means = {("Generated", None): 0.24, ("Cleaned", "default"): 0.34, ("Reconnected", "default"): 0.20}
    means |= {("Relocated", "published"): 0.23, ("Cleaned", "published"): 0.232}
    records = {at("a", *key, "tetgen"): record(mean, 0.9, 9) for key, mean in means.items()}
    told = {(row["stages"], row["setting"]): row["remarks"] for row in ours(ablation_table(records, {}, {}, {}))}
    assert [key for key, remark in told.items() if "mean q rises" in remark] == [("S1-S4", "default")]


def test_cell_sizes_and_meshers_are_rows_of_their_own() -> None:
    records = {
        at("a", "Generated"): record(0.1, 0.7, 1),
        at("a", "Generated", size=1.0): record(0.1, 0.7, 1),
        at("a", "Generated", mesher="tetgen"): record(0.2, 0.99, 9),
    }
    rows = ours(ablation_table(records, {}, {}, {}))
    assert [(row["cell_size_mm"], row["configuration"]) for row in rows] == [
        (0.6, "CGAL only"),
        (0.6, "TetGen only"),
        (1.0, "CGAL only"),
    ]


def test_a_mesher_that_fails_is_a_row_that_says_so() -> None:
    reports = {at("a", "Generated", mesher="netgen"): {"failure": "netgen crashed (SIGSEGV)"}}
    (row,) = ours(ablation_table({}, reports, {}, {}))
    assert (row["configuration"], row["meshes"], row["failed"]) == ("Netgen only", 0, 1)
    assert row["remarks"] == "sub-a: netgen crashed (SIGSEGV)"
    assert row["q_max_median"] is None


def test_what_a_failed_job_left_out_is_told_with_the_reason() -> None:
    records = {at("a", "Cleaned", "default"): record(0.12, 0.4, 0)}
    missing = {at("b", "Cleaned", "default"): "relocate: Gmsh failed", at("c", "Cleaned", "default"): "clean: too bad"}
    (row,) = ours(ablation_table(records, {}, missing, {}))
    assert (row["meshes"], row["failed"]) == (1, 2)
    assert row["remarks"] == "sub-b: relocate: Gmsh failed; sub-c: clean: too bad"


def test_a_reason_that_many_cases_share_is_printed_with_three_of_them() -> None:
    missing = {at(case, "Cleaned", "default"): "clean: sub-optimal, too bad" for case in "abcdefg"}
    (row,) = ours(ablation_table({}, {}, missing, {}))
    assert row["remarks"].startswith("sub-a, sub-b, sub-c, sub-d, sub-e, sub-f, sub-g: clean")
    (column,) = (column for column in ABLATION.columns if column.name == "remarks")
    assert column.text(row) == "sub-a, sub-b, sub-c and 4 more: clean: sub-optimal, too bad"


def test_meshes_of_the_fallback_and_of_wrong_topology_are_counted() -> None:
    records = {at(case, "Cleaned", "default"): record(0.12, 0.4, 0) for case in "abc"}
    reports = {
        at("a", "Generated"): {"backend": "pygalmesh", "topology_ok": True},
        at("b", "Generated"): {"backend": "tetgen", "topology_ok": True},
        at("c", "Generated"): {"backend": "pygalmesh", "topology_ok": False},
    }
    (row,) = ours(ablation_table(records, reports, {}, {}))
    assert (row["fallback"], row["wrong_topology"]) == (1, 1)
    (remark,) = (column.text(row) for column in ABLATION.printed if column.heading == "Remarks")
    assert remark == "1 by S1's fallback"


def test_reference_meshes_and_the_published_table_stand_below() -> None:
    references = {"tallinen": record(0.162, 0.811, 15)}
    rows = rows_of(ablation_table({at("a", "Generated"): record(0.1, 0.7, 1)}, {}, {}, references))
    assert [row["source"] for row in rows] == ["this cohort", "reference mesh"] + 5 * ["arXiv:2607.12157"]
    assert rows[1]["q_max_median"] == 0.811
    assert [row["q_above_0.6_median"] for row in rows[2:]] == [15955, 15, 888, 191, 0]


def test_it_is_written_from_files(tmp_path: Path) -> None:
    quality = saved(tmp_path, at("a", "Generated"), record(0.13, 0.7, 3))
    reference = saved(tmp_path, {"reference": "ball"}, record(0.2, 0.8, 4))
    failed = saved(tmp_path, at("a", "Generated", mesher="netgen"), {"failure": "netgen failed"})
    missing = [{"origin": asdict(at("b", "Generated")), "reason": 'gate: "open"'}]
    outputs = [str(tmp_path / f"table.{suffix}") for suffix in ("tsv", "json", "tex", "md", "html")]
    write_ablation([quality], [failed], missing, [reference], outputs)
    lines = (tmp_path / "table.tsv").read_text().splitlines()
    assert lines[0].split("\t") == names(ABLATION.columns) == list(json.loads((tmp_path / "table.json").read_text()))
    assert [line.split("\t")[5] for line in lines[1:4]] == ["CGAL only", "Netgen only", "ball"]
    assert lines[1].endswith('\tsub-b: gate: "open"')


def test_it_fits_both_columns_of_a_journal(tmp_path: Path) -> None:
    qualities = [saved(tmp_path, at(name, "Generated"), record(0.13, 0.7, 12_095)) for name in ("a", "c", "d")]
    missing = [{"origin": asdict(at("b", "Generated")), "reason": "gate: the surface is open along 3 edges"}]
    write_ablation(qualities, [], missing, [], [str(tmp_path / "table.tex")])
    require_fits(tmp_path / "table.tex")


def test_the_table_of_stages_has_a_row_per_record_in_the_order_given(tmp_path: Path) -> None:
    paths = [
        saved(tmp_path, at("1_hemi-L", stage), record(0.1, worst, 0))
        for stage, worst in [("Generated", 0.8), ("Cleaned", 0.45)]
    ]
    write_stages(paths, [tmp_path / "stages.tsv", tmp_path / "stages.json"])
    header, *rows = [line.split("\t") for line in (tmp_path / "stages.tsv").read_text().splitlines()]
    assert header == names(STAGES.columns) == list(json.loads((tmp_path / "stages.json").read_text()))
    told = [dict(zip(header, row, strict=True)) for row in rows]
    assert [(row["case"], row["stage"], row["q_max"]) for row in told] == [
        ("sub-1_hemi-L", "Generated", "0.8"),
        ("sub-1_hemi-L", "Cleaned", "0.45"),
    ]
    assert told[0]["q_above_0.4"] == str(record(0.1, 0.8, 0)["count_above"]["0.4"])
