"""Figures for print: one style for all, and the same bytes every time they are made."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter
from numpy.typing import NDArray

from cortet.formats.atomic import atomic_path
from cortet.formats.tsv import read_tsv
from cortet.report import published
from cortet.report.colours import BLUE, DARK_GREY, GREEN, GREY, VERMILION

if TYPE_CHECKING:
    import pandas as pd

VERSION: int = 8

#: width of one column and of both columns of a two-column journal, inches
COLUMN, PAGE = 3.5, 7.2
#: hemisphere -> colour and marker
HEMISPHERES = {"L": (BLUE, "o", "left"), "R": (VERMILION, "^", "right"), "n/a": (GREEN, "s", "whole brain")}

STYLE = {
    "font.family": "DejaVu Sans",  # comes with Matplotlib: the same letters everywhere
    "mathtext.fontset": "dejavusans",
    "font.size": 7,
    "axes.labelsize": "medium",
    "axes.titlesize": "medium",
    "legend.fontsize": "small",
    "xtick.labelsize": "small",
    "ytick.labelsize": "small",
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


#: the measure of quality as figures write it: by itself, as the label of its axis, and its largest value
Q, Q_AXIS, Q_MAX = "$q$", "$q$ (0 regular, 1 flat)", r"$q_\mathrm{max}$"
#: the cell size as figures write it
H = "$h$"
#: column of the quality table -> label of its panel
PANELS = {
    "tets": "tetrahedra (thousands)",
    "q_mean": f"mean {Q}",
    "q_max": Q_MAX,
    "surface_to_boundary_mean_mm": "surface to mesh, mean (mm)",
}


@contextmanager
def drawn(width: float, height: float) -> Iterator[Figure]:
    """A figure in the common style, inches. It is laid out once, when complete: a second layout would shift it."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        figure.draw_without_rendering()
    figure.set_layout_engine("none")


def letter(axes: Iterable[Axes], *, size: float | str = "large") -> None:
    """Write a, b, c, ... at the upper left of panels, so that a caption can name them."""
    for axis, name in zip(axes, ascii_lowercase, strict=False):
        axis.annotate(
            name, (0, 1), xycoords="axes fraction", xytext=(-22, 4), textcoords="offset points",
            fontweight="bold", fontsize=size, va="bottom", ha="left",
        )  # fmt: skip


def legend(figure: Figure, axes: Iterable[Axes], *, columns: int) -> None:
    """Explain above the figure what is drawn in any of its panels."""
    handles: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(list(handles.values()), list(handles), loc="outside upper center", ncols=min(len(handles), columns))


def cohort_figure(table: Path, *, limit: float | None = None, target: float | None = None) -> Figure:
    """Tetrahedra, mean q, worst q and fidelity of every mesh against gestational age, over the published cohort.

    If no age is known, meshes stand side by side in the order of the table, without the published ones; else those of
    unknown age are left out.

    The number of tetrahedra follows the cell size, so the published ones are shown only beside meshes of theirs; q
    depends little on it, and a panel with others says what the published one is. A cross marks meshes that are not
    certified.

    Parameters
    ----------
    table : `cohort_quality.tsv`
    limit : of the worst q, drawn as a line; None draws none
    target : of the worst q, below which nothing is improved, drawn as a dotted line; None draws none
    """
    import pandas as pd  # which the page of a mesh does without

    rows, theirs = read_tsv(table), published.cohort()
    numbers = ["cell_size_mm", "scan_age", *PANELS]
    rows[numbers] = rows[numbers].apply(pd.to_numeric, errors="coerce")  # an age may be n/a
    label_of_x = "gestational age (weeks)"
    if rows["scan_age"].isna().all():
        rows["scan_age"], theirs = np.arange(1, len(rows) + 1), theirs[[]]
        label_of_x = "case, in the order of the table"
    rows = rows.dropna(subset="scan_age")
    refused = rows[rows["verdict"] == "fail"] if "verdict" in rows else rows[:0]
    like = bool(np.isclose(rows["cell_size_mm"], published.CELL_SIZE).any())
    with drawn(PAGE, 4.6) as figure:
        axes = figure.subplots(2, 2, sharex=True).ravel()
        letter(axes)
        for axis, (column, label_of_y) in zip(axes, PANELS.items(), strict=True):
            unit = 1000 if column == "tets" else 1
            _panel(axis, rows, theirs if column in theirs and (like or column != "tets") else None, column, unit)
            if len(refused):
                mark = {"s": 22, "marker": "x", "color": "black", "linewidths": 0.8, "clip_on": False, "zorder": 3}
                label_of = f"not certified ($n$ = {len(refused)})"
                axis.scatter(refused["scan_age"], refused[column] / unit, label=label_of, **mark)
            axis.set(xlabel=label_of_x, ylabel=label_of_y)
            axis.tick_params(labelbottom=True)
            axis.xaxis.set_major_locator(MaxNLocator(8, integer=True, min_n_ticks=1))
            if column == "q_mean":
                axis.yaxis.set_major_locator(MaxNLocator(5))
                low, high = axis.get_ylim()
                axis.set_ylim(min(low, 0.125), max(high, 0.135))  # otherwise differences of 0.001 look large
            elif column == "q_max":
                for value, name, line in ((limit, "limit", "--"), (target, "target", ":")):
                    if value is not None:
                        axis.axhline(value, color="black", linestyle=line, linewidth=0.8)
                        axis.annotate(
                            f"{name}\n{value:g}", (1, value), xycoords=axis.get_yaxis_transform(), xytext=(3, 0),
                            va="center", textcoords="offset points", fontsize="small", linespacing=0.9,
                        )  # fmt: skip
                if target is not None:
                    axis.set_ylim(bottom=min(axis.get_ylim()[0], target - 0.03))
            else:
                axis.set_ylim(bottom=0)
            if not like and column in theirs and column != "tets":
                axis.annotate(
                    f"grey: {H} = {published.CELL_SIZE:g} mm", (0.02, 1), xycoords="axes fraction",
                    ha="left", va="bottom", fontsize="small", color=DARK_GREY,
                )  # fmt: skip
        legend(figure, axes, columns=4)
    return figure


