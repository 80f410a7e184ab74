"""The page of a cohort: a table of all cases with what is known of each, failures and outliers first."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.image import imread

from cortet.cohort.status import COLUMNS as STATUS
from cortet.formats.tables import Column, headed, sidecar
from cortet.formats.tsv import MISSING, cell, read_tsv
from cortet.report import pages
from cortet.report.cohort_folding import COLUMNS as FOLDS
from cortet.report.cohort_tables import CASE_COLUMNS, QUALITY_COLUMNS

Row = Mapping[str, str]

#: columns that tell meshes apart
KEY = ["case", "cell_size_mm", "mesher"]
#: a modified z-score beyond which a value is called an outlier, and the fewest values that are judged
#: (Iglewicz and Hoaglin, How to detect and handle outliers, ASQC Quality Press, 1993, who give 3.5)
OUTLIER, FEWEST = 3.5, 5
#: column -> how it is called where it makes a mesh an outlier
JUDGED = {"q_max": "worst q", "q_mean": "mean q"}
#: least spread that a number is taken to have. Worst q of one surface that is meshed in other directions spreads by
#: 0.0005, mean q by 0.002 (a phantom of 26 weeks, h = 2.5 mm): meshes that are more alike differ by chance, and a worst
#: q that is 3.5 x 0.005 higher than others is of no consequence for a limit of 0.6
LEAST_SPREAD = {"q_max": 0.005, "q_mean": 0.002}
#: states in the order of the rows; certified meshes come by their outlier score
_ORDER = ("failed", "unfinished", "uncertified", "certified", "excluded")


_SCORE = (
    "Larger of the absolute modified z-scores of worst q and mean q (Iglewicz and Hoaglin 1993) among the meshes of "
    f"one cell size and mesher, where there are at least {FEWEST}; above {OUTLIER} a mesh is called an outlier. "
    "A spread counts as at least: " + ", ".join(f"{JUDGED[name]} {least:g}" for name, least in LEAST_SPREAD.items())
)
#: what may be known of a mesh, and what the page shows first of it
COLUMNS = (
    *STATUS,
    *CASE_COLUMNS,
    Column("outlier", _SCORE, heading="Outlier score", form=".1f"),
    *QUALITY_COLUMNS,
)
FIRST = (
    *("case", "state", "outlier", "q_max", "q_mean", "q_above_0.5", "q_above_0.6", "tets", "nodes"),
    *("scan_age", "hemi", "cell_size_mm", "mesher", "nodes_to_surface_max_mm", "surface_to_boundary_max_mm"),
    *("euler_number", "crossing_faces", "resample_native_to_resampled_mean_mm", "resample_native_to_resampled_max_mm"),
    *("surface_state", "repair_surface_to_file_max_mm", "repair_relative_volume_change"),
)


#: what the table of folds shows after case and state
_FOLD_COLUMNS = headed(FOLDS, ("case", "state"))[2:]


def write_cohort_page(
    status: Path,
    quality: tuple[Path, Path] | None,
    path: str | Path,
    *,
    meshes: Sequence[Mapping[str, Any]],
    figure: Path | None = None,
    maps: Mapping[str, Path] | None = None,
    folding: tuple[Path, Path] | None = None,
    folds: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Write the page.

    Parameters
    ----------
    status : `cohort_status.tsv`
    quality : `cohort_quality.tsv` and its sidecar; None where no mesh was measured
    meshes : per mesh `case`, `cell_size_mm`, `mesher` and `page`, the address of its page as seen from this one; with
        `scan_age` and `hemi`, which are then shown of meshes that were not measured, too
    figure : SVG file of the cohort against age
    maps : hemisphere, L or R -> PNG file of its maps on the common mesh
    folding : `cohort_folding.tsv` and its SVG file; None where nothing is folded
    folds : per run `case`, `variant`, `cell_size_mm`, `mesher` and `folder`, as seen from the page
    """
    rows, explained = read_tsv(status), sidecar(COLUMNS)
    described = pd.DataFrame(list(meshes), columns=None if meshes else [*KEY, "page"], dtype=object)
    rows = _with_columns(rows, described.where(described.notna(), None).map(cell))
    if quality:
        explained |= json.loads(quality[1].read_text(encoding="utf-8"))
        rows = _with_columns(rows, read_tsv(quality[0]))
    rows = ordered(with_outliers(rows))
    shown = [
        column for column in headed(COLUMNS, FIRST) if column.name in rows and (rows[column.name] != MISSING).any()
    ]
    pages.write(
        "cohort.html.j2",
        path,
        scripts=(pages.source("table.js"),),
        title="All cases",
        columns=[{"column": column, "text": _explanation(column, explained)} for column in shown],
        rows=[_shown(row, shown) for row in rows.to_dict("records")],
        counts=_counts(rows),
        outliers=int((rows["outlying"] != "").sum()),
        figure=pages.embedded(figure.read_text(encoding="utf-8"), "age") if figure else "",
        maps=[_map_picture(hemi, file) for hemi, file in (maps or {}).items()],
        folding=pages.embedded(folding[1].read_text(encoding="utf-8"), "folding") if folding else "",
        folds=_folds(folding[0], folds) if folding else [],
        fold_columns=_FOLD_COLUMNS,
        files=[file.name for file in (status, *(quality or ()), *(folding or ())[:1])],
    )


