"""The page of a cohort: a table of all cases with what is known of each, failures and outliers first."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from cortet.cohort.status import COLUMNS as STATUS
from cortet.formats.tsv import MISSING, cell, read_tsv
from cortet.report import pages

Row = Mapping[str, str]

#: a modified z-score beyond which a value is called an outlier, and the fewest values that are judged
#: (Iglewicz and Hoaglin, How to detect and handle outliers, ASQC Quality Press, 1993, who give 3.5)
OUTLIER, FEWEST = 3.5, 5
#: column -> how it is called where it makes a mesh an outlier
JUDGED = {"q_max": "worst q", "q_mean": "mean q"}
#: states in the order of the rows; certified meshes come by their outlier score
_ORDER = ("failed", "unfinished", "uncertified", "certified", "excluded")


@dataclass(frozen=True)
class Column:
    """One column of the page's table."""

    name: str
    heading: str
    #: how a number is written; none: the text as it is
    form: str = ""
    #: explanation, where the sidecar of the quality table has none
    description: str = ""


_SCORE = (
    "Larger of the absolute modified z-scores of worst q and mean q (Iglewicz and Hoaglin 1993) among the meshes of "
    f"one cell size and mesher, where there are at least {FEWEST}; above {OUTLIER} a mesh is called an outlier"
)
COLUMNS = (
    Column("case", "Case"),
    Column("state", "State"),
    Column("outlier", "Outlier score", ".1f", _SCORE),
    Column("q_max", "Worst q", ".4f"),
    Column("q_mean", "Mean q", ".4f"),
    Column("q_above_0.5", "q > 0.5", ",.0f"),
    Column("q_above_0.6", "q > 0.6", ",.0f"),
    Column("tets", "Tetrahedra", ",.0f"),
    Column("nodes", "Nodes", ",.0f"),
    Column("scan_age", "Age (weeks)", "g"),
    Column("hemi", "Hemisphere"),
    Column("cell_size_mm", "h (mm)", "g"),
    Column("mesher", "Mesher"),
    Column("nodes_to_surface_max_mm", "Nodes off the surface (mm)", ".2g"),
    Column("surface_to_boundary_max_mm", "Surface off the mesh (mm)", ".3f"),
    Column("euler_number", "Euler number", ".0f"),
    Column("crossing_faces", "Crossing faces", ",.0f"),
    Column("valence_bound", "Bound of worst q", ".3f"),
    Column("dihedral_min_deg", "Smallest dihedral (°)", ".1f"),
    Column("dihedral_max_deg", "Largest dihedral (°)", ".1f"),
    Column("volume_ml", "Volume (mL)", ".1f"),
    Column("relative_volume_change", "Volume change", "+.2%"),
    Column("relative_area_change", "Area change", "+.2%"),
    Column("roughness", "Roughness", ".3f"),
)


def write_cohort_page(
    status: Path,
    quality: tuple[Path, Path] | None,
    path: str | Path,
    *,
    meshes: Sequence[Mapping[str, Any]],
    figure: Path | None = None,
) -> None:
    """Write the page.

    Parameters
    ----------
    status : `cohort_status.tsv`
    quality : `cohort_quality.tsv` and its sidecar; None where no mesh was measured
    meshes : `case`, `cell_size_mm`, `mesher`, and `page`, the address of its page as seen from this one; and what is
        known of a mesh that was not measured, `scan_age` and `hemi`
    figure : SVG file of the cohort against age
    """
    known = {key(mesh): mesh for mesh in ({name: cell(value) for name, value in mesh.items()} for mesh in meshes)}
    rows, explained = [{**known.get(key(row), {}), **row} for row in read_tsv(status)], dict[str, Any](STATUS)
    if quality:
        table, sidecar = quality
        explained |= json.loads(sidecar.read_text(encoding="utf-8"))
        measured = {key(row): row for row in read_tsv(table)}
        rows = [{**measured.get(key(row), {}), **row} for row in rows]
    rows = ordered(with_outliers(rows))
    shown = [column for column in COLUMNS if any(row.get(column.name, MISSING) != MISSING for row in rows)]
    pages.write(
        "cohort.html.j2",
        path,
        scripts=(pages.source("table.js"),),
        title="All cases",
        columns=[{"column": column, "text": _explanation(column, explained)} for column in shown],
        rows=[_shown(row, shown) for row in rows],
        counts=_counts(rows),
        outliers=sum(bool(row["outlying"]) for row in rows),
        figure=pages.embedded(figure.read_text(encoding="utf-8"), "age") if figure else "",
        files=[file.name for file in (status, *(quality or ()))],
    )


