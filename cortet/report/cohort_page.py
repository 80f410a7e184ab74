"""The page of a cohort: a table of all cases and their numbers, failures first, then the worst elements."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from cortet.cohort.states import COLUMNS as STATUS
from cortet.formats.tables import headed, sidecar
from cortet.formats.tsv import MISSING, cell, read_tsv
from cortet.report import pages
from cortet.report.cohort_tables import CASE_COLUMNS, QUALITY_COLUMNS
from cortet.report.pages import SIDES, Panel, Part
from cortet.report.results import PagePart

Row = Mapping[str, str]

#: columns that identify a mesh
KEY = ["case", "cell_size_mm", "mesher"]
#: states in the order of the rows; meshes of one state come by their worst q
_ORDER = ("failed", "unfinished", "uncertified", "certified", "excluded")
#: columns that a mesh may have, and the columns that the page shows first
COLUMNS = (*STATUS, *CASE_COLUMNS, *QUALITY_COLUMNS)
SHOWN = 8  # at first, of those below
FIRST = (
    *("case", "state", "scan_age", "hemi", "cell_size_mm", "q_max", "q_mean", "tets"),
    *("q_above_0.5", "q_above_0.6", "nodes", "mesher", "nodes_to_surface_max_mm"),
    "surface_to_boundary_max_mm",
    *("euler_number", "crossing_faces", "resample_native_to_resampled_mean_mm", "resample_native_to_resampled_max_mm"),
    *("surface_state", "repaired_area", "limits", "repair_surface_to_file_max_mm", "repair_relative_volume_change"),
)
_ORDER_IN_WORDS = (
    "Failed cases come first, then those that are not certified, then those with the worst elements. A name leads to "
    "the page of its mesh."
)
#: what `figures.cohort_figure` shows, in words
_SHOWS = "Number of tetrahedra, mean q, worst q, and mean distance of the surface to the mesh"


def write_cohort_page(
    status: Path,
    quality: tuple[Path, Path] | None,
    path: str | Path,
    *,
    meshes: Sequence[Mapping[str, Any]],
    figure: str = "",
    maps: Mapping[Literal["L", "R"], Path] | None = None,
    tissues: Path | None = None,
    more: Sequence[PagePart] = (),
    dataset: str = "",
    began: str = "",
) -> None:
    """Write the page.

    Parameters
    ----------
    dataset : dataset of the cases, for the title
    status : `cohort_status.tsv`
    quality : `cohort_quality.tsv` and its sidecar; None if no mesh was measured
    meshes : per mesh `case`, `cell_size_mm`, `mesher` and `page`, the address of its page as seen from this page; also
        `thumbnail`, a small picture as a `data:` address, or None; and `scan_age` and `hemi`, so that meshes that
        were not measured show them, too
    figure : SVG of `figures.cohort_figure`
    maps : hemisphere, L or R -> PNG file of its maps on the common mesh
    tissues : `cohort_tissues.tsv`; None if no case has volumes
    more : further parts of the page
    began : when a run began that has not ended; empty if none runs
    """
    rows, explained = read_tsv(status), sidecar(COLUMNS)
    described = pd.DataFrame(list(meshes), columns=None if meshes else [*KEY, "page"], dtype=object)
    rows = _with_columns(rows, described.where(described.notna(), None).map(cell))
    if quality:
        explained |= json.loads(quality[1].read_text(encoding="utf-8"))
        rows = _with_columns(rows, read_tsv(quality[0]))
    rows = ordered(rows)
    counts = _counts(rows)
    panels = [Panel("cases", "Cases", _cases(rows, explained, list(counts)))]
    if figure:
        aged = "scan_age" in rows and (rows["scan_age"] != MISSING).any()
        over = "against gestational age, over the published cohort in grey" if aged else "by case"
        shown = {"svg": pages.embedded(figure, "cohort"), "alt": f"{_SHOWS} {over}; the table has the numbers"}
        panels.append(Panel("age", "Against age" if aged else "By case", [("figure", shown)]))
    if maps:
        from cortet.report.pictures import captioned, png  # loads VTK

        drawn = [
            captioned(png(file), f"Means over the {SIDES[hemi]} hemispheres, at the vertices that they share")
            for hemi, file in maps.items()
        ]
        panels.append(Panel("maps", "On the common mesh", [("maps", drawn)]))
    panels += [panel for part in more for panel in part.panels()]
    tables = [Path(file) for part in more for file in part.files if file.endswith(".tsv")]
    files = [file.name for file in (status, *(quality or ()), *([tissues] if tissues else ()), *tables)]
    older = [("note", f"A run began on {began} and has not ended. The results below are older.")] if began else []
    pages.write(
        path,
        f"{dataset}: all cases" if dataset else "All cases",
        panels,
        top=[*older, ("facts", {"texts": _totals(rows)}), ("counts", counts.items())],
        end=[("tables", [(name, name) for name in files])],
        wide=True,
        scripts=(pages.source("table.js"),),
    )


def _totals(rows: pd.DataFrame) -> dict[str, str]:
    """The cohort in numbers."""
    values = {
        name: pd.to_numeric(rows[name], errors="coerce").dropna() for name in ("scan_age", "tets") if name in rows
    }
    facts = {"Surfaces": f"{rows['case'].nunique():,}", "Meshes": f"{len(values.get('tets', ())):,}"}
    if "tets" in values and len(values["tets"]):
        facts["Tetrahedra"] = f"{values['tets'].sum():,.0f}"
    if "scan_age" in values and len(values["scan_age"]):
        low, high = (f"{age:g}" for age in (values["scan_age"].min(), values["scan_age"].max()))
        facts["Ages"] = f"{low} weeks" if low == high else f"{low} to {high} weeks"
    return facts


def _cases(rows: pd.DataFrame, explained: Mapping[str, Any], states: Sequence[str]) -> list[Part]:
    """The table of all cases with its filter, and the meaning of its columns."""
    known = [name for name in rows if (rows[name] != MISSING).any()]
    columns = [
        replace(column, description=_explanation(explained[column.name]))
        for column in headed(COLUMNS, FIRST)
        if column.name in known
    ]
    records = rows.to_dict("records")
    table = pages.table(
        "All cases",
        columns,
        [_shown(row) for row in records],
        name="All cases",
        cohort=True,
        sortable=True,
        first=SHOWN,
        attributes=[{"data-state": row["state"]} for row in records],
    )
    return [
        ("paragraph", _ORDER_IN_WORDS),
        ("filter", states),
        table,
        ("meanings", {"texts": {column.heading: column.description for column in columns}}),
    ]


def _shown(row: Row) -> dict[str, Any]:
    """A row with the cells of the case and its state."""
    told = [row[name] for name in ("stage", "reason") if row["reason"] != MISSING and row[name] != MISSING]
    links = {name: "" if row.get(name, MISSING) == MISSING else row[name] for name in ("page", "thumbnail")}
    case = {"text": row["case"], **links}
    verdict = row["verdict_in_words"] if row["state"] == "certified" else ""
    state = {"text": row["state"], "verdict": verdict, "why": ": ".join(told)}
    return {**row, "case": ("case", case), "state": ("state", state)}


def _with_columns(rows: pd.DataFrame, more: pd.DataFrame) -> pd.DataFrame:
    """Rows with the columns that only the other table of the same meshes has; `n/a` if it has no such mesh."""
    new = more.columns.difference(rows.columns, sort=False)
    return rows.merge(more[[*KEY, *new]], how="left", on=KEY).fillna(MISSING)


def ordered(rows: pd.DataFrame) -> pd.DataFrame:
    """Failed cases first, then uncertified ones, then the others; of one state the largest worst q first."""
    rank = rows[KEY].copy()
    rank.insert(0, "state", rows["state"].map(_ORDER.index))
    if "q_max" in rows:
        rank.insert(1, "q", -pd.to_numeric(rows["q_max"], errors="coerce"))
    return rows.loc[rank.sort_values(list(rank.columns)).index]


def _counts(rows: pd.DataFrame) -> dict[str, int]:
    """State -> number of rows, certified ones first."""
    counts = rows["state"].value_counts()
    return {state: int(counts[state]) for state in dict.fromkeys(("certified", *_ORDER)) if state in counts}


def _explanation(entry: Mapping[str, Any]) -> str:
    """The sidecar's description of a column, with the limit that checks it."""
    text: str = entry.get("Description", "")
    return f"{text}; limit {entry['Threshold']}" if "Threshold" in entry else text
