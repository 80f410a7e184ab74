"""The page of a cohort: a table of all cases with what is known of each, failures and outliers first."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.image import imread

from cortet.cohort.status import COLUMNS as STATUS
from cortet.formats.tsv import MISSING, cell, read_tsv
from cortet.report import pages

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


@dataclass(frozen=True)
class PageColumn:
    """One column of the page's table."""

    name: str
    heading: str
    #: how a number is written; none: the text as it is
    form: str = ""
    #: explanation, where the sidecar of the quality table has none
    description: str = ""


_SCORE = (
    "Larger of the absolute modified z-scores of worst q and mean q (Iglewicz and Hoaglin 1993) among the meshes of "
    f"one cell size and mesher, where there are at least {FEWEST}; above {OUTLIER} a mesh is called an outlier. "
    "A spread counts as at least: " + ", ".join(f"{JUDGED[name]} {least:g}" for name, least in LEAST_SPREAD.items())
)
COLUMNS = (
    PageColumn("case", "Case"),
    PageColumn("state", "State"),
    PageColumn("outlier", "Outlier score", ".1f", _SCORE),
    PageColumn("q_max", "Worst q", ".4f"),
    PageColumn("q_mean", "Mean q", ".4f"),
    PageColumn("q_above_0.5", "q > 0.5", ",.0f"),
    PageColumn("q_above_0.6", "q > 0.6", ",.0f"),
    PageColumn("tets", "Tetrahedra", ",.0f"),
    PageColumn("nodes", "Nodes", ",.0f"),
    PageColumn("scan_age", "Age (weeks)", "g"),
    PageColumn("hemi", "Hemisphere"),
    PageColumn("cell_size_mm", "h (mm)", "g"),
    PageColumn("mesher", "Mesher"),
    PageColumn("nodes_to_surface_max_mm", "Nodes off the surface (mm)", ".2g"),
    PageColumn("surface_to_boundary_max_mm", "Surface off the mesh (mm)", ".3f"),
    PageColumn("euler_number", "Euler number", ".0f"),
    PageColumn("crossing_faces", "Crossing faces", ",.0f"),
    PageColumn("resample_native_to_resampled_mean_mm", "Off the native surface, mean (mm)", ".2g"),
    PageColumn("resample_native_to_resampled_max_mm", "Off the native surface (mm)", ".2g"),
    PageColumn("surface_state", "Input surface"),
    PageColumn("repair_surface_to_file_max_mm", "Repaired surface off its file (mm)", ".2g"),
    PageColumn("repair_relative_volume_change", "Volume change by repair", "+.2%"),
    PageColumn("valence_bound", "Bound of worst q", ".3f"),
    PageColumn("dihedral_min_deg", "Smallest dihedral (°)", ".1f"),
    PageColumn("dihedral_max_deg", "Largest dihedral (°)", ".1f"),
    PageColumn("volume_ml", "Volume (mL)", ".1f"),
    PageColumn("relative_volume_change", "Volume change", "+.2%"),
    PageColumn("relative_area_change", "Area change", "+.2%"),
    PageColumn("roughness", "Roughness", ".3f"),
)

#: columns of the table of folds, after case and state
FOLD_COLUMNS = (
    PageColumn("variant", "Variant"),
    PageColumn("cell_size_mm", "h (mm)", "g"),
    PageColumn("mesher", "Mesher"),
    PageColumn("start_weeks", "From (weeks)", ".1f"),
    PageColumn("end_weeks", "To (weeks)", ".1f"),
    PageColumn("gyrification_index", "Gyrification index", ".3f"),
    PageColumn("fold_spacing_mm", "Width of folds (mm)", ".1f"),
    PageColumn("sulcal_depth_mm", "Depth of sulci (mm)", ".2f"),
    PageColumn("min_j", "Smallest J", ".3f"),
    PageColumn("q_max", "Worst q", ".3f"),
    PageColumn("steps", "Steps", ",.0f"),
)


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
    rows, explained = read_tsv(status), dict[str, Any](STATUS)
    described = pd.DataFrame(list(meshes), columns=None if meshes else [*KEY, "page"], dtype=object)
    rows = _with_columns(rows, described.where(described.notna(), None).map(cell))
    if quality:
        table, sidecar = quality
        explained |= json.loads(sidecar.read_text(encoding="utf-8"))
        rows = _with_columns(rows, read_tsv(table))
    rows = ordered(with_outliers(rows))
    shown = [column for column in COLUMNS if column.name in rows and (rows[column.name] != MISSING).any()]
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
        fold_columns=FOLD_COLUMNS,
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
            "cells": [_formatted(row[column.name], column.form) for column in FOLD_COLUMNS],
        }
        for row in read_tsv(table).to_dict("records")
    ]


def _formatted(text: str, form: str) -> str:
    number = _number(text) if form else None
    return ("" if text == MISSING else text) if number is None else f"{number:{form}}"


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


def _number(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None


def _shown(row: Row, columns: Sequence[PageColumn]) -> dict[str, Any]:
    cells = []
    for column in columns:
        text = row.get(column.name, MISSING)
        number = _number(text) if column.form else None
        cells.append(
            {
                "name": column.name,
                "text": "" if text == MISSING else text if number is None else f"{number:{column.form}}",
                "number": number,
            }
        )
    why = ": ".join(row[name] for name in ("stage", "reason") if row["reason"] != MISSING and row[name] != MISSING)
    page = "" if row["page"] == MISSING else row["page"]
    return {"page": page, "state": row["state"], "outlying": row["outlying"], "why": why, "cells": cells}


def _counts(rows: pd.DataFrame) -> list[tuple[str, int]]:
    """State -> number of rows, certified ones first."""
    counts = rows["state"].value_counts()
    return [(state, int(counts[state])) for state in dict.fromkeys(("certified", *_ORDER)) if state in counts]


def _explanation(column: PageColumn, explained: Mapping[str, Any]) -> str:
    entry = explained.get(column.name, {})
    text = column.description or entry.get("Description", "")
    return f"{text}; limit {entry['Threshold']}" if "Threshold" in entry else text