def key(row: Mapping[str, str]) -> str:
    """What tells meshes apart: case, cell size (mm) and mesher, as the tables write them."""
    return " ".join(row.get(name, MISSING) for name in ("case", "cell_size_mm", "mesher"))


def modified_z_scores(values: Sequence[float]) -> list[float]:
    """Distance of each value to the median, in robust standard deviations (Iglewicz and Hoaglin 1993).

    0.6745 (x - median) / MAD with the median absolute deviation MAD; where more than half of the values are equal, the
    mean absolute deviation, times 1.2533, takes its place. All are 0 where the values are equal.
    """
    middle = statistics.median(values)
    deviations = [abs(value - middle) for value in values]
    scale = statistics.median(deviations) / 0.6745 or 1.2533 * statistics.fmean(deviations)
    return [(value - middle) / scale if scale else 0.0 for value in values]


def with_outliers(rows: Sequence[Row]) -> list[dict[str, str]]:
    """Rows with `outlier`, the largest absolute score of a mesh, and `outlying`, what makes it an outlier, if anything.

    Meshes are compared with those of their cell size and mesher, where there are at least `FEWEST`.
    """
    scores = {name: [0.0] * len(rows) for name in JUDGED}
    judged = set[int]()
    for members in _groups(rows):
        if len(members) >= FEWEST:
            judged.update(members)
            for name, found in scores.items():
                values = modified_z_scores([float(rows[member][name]) for member in members])
                for member, value in zip(members, values, strict=True):
                    found[member] = value
    result = []
    for number, row in enumerate(rows):
        own = {name: found[number] for name, found in scores.items()}
        far = [f"{JUDGED[name]} {value:+.1f}" for name, value in own.items() if abs(value) > OUTLIER]
        largest = f"{max(map(abs, own.values())):.6g}" if number in judged else MISSING
        result.append({**row, "outlier": largest, "outlying": ", ".join(far)})
    return result


def ordered(rows: Iterable[dict[str, str]]) -> list[dict[str, str]]:
    """Failed cases first, then those that are not certified, then the others, the farthest outlier first."""

    def rank(row: Row) -> tuple[int, float, str]:
        score = _number(row["outlier"])
        return _ORDER.index(row["state"]), -(score if score is not None else -1.0), key(row)

    return sorted(rows, key=rank)


def _groups(rows: Sequence[Row]) -> list[list[int]]:
    """Numbers of the measured rows, together where cell size and mesher are the same."""
    measured = [n for n, row in enumerate(rows) if all(_number(row.get(name)) is not None for name in JUDGED)]
    sort: Callable[[int], tuple[str, ...]] = lambda n: (rows[n]["cell_size_mm"], rows[n]["mesher"])  # noqa: E731
    return [list(members) for _, members in groupby(sorted(measured, key=sort), sort)]


def _number(text: str | None) -> float | None:
    try:
        return float(text or "")
    except ValueError:
        return None


def _shown(row: Row, columns: Sequence[Column]) -> dict[str, Any]:
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
    return {"page": row.get("page", ""), "state": row["state"], "outlying": row["outlying"], "why": why, "cells": cells}


def _counts(rows: Sequence[Row]) -> list[tuple[str, int]]:
    """State -> number of rows, certified ones first."""
    states = [row["state"] for row in rows]
    return [(state, states.count(state)) for state in sorted(set(states), key=("certified", *_ORDER).index)]


def _explanation(column: Column, explained: Mapping[str, Any]) -> str:
    entry = explained.get(column.name, {})
    text = column.description or entry.get("Description", "")
    return f"{text}; limit {entry['Threshold']}" if "Threshold" in entry else text
