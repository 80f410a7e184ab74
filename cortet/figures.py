"""Figures for print: one style for all of them, and files that are the same every time they are made."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cortet.formats.atomic import atomic_path

VERSION: int = 1

#: width of one column of a two-column journal, and of both, inches
COLUMN, PAGE = 3.5, 7.2
#: colours that colour-blind readers tell apart (Okabe and Ito), and the grey of published data behind ours
BLUE, VERMILION, GREEN, ORANGE, PURPLE = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7"
GREY = "#B8B8B8"
#: hemisphere -> colour and marker
HEMISPHERES = {"L": (BLUE, "o", "left"), "R": (VERMILION, "^", "right"), "n/a": (GREEN, "s", "whole brain")}

STYLE = {
    "font.family": "DejaVu Sans",  # comes with Matplotlib: the same letters everywhere
    "font.size": 7,
    "axes.labelsize": 7,
    "axes.titlesize": 7,
    "legend.fontsize": 6,
    "xtick.labelsize": 6,
    "ytick.labelsize": 6,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.0,
    "lines.markersize": 4,
    "legend.frameon": False,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "svg.hashsalt": "cortet",  # ids do not change from run to run
}

#: column of the quality table -> label of its panel
_PANELS = {"tets": "tetrahedra (thousands)", "q_mean": "mean q", "q_max": r"$q_\mathrm{max}$"}


def cohort_figure(table: Path, *, limit: float | None = None) -> Figure:
    """Number of tetrahedra, mean q and worst q of every mesh against gestational age, the published cohort behind.

    Parameters
    ----------
    table : `cohort_quality.tsv`
    limit : of the worst q, drawn as a line; None draws none
    """
    rows, published = read_tsv(table), published_cohort()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(PAGE, 2.6), layout="constrained")
        axes = figure.subplots(1, 3)
        for axis, (column, label) in zip(axes, _PANELS.items(), strict=True):
            unit = 1000 if column == "tets" else 1
            _panel(axis, rows, published, column, unit)
            axis.set(xlabel="gestational age (weeks)", ylabel=label)
        axes[0].set_ylim(bottom=0)
        low, high = axes[1].get_ylim()
        axes[1].set_ylim(min(low, 0.125), max(high, 0.135))  # else differences of 0.001 look large
        if limit is not None:
            axes[2].axhline(limit, color="black", linestyle="--", linewidth=0.8)
            axes[2].annotate(
                f"limit {limit:g}", (0.02, limit), xycoords=axes[2].get_yaxis_transform(), xytext=(0, 2),
                textcoords="offset points", fontsize=6,
            )  # fmt: skip
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4))
        figure.draw_without_rendering()
    figure.set_layout_engine("none")  # laid out once: every further round would shift it a little
    return figure


def save(figure: Figure, *paths: str | Path) -> None:
    """Write a figure once per path, in the format of its suffix (pdf, svg, png), without date or version in it."""
    for path in map(Path, paths):
        kind = path.suffix.removeprefix(".")
        metadata = {"pdf": {"CreationDate": None, "Producer": None, "Creator": None}, "svg": {"Date": None}}
        with mpl.rc_context(STYLE), atomic_path(path) as temporary:
            figure.savefig(temporary, format=kind, metadata=metadata.get(kind, {"Software": None}))


def read_tsv(path: Path) -> list[dict[str, str]]:
    """Rows of a table of tab-separated values with a header line."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))


def published_cohort() -> list[dict[str, str]]:
    """The 194 meshes of the CORTET paper (arXiv:2607.12157, Fig. 3), cell size 0.6 mm."""
    text = (files("cortet") / "data" / "published_cohort.tsv").read_text(encoding="utf-8")
    return list(csv.DictReader(text.splitlines(), delimiter="\t"))


def _panel(
    axis: Axes, rows: Sequence[Mapping[str, str]], published: Sequence[Mapping[str, str]], column: str, unit: float
) -> None:
    axis.scatter(
        _numbers(published, "scan_age_weeks"),
        _numbers(published, column) / unit,
        s=6,
        color=GREY,
        linewidths=0,
        label=f"published, h = 0.6 mm (n = {len(published)})",
    )
    sizes = sorted({float(row["cell_size_mm"]) for row in rows})
    for rank, size in enumerate(sizes):
        for hemi, (colour, marker, side) in HEMISPHERES.items():
            chosen = [row for row in rows if float(row["cell_size_mm"]) == size and row["hemi"] == hemi]
            if chosen:
                axis.scatter(
                    _numbers(chosen, "scan_age"),
                    _numbers(chosen, column) / unit,
                    s=16 + 10 * rank,
                    marker=marker,
                    facecolors="none" if rank else colour,  # the finest meshes filled, coarser ones larger and open
                    edgecolors=colour,
                    linewidths=0.8,
                    label=f"{side}, h = {size:g} mm (n = {len(chosen)})",
                )


def _numbers(rows: Sequence[Mapping[str, Any]], column: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([float(row[column]) for row in rows])
