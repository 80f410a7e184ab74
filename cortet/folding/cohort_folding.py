"""All folds of a cohort: a table with a row per run, including stopped runs, and their curves over real brains."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cortet.folding.fold_figures import FILM, NUMBERS, PICTURE, curves, real_points, weeks
from cortet.folding.journal import TABLE, VERDICT
from cortet.folding.sentences import verdict_of_fold
from cortet.formats.tables import Column, headed, read_columns, write_table
from cortet.formats.tsv import MISSING, cell, read_tsv
from cortet.report import pages
from cortet.report.cohort_page import KEY
from cortet.report.colours import COLOURS
from cortet.report.figures import PAGE, H, drawn, letter, save
from cortet.report.pages import Panel, Part

VERSION: int = 6

_DATA = Path(__file__).with_name("data")

#: how a run ended -> what it means, in the reverse order of the rows
STATES = {
    "folded": "no element inverted until the end",
    "inverted": "stopped at the first inverted element",
    "implausible": "stopped because its gyrification index was far below 1",
    "failed": "no result: the reason says why",
}
#: columns of `cohort_folding.tsv`, one per line of the file; the page of the cohort shows those with a heading
COLUMNS = tuple(
    replace(column, levels=STATES) if column.name == "state" else column
    for column in read_columns(_DATA / "cohort_folding_columns.tsv")
)
#: columns from the verdict that those of earlier versions lack, or mean otherwise
_LATER = (
    "distortion_max",
    "distorted_share",
    "compressed_share",
    "gyrification_index_error",
    "fold_spacing_error_mm",
)
_LAST = ("gyrification_index", "fold_spacing_mm", "sulcal_depth_mm", "area_mm2", "volume_mm3")
#: most runs that the legend names, and a colour for each (Paul Tol's, besides those of other figures)
_NAMED = 10
_COLOURS = (*COLOURS, "#56B4E9", "#44AA99", "#882255", "#8A6D3B", "#6B6B6B")


_CURVES = {
    "alt": "Gyrification index and area over volume to the power of two thirds of every fold against gestational age, "
    "real brains as points; the table has the numbers",
}
#: files of a fold beside its table -> what they show
_PICTURES = {NUMBERS: "curves", PICTURE: "by age", FILM: "film"}


def write_cohort_folding(
    runs: Sequence[Mapping[str, Any]], missing: Sequence[Mapping[str, Any]], outputs: Sequence[str | Path]
) -> None:
    """Write table (tsv), its sidecar (json) and figure (svg, pdf, png), by the suffixes of the paths.

    Parameters
    ----------
    runs : per run `case`, `variant`, `cell_size_mm`, `mesher`, `hemisphere` and its `folder`
    missing : the same for runs that failed, with the `reason` instead of the folder
    """
    rows = [*map(_row, runs), *({**run, "state": "failed"} for run in missing)]
    pictures = [path for path in map(Path, outputs) if path.suffix not in (".tsv", ".json")]
    write_table(COLUMNS, sorted(rows, key=_order), *(path for path in map(Path, outputs) if path not in pictures))
    save(cohort_folding_figure(runs), *pictures)


def _order(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Failed runs first, then those that stopped."""
    return list(STATES)[::-1].index(row["state"]), row["case"], row["variant"] or ""


def _row(run: Mapping[str, Any]) -> dict[str, Any]:
    folder = Path(run["folder"])
    verdict, of_this_version = json.loads((folder / VERDICT).read_text(encoding="utf-8")), verdict_of_fold(folder)
    table = read_tsv(folder / TABLE).apply(pd.to_numeric, errors="coerce")
    last = table.iloc[-1]
    return {
        **{key: run[key] for key in ("case", "variant", "cell_size_mm", "mesher")},
        "state": verdict["outcome"],
        "start_weeks": float(table["gestational_age"].iloc[0]),
        "end_weeks": verdict["gestational_age"],
        **{column: None if pd.isna(last[column]) else float(last[column]) for column in _LAST},
        **{key: verdict[key] for key in ("thickness_mm", "min_j", "tets", "steps", "reason")},
        **{key: of_this_version.get(key) for key in _LATER},
        "warnings": "; ".join(verdict["warnings"]),
    }