def mesh_quality_figures(counts: NDArray[np.integer[Any]], *, limit: float) -> tuple[Figure, Figure]:
    """Quality of a mesh on the published distribution after S4: distribution of q, and number of elements above q.

    Parameters
    ----------
    counts : elements (200,) per bin of q
    limit : of the worst q, drawn as a line
    """
    theirs = published.histogram("S1-S4")
    with mpl.rc_context(STYLE):
        figures = (
            Figure(figsize=(COLUMN, 2.4), layout="constrained"),
            Figure(figsize=(COLUMN, 2.4), layout="constrained"),
        )
        bulk, tail = (figure.subplots() for figure in figures)
        bulk.stairs(100 * theirs / theirs.sum(), np.linspace(0, 1, len(theirs) + 1), fill=True, color=GREY, alpha=0.35)
        label = f"published (CORTET, cleaned), {H} = {published.CELL_SIZE:g} mm"
        distribution(bulk, tail, theirs, color=DARK_GREY, linewidth=0.8, label=label)
        distribution(bulk, tail, counts, color=BLUE, linewidth=1.2, label="this mesh")
        bulk.set(xlim=(0, 0.6), ylim=(0, None), ylabel="elements (% per bin of 0.005)")
        tail.set(xlim=(0, 0.9), ylim=(1e-3, 2e6), yscale="log", ylabel=f"elements above {Q} (per million)")
        in_powers_of_ten(tail.yaxis)
        mark_limit(tail, limit)
        for figure, axis in zip(figures, (bulk, tail), strict=True):
            axis.set_xlabel(Q_AXIS)
            figure.legend(*axis.get_legend_handles_labels(), loc="outside upper center", ncols=2)
            figure.patch.set_visible(False)
            axis.patch.set_visible(False)
    return figures


def in_powers_of_ten(axis: Axis) -> None:
    """Label a logarithmic axis in plain text: Matplotlib's own labels are formulas, which take a second to draw."""
    raised = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")
    axis.set_major_formatter(lambda value, _: "10" + str(round(np.log10(value))).translate(raised))
    axis.set_minor_formatter(NullFormatter())


def mark_limit(axis: Axes, limit: float, name: str = "limit", line: str = "--") -> None:
    """Draw a vertical line at a limit, with its name and value."""
    axis.axvline(limit, color="black", linestyle=line, linewidth=0.8)
    axis.annotate(
        f"{name} {limit:g}", (limit, 0.97), xycoords=axis.get_xaxis_transform(), xytext=(2, 0),
        textcoords="offset points", va="top", fontsize="small",
    )  # fmt: skip


def distribution(bulk: Axes, tail: Axes, counts: NDArray[np.integer[Any]], **style: Any) -> None:
    """Draw a distribution of q: the share of each bin, and the number of elements above each edge."""
    edges = np.linspace(0, 1, len(counts) + 1)
    bulk.stairs(100 * counts / counts.sum(), edges, **style)
    above = np.cumsum(counts[::-1])[::-1] * 1e6 / counts.sum()
    tail.plot(edges[:-1][above > 0], above[above > 0], **style)


def svg(figure: Figure) -> str:
    """A figure as the text of an SVG file without a date."""
    file = io.StringIO()
    with mpl.rc_context(STYLE):
        figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()


def save(figure: Figure, *paths: str | Path) -> None:
    """Write a figure to each path, in the format of the suffix (pdf, svg, png), without date or version."""
    for path in map(Path, paths):
        kind = path.suffix.removeprefix(".")
        metadata = {"pdf": {"CreationDate": None, "Producer": None, "Creator": None}, "svg": {"Date": None}}
        with mpl.rc_context(STYLE), atomic_path(path) as temporary:
            figure.savefig(temporary, format=kind, metadata=metadata.get(kind, {"Software": None}))


def _panel(axis: Axes, rows: pd.DataFrame, theirs: pd.DataFrame | None, column: str, unit: float) -> None:
    """Draw a column of two tables against age: published meshes, if any, in grey, ours by hemisphere and cell size."""
    if theirs is not None:
        axis.scatter(
            theirs["scan_age_weeks"],
            theirs[column] / unit,
            s=6,
            color=GREY,
            linewidths=0,
            label=f"published (CORTET), {H} = {published.CELL_SIZE:g} mm ($n$ = {len(theirs)})",
        )
    for rank, (size, of_size) in enumerate(rows.groupby("cell_size_mm")):
        for hemi, (colour, marker, side) in HEMISPHERES.items():
            chosen = of_size[of_size["hemi"] == hemi]
            if chosen.empty:
                continue
            axis.scatter(
                chosen["scan_age"],
                chosen[column] / unit,
                s=16 + 10 * rank,
                marker=marker,
                facecolors="none" if rank else colour,  # the finest meshes filled, coarser ones larger and open
                edgecolors=colour,
                linewidths=0.8,
                clip_on=False,  # coarse meshes have few tetrahedra: their marks touch the axis
                label=f"{side}, {H} = {size:g} mm ($n$ = {len(chosen)})",
            )