def _map_picture(hemi: str, file: Path) -> dict[str, Any]:
    height, width = imread(file).shape[:2]
    side = {"L": "left", "R": "right"}[hemi]
    text = f"Means over the {side} hemispheres, at the vertices that they share"
    uri = pages.data_uri(file.read_bytes(), "image/png")
    return {"uri": uri, "width": width, "height": height, "caption": text, "alt": text}


def _folds(table: Path, folds: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of the table of folds as they are shown, with the folder of each run that has a result."""
    keys = [*KEY, "variant"]
    folders = {tuple(cell(run[key]) for key in keys): run["folder"] for run in folds}
    return [
        {
            "case": row["case"],
            "state": row["state"],
            "why": "" if row["state"] == "folded" else row["reason"],
            "folder": "" if row["state"] == "failed" else folders[tuple(row[key] for key in keys)],
            "cells": [_seen(column, row) for column in _FOLD_COLUMNS],
        }
        for row in read_tsv(table).to_dict("records")
    ]


def _seen(column: Column, row: Row) -> str:
    """A cell of the page; empty where there is no value."""
    text = column.text(row)
    return "" if text == MISSING else text


def _with_columns(rows: pd.DataFrame, more: pd.DataFrame) -> pd.DataFrame:
    """Rows with the columns of another table of the same meshes that they lack; `n/a` where it has no such mesh."""
    new = more.columns.difference(rows.columns, sort=False)
    return rows.merge(more[[*KEY, *new]], how="left", on=KEY).fillna(MISSING)


def modified_z_scores(values: pd.Series[float], least: float = 0.0) -> pd.Series[float]:
    """Distance of each value to the median, in robust standard deviations (Iglewicz and Hoaglin 1993).

    0.6745 (x - median) / MAD with the median absolute deviation MAD; where more than half of the values are equal, the
    mean absolute deviation, times 1.2533, takes its place. All are 0 where the values are equal.

    Parameters
    ----------
    least : standard deviation that is taken at least
    """
    distances = values - values.median()
    scale = max(distances.abs().median() / 0.6745 or 1.2533 * distances.abs().mean(), least)
    return distances / scale if scale else 0.0 * distances


def with_outliers(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows with `outlier`, the largest absolute score of a mesh, and `outlying`, what makes it an outlier, if anything.

    Meshes are compared with those of their cell size and mesher, where there are at least `FEWEST`.

    Parameters
    ----------
    rows : all strings, as read from the tables
    """
    values = rows.reindex(columns=list(JUDGED)).apply(pd.to_numeric, errors="coerce").dropna()
    scores = pd.DataFrame(index=rows.index, columns=list(JUDGED), dtype=float)
    for _, members in values.groupby([rows.loc[values.index, name] for name in ("cell_size_mm", "mesher")]):
        if len(members) >= FEWEST:
            for name in JUDGED:
                scores.loc[members.index, name] = modified_z_scores(members[name], LEAST_SPREAD[name])
    far = [
        ", ".join(f"{JUDGED[name]} {value:+.1f}" for name, value in own.items() if abs(value) > OUTLIER)
        for own in scores.to_dict("records")
    ]
    return rows.assign(outlier=scores.abs().max(axis="columns").map(cell), outlying=far)


def ordered(rows: pd.DataFrame) -> pd.DataFrame:
    """Failed cases first, then those that are not certified, then the others, the farthest outlier first."""
    rank = pd.DataFrame(
        {
            "state": rows["state"].map(_ORDER.index),
            "score": -pd.to_numeric(rows["outlier"], errors="coerce").fillna(-1.0),
            **{name: rows[name] for name in KEY},
        }
    )
    return rows.loc[rank.sort_values(list(rank.columns)).index]


def _shown(row: Row, columns: Sequence[Column]) -> dict[str, Any]:
    cells = [{"name": column.name, "text": _seen(column, row), "number": column.number(row)} for column in columns]
    why = ": ".join(row[name] for name in ("stage", "reason") if row["reason"] != MISSING and row[name] != MISSING)
    page = "" if row["page"] == MISSING else row["page"]
    return {"page": page, "state": row["state"], "outlying": row["outlying"], "why": why, "cells": cells}


def _counts(rows: pd.DataFrame) -> list[tuple[str, int]]:
    """State -> number of rows, certified ones first."""
    counts = rows["state"].value_counts()
    return [(state, int(counts[state])) for state in dict.fromkeys(("certified", *_ORDER)) if state in counts]


def _explanation(column: Column, explained: Mapping[str, Any]) -> str:
    entry = explained[column.name]
    text = entry.get("Description", "")
    return f"{text}; limit {entry['Threshold']}" if "Threshold" in entry else text
