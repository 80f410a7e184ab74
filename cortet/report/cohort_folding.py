"""All folds of a cohort: a table with a row per run, also of those that stopped, and their curves over real brains."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cortet.formats.atomic import write_json
from cortet.formats.tsv import read_tsv, write_tsv
from cortet.report.figures import COLOURS, PAGE, STYLE, save
from cortet.report.fold_figures import curves, real_points
from cortet.simulation.journal import TABLE, VERDICT

VERSION: int = 1

#: columns of `cohort_folding.tsv`
COLUMNS: dict[str, dict[str, Any]] = {
    "case": {"Description": "Name of the case"},
    "variant": {"Description": "Name of the variant in fold.variants; n/a: the settings of fold"},
    "cell_size_mm": {"Description": "Cell size h", "Units": "mm"},
    "mesher": {"Description": "Mesher of S1"},
    "state": {
        "Description": "How the run ended",
        "Levels": {
            "folded": "no element inverted until the end",
            "inverted": "stopped at the first inverted element",
            "failed": "no result: the reason says why",
        },
    },
    "start_weeks": {"Description": "Gestational age at the start", "Units": "weeks"},
    "end_weeks": {"Description": "Gestational age at the last row", "Units": "weeks"},
    "gyrification_index": {"Description": "Area of the surface over that of its convex hull, at the end"},
    "fold_spacing_mm": {"Description": "Mean distance from gyrus to gyrus at the end", "Units": "mm"},
    "sulcal_depth_mm": {"Description": "Mean distance of the cortex from the convex hull at the end", "Units": "mm"},
    "area_mm2": {"Description": "Area of the surface at the end", "Units": "mm2"},
    "volume_mm3": {"Description": "Volume at the end", "Units": "mm3"},
    "thickness_mm": {"Description": "Thickness of the growing cortex at the start", "Units": "mm"},
    "min_j": {"Description": "Smallest determinant of the elastic deformation gradient in any step"},
    "q_max": {"Description": "Largest q of the deformed tetrahedra in any row"},
    "tets": {"Description": "Number of tetrahedra"},
    "steps": {"Description": "Steps taken"},
    "reason": {"Description": "How the run ended, in words"},
}
_LAST = ("gyrification_index", "fold_spacing_mm", "sulcal_depth_mm", "area_mm2", "volume_mm3")
#: runs of which each has a name in the legend, and as many colours (Paul Tol's beyond those of other figures)
_NAMED = 10
_COLOURS = (*COLOURS, "#56B4E9", "#44AA99", "#882255", "#8A6D3B", "#6B6B6B")


def write_cohort_folding(
    runs: Sequence[Mapping[str, Any]], missing: Sequence[Mapping[str, Any]], outputs: Sequence[str | Path]
) -> None:
    """Write table (tsv), its sidecar (json) and figure (svg, pdf, png), by the suffixes of the paths.

    Parameters
    ----------
    runs : per run `case`, `variant`, `cell_size_mm`, `mesher`, `hemisphere` and its `folder`
    missing : the same of those that failed, with the `reason` in place of the folder
    """
    rows = [_row(run) for run in runs]
    rows += [{**{key: value for key, value in run.items() if key in COLUMNS}, "state": "failed"} for run in missing]
    for path in map(Path, outputs):
        if path.suffix == ".tsv":
            write_tsv(sorted(rows, key=_order), list(COLUMNS), path)
        elif path.suffix == ".json":
            write_json(COLUMNS, path)
    save(cohort_folding_figure(runs), *(path for path in map(Path, outputs) if path.suffix not in (".tsv", ".json")))


def _order(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """Failed runs first, then those that stopped."""
    return list(COLUMNS["state"]["Levels"])[::-1].index(row["state"]), row["case"], row["variant"] or ""


def _row(run: Mapping[str, Any]) -> dict[str, Any]:
    folder = Path(run["folder"])
    verdict = json.loads((folder / VERDICT).read_text(encoding="utf-8"))
    table = read_tsv(folder / TABLE).apply(pd.to_numeric, errors="coerce")
    last = table.iloc[-1]
    return {
        **{key: run[key] for key in ("case", "variant", "cell_size_mm", "mesher")},
        "state": verdict["outcome"],
        "start_weeks": float(table["gestational_age"].iloc[0]),
        "end_weeks": verdict["gestational_age"],
        **{column: None if pd.isna(last[column]) else float(last[column]) for column in _LAST},
        **{key: verdict[key] for key in ("thickness_mm", "min_j", "q_max", "tets", "steps", "reason")},
    }


def cohort_folding_figure(runs: Sequence[Mapping[str, Any]]) -> Figure:
    """Gyrification index and area / volume^(2/3) of every run against age, over real brains; variants are dashed."""
    cases = list(dict.fromkeys(run["case"] for run in runs))
    variants = list(dict.fromkeys(run["variant"] for run in runs))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(PAGE, 2.8), layout="constrained")
        panels = {"gyrification_index": "gyrification index", "relative_area": "area / volume$^{2/3}$"}
        for axis, (column, label) in zip(figure.subplots(1, 2), panels.items(), strict=True):
            for run in runs:
                _draw(axis, run, column, cases, variants)
            axis.set(xlabel="gestational age (weeks)", ylabel=label)
            for hemisphere in dict.fromkeys("L" if run["hemisphere"] else None for run in runs):
                real_points(axis, column, hemisphere)
        if runs:
            figure.axes[0].legend(loc="upper left")
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure


def _draw(
    axis: Axes, run: Mapping[str, Any], column: str, cases: Sequence[str], variants: Sequence[str | None]
) -> None:
    rows = curves(Path(run["folder"]) / TABLE)
    many = len(cases) * len(variants) > _NAMED
    dashes = ("-", "--", ":", "-.")[variants.index(run["variant"]) % 4]
    name = " ".join(filter(None, (run["case"], run["variant"])))
    axis.plot(
        rows["gestational_age"],
        rows[column],
        linestyle=dashes,
        color=_COLOURS[cases.index(run["case"]) % len(_COLOURS)],
        alpha=0.5 if many else 1.0,
        label=None if many else name,
    )