def cohort_folding_figure(runs: Sequence[Mapping[str, Any]]) -> Figure:
    """Gyrification index and area / volume^(2/3) of every run against age, over real brains; variants are dashed."""
    cases = list(dict.fromkeys(run["case"] for run in runs))
    variants = list(dict.fromkeys(run["variant"] for run in runs))
    with drawn(PAGE, 3.2) as figure:
        panels = {"gyrification_index": "gyrification index", "relative_area": "area / volume$^{2/3}$"}
        for axis, (column, label) in zip(figure.subplots(1, 2), panels.items(), strict=True):
            for run in runs:
                _draw(axis, run, column, cases, variants)
            axis.set(xlabel="gestational age (weeks)", ylabel=label)
            for hemisphere in dict.fromkeys("L" if run["hemisphere"] else None for run in runs):
                real_points(axis, column, hemisphere)
            if runs:
                weeks(axis, *axis.dataLim.intervalx)
        letter(figure.axes)
        if runs:
            handles, labels = figure.axes[0].get_legend_handles_labels()
            once = dict(zip(labels, handles, strict=True))  # hemispheres and whole brains may share a source
            figure.legend(once.values(), once.keys(), loc="outside upper center", ncols=min(len(once), 4))
    return figure


def _draw(
    axis: Axes, run: Mapping[str, Any], column: str, cases: Sequence[str], variants: Sequence[str | None]
) -> None:
    rows = curves(Path(run["folder"]) / TABLE)
    many = len(cases) * len(variants) > _NAMED
    dashes = ("-", "--", ":", "-.")[variants.index(run["variant"]) % 4]
    name = " ".join(filter(None, (run["case"], run["variant"]))) + f", {H} = {run['cell_size_mm']:g} mm"
    axis.plot(
        rows["gestational_age"],
        rows[column],
        linestyle=dashes,
        color=_COLOURS[cases.index(run["case"]) % len(_COLOURS)],
        alpha=0.5 if many else 1.0,
        label=None if many else name,
    )


def panel(table: Path, figure: Path, folds: Sequence[Mapping[str, Any]]) -> Panel:
    """The panel of the page of all cases.

    Parameters
    ----------
    table, figure : TSV and SVG file of `write_cohort_folding`
    folds : per run `case`, `variant`, `cell_size_mm`, `mesher` and `folder`, as seen from the page
    """
    svg = pages.embedded(figure.read_text(encoding="utf-8"), "folding")
    return Panel("folds", "Folding", [("figure", {**_CURVES, "svg": svg}), _folds(table, folds)])


def _folds(table: Path, folds: Sequence[Mapping[str, Any]]) -> Part:
    """The table of folds, with the pictures of each run that has a result."""
    keys = [*KEY, "variant"]
    folders = {tuple(cell(run[key]) for key in keys): run["folder"] for run in folds}
    rows = []
    for row in read_tsv(table).to_dict("records"):
        doubts = "" if row["warnings"] == MISSING else row["warnings"]
        why = doubts if row["state"] == "folded" else row["reason"]
        folder = "" if row["state"] == "failed" else folders[tuple(row[key] for key in keys)]
        rows.append(
            {
                **row,
                "case": ("case", {"text": row["case"]}),
                "state": ("state", {"text": row["state"], "why": why, "plain": True}),
                "pictures": ("links", [(f"{folder}/{file}", name) for file, name in _PICTURES.items() if folder]),
            }
        )
    columns = [replace(column, description="") for column in headed(COLUMNS, ("case", "state"))]
    caption = "All folds, those that failed or stopped first"
    return pages.table(caption, [*columns, Column("pictures", heading="Pictures")], rows, name="All folds", cohort=True)
