"""Folding against the cell size: a table, a figure, and a sentence that says which cell size is small enough.

Every run is a realisation of a mesh: a direction in which it is made. Differences between realisations of one cell size
are chance; other differences between cell sizes are due to the cell size. If the mean over the realisations
tends evenly to a limit, by more than chance, this limit is extrapolated (Richardson 1911; Roache, J. Fluids Eng. 116,
1994). Its error is a quarter more than the remaining distance to it, as Roache advises.

Locations of folds are compared on the surface from which all meshes were made. Each of its vertices gains depth below
the convex hull; these depths are correlated between two runs, weighted by area.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from outputs import write_outputs

from cortet.folding.journal import TABLE
from cortet.folding.measurements import depth_below_hull
from cortet.formats.gifti import read_surface
from cortet.formats.tables import Column, Row, names
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import face_areas
from cortet.meshers import MESHERS
from cortet.meshes import FloatArray
from cortet.report.colours import BLUE, GREEN, VERMILION
from cortet.report.figures import PAGE, H, drawn, letter
from cortet.report.table_files import Table, mean_and_sd

#: relative difference from the limit up to which a number counts as converged
TOLERANCE = 0.05
#: plausible orders of convergence; others come from chance or from cells that are far too large
ORDERS = (0.5, 4.0)
#: numbers of a run that are compared -> its column in the table of the fold, heading, unit
QUANTITIES = {
    "gyrification_index": ("gyrification index", ""),
    "area_mm2": ("area", "mm²"),
    "fold_spacing_mm": ("width of folds", "mm"),
    "fold_wavelength_mm": ("wavelength of folds", "mm"),
    "sulcal_depth_mm": ("depth of sulci", "mm"),
}
#: pairs of runs whose locations of folds are compared -> what differs
PAIRS = {
    "realisations": "the same mesher and cell size, another direction",
    "meshers": "the same cell size, another mesher",
    "sizes": "the same mesher, this cell size and the smallest",
}


def _with_error(column: str, digits: int) -> Callable[[Row], str]:
    return lambda row: mean_and_sd(row[column], row[f"{column}_error"], digits, n=row["runs"] and int(row["runs"]))


CONVERGENCE = Table(
    "Folding against the cell size",
    (
        Column("case", "Name of the case", heading="Case"),
        Column("mesher", "Mesher", heading="Mesher", form=lambda row: MESHERS[row["mesher"]].printed),
        Column("cell_size_mm", "Cell size h; 0: the limit that the sizes tend to", "mm", heading="h (mm)", form="g"),
        Column(
            "h_over_thickness",
            "Cell size over the thickness of the cortex at the start",
            heading="h / thickness",
            form=".2f",
        ),
        Column("runs", "Realisations that folded to the end", heading="runs", form=".0f"),
        Column("stopped", "Realisations that stopped at an inverted element"),
        Column("tets", "Mean number of tetrahedra"),
        *(
            Column(
                column,
                f"Mean of the {name} at the end over the realisations, in print ± its error, of two [least-most]",
                unit.replace("²", "2"),
                heading=name + (f" ({unit})" if unit else ""),
                form=_with_error(column, {"": 3, "mm": 2}.get(unit, 0)),
            )
            for column, (name, unit) in QUANTITIES.items()
        ),
        *(
            Column(
                f"{column}_error",
                f"Error of the {name}: standard deviation over the realisations; of a limit, that of the extrapolation",
            )
            for column, (name, _) in QUANTITIES.items()
        ),
        *(
            Column(
                f"correlation_{pair}",
                f"Mean correlation of gained depth between two runs: {what}",
                heading=f"r, {pair}",
                form=".2f",
            )
            for pair, what in PAIRS.items()
        ),
    ),
    first=(),
    group=("case", "mesher"),
)


@dataclass(frozen=True)
class Run:
    """One fold."""

    case: str
    mesher: str
    seed: int
    cell_size_mm: float
    thickness_mm: float
    tets: int
    folded: bool
    #: by `QUANTITIES`, at the end
    values: dict[str, float]
    #: (n,) depth below the hull that each vertex of the surface has gained, mm, and area around it at the start
    gained: FloatArray
    weight: FloatArray


def read_run(folder: Path) -> Run:
    """The numbers of a run that are compared, from its folder."""
    record = json.loads((folder / "record.json").read_text(encoding="utf-8"))
    last = read_tsv(folder / TABLE).apply(pd.to_numeric, errors="coerce").iloc[-1]
    start, folded = read_surface(folder / "start.surf.gii"), read_surface(folder / "folded.surf.gii")
    areas: FloatArray = np.repeat(face_areas(start.points, start.faces) / 3, 3)
    return Run(
        **record["origin"],
        thickness_mm=record["thickness_mm"],
        tets=record["tets"],
        folded=record["outcome"] == "folded",
        values={column: float(last[column]) for column in QUANTITIES},
        gained=depth_below_hull(folded.points) - depth_below_hull(start.points),
        weight=np.bincount(start.faces.ravel(), areas, minlength=len(start.points)).astype(float),
    )


def convergence_table(runs: Sequence[Run]) -> pd.DataFrame:
    """A row per case, mesher and cell size, the largest first, and a row for the limit if there is one."""
    rows = []
    for case, mesher in dict.fromkeys((run.case, run.mesher) for run in runs):
        own = [run for run in runs if (run.case, run.mesher) == (case, mesher)]
        sizes = sorted({run.cell_size_mm for run in own}, reverse=True)
        groups = [_row([run for run in own if run.cell_size_mm == size], runs, sizes[-1]) for size in sizes]
        limits: dict[str, Any] = {}
        for column in QUANTITIES:
            found = limit(sizes, [row[column] for row in groups], _chance([row[f"{column}_error"] for row in groups]))
            if found:
                limits |= {column: found.value, f"{column}_error": found.error}
        rows += groups
        if limits:
            rows.append({"case": case, "mesher": mesher, "cell_size_mm": 0.0, "h_over_thickness": 0.0, **limits})
    return pd.DataFrame(rows, columns=names(CONVERGENCE.columns))


def _row(group: Sequence[Run], runs: Sequence[Run], smallest: float) -> dict[str, Any]:
    """Numbers of the realisations of one mesher and cell size."""
    first, folded = group[0], [run for run in group if run.folded]
    values = {column: np.array([run.values[column] for run in folded]) for column in QUANTITIES}
    pairs: dict[str, Iterable[tuple[Run, Run]]] = {
        "realisations": itertools.combinations(folded, 2),
        "meshers": _others(folded, runs, lambda a, b: a.mesher != b.mesher and a.cell_size_mm == b.cell_size_mm),
        "sizes": _others(folded, runs, lambda a, b: a.mesher == b.mesher and b.cell_size_mm == smallest)
        if first.cell_size_mm > smallest
        else (),
    }
    return {
        "case": first.case,
        "mesher": first.mesher,
        "cell_size_mm": first.cell_size_mm,
        "h_over_thickness": first.cell_size_mm / first.thickness_mm,
        "runs": len(folded),
        "stopped": len(group) - len(folded),
        "tets": float(np.mean([run.tets for run in group])),
        **{column: _mean(found) for column, found in values.items()},
        **{f"{column}_error": float(found.std(ddof=1)) if len(found) > 1 else None for column, found in values.items()},
        **{f"correlation_{pair}": _mean([correlation(a, b) for a, b in found]) for pair, found in pairs.items()},
    }


def _others(group: Sequence[Run], runs: Sequence[Run], compared: Any) -> Iterator[tuple[Run, Run]]:
    """Pairs of a run of the group and another run of its case that folded."""
    for a, b in itertools.product(group, runs):
        if b.folded and a is not b and a.case == b.case and compared(a, b):
            yield a, b


def _mean(values: Sequence[float] | FloatArray) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _chance(deviations: Sequence[float | None]) -> float:
    """Standard deviation over the realisations, pooled over the cell sizes; 0 if each has only one realisation."""
    known = [deviation**2 for deviation in deviations if deviation is not None]
    return float(np.sqrt(np.mean(known))) if known else 0.0


def correlation(a: Run, b: Run) -> float:
    """Correlation over the surface of the depth gained in two runs, weighted by area."""
    covariance = np.cov(a.gained, b.gained, aweights=a.weight)
    return float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))


@dataclass(frozen=True)
class Limit:
    """The value to which a number tends for h = 0."""

    value: float
    error: float
    order: float


def limit(sizes: Sequence[float], values: Sequence[float | None], chance: float) -> Limit | None:
    """The limit of values at falling cell sizes, from the last three; None if they do not tend evenly to a limit.

    Parameters
    ----------
    chance : standard deviation of a value over the realisations; a step that is not larger says nothing
    """
    if len(sizes) < 3 or any(value is None for value in values[-3:]):
        return None
    (h1, h2, h3), (f1, f2, f3) = sizes[-3:], [float(value or 0) for value in values[-3:]]
    first, last = f2 - f1, f3 - f2
    if first * last <= 0 or abs(last) <= chance:
        return None
    # f = limit + c h^p: the ratio of both steps rises with p
    orders = np.linspace(*ORDERS, 3501)
    ratios = (h1**orders - h2**orders) / (h2**orders - h3**orders)
    if not ratios[0] <= first / last <= ratios[-1]:
        return None
    order = float(np.interp(first / last, ratios, orders))
    left = last * h3**order / (h2**order - h3**order)
    return Limit(f3 + left, 1.25 * abs(left), order)


def large_enough(sizes: Sequence[float], values: Sequence[float | None], at_limit: float | None) -> float | None:
    """The largest cell size from which on a number is within `TOLERANCE` of its limit, or of its value at the smallest.

    Without a limit, the smallest size itself only counts together with the size before it.
    """
    if any(value is None for value in values):
        return None
    known = np.array([float(value or 0) for value in values])
    end = known[-1] if at_limit is None else at_limit
    near = np.abs(known - end) <= TOLERANCE * abs(end)
    if at_limit is None:
        near[-1] = len(near) > 1 and bool(near[-2])
    far = np.flatnonzero(~near)
    first = far[-1] + 1 if len(far) else 0
    return float(sizes[first]) if first < len(sizes) else None


def sentence(table: pd.DataFrame) -> str:
    """Which cell size is small enough, and how locations of folds agree, from the rows of `convergence_table`."""
    found: list[tuple[str, float | None]] = []
    without_limit = list[str]()
    for _, rows in table.groupby(["case", "mesher"], sort=False):
        measured, limits = rows[rows["cell_size_mm"] > 0], rows[rows["cell_size_mm"] == 0]
        for column, (name, _) in QUANTITIES.items():
            end = None if limits.empty or pd.isna(limits[column].iloc[0]) else float(limits[column].iloc[0])
            values = [None if pd.isna(value) else float(value) for value in measured[column]]
            found.append((name, large_enough(list(measured["h_over_thickness"]), values, end)))
            without_limit += [name] if end is None else []
    failed = [name for name, size in found if size is None]
    sizes = [size for _, size in found if size is not None]
    measured = table[table["cell_size_mm"] > 0]
    if failed:
        first = (
            f"No size tried is small enough for every number: with the smallest cells, "
            f"{measured['h_over_thickness'].min():.2f} of the thickness, {_listed(failed)} "
            f"may still be more than {TOLERANCE:.0%} off."
        )
    else:
        first = f"Use h <= {min(sizes):.2f} of the thickness: every number is then within {TOLERANCE:.0%} of its limit"
        if without_limit:
            first += f", or, as no limit was found for {_listed(without_limit)}, of its value with the smallest cells"
        first += "."
    finest = measured[measured["cell_size_mm"] == measured["cell_size_mm"].min()]
    places = [
        f"{finest[column].mean():.2f} {words}"
        for column, words in (
            ("correlation_realisations", "between realisations of one mesher"),
            ("correlation_meshers", "between meshers"),
        )
        if finest[column].notna().any()
    ]
    if stopped := int(measured["stopped"].sum()):
        all_folds = stopped + int(measured["runs"].sum())
        first += f" This leaves out {stopped} of {all_folds} folds, which stopped at an inverted element."
    return first + (f" Locations of folds at the smallest size correlate by {' and '.join(places)}." if places else "")


def _listed(names: Iterable[str]) -> str:
    """Names in words, each once: a, b and c."""
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last


_MARKERS = {"lattice": (BLUE, "o"), "cgal": (VERMILION, "^")}
#: pair of runs -> line of their correlations, and what it is in the legend
_PAIR_LINES = {
    "realisations": ("-", "with another direction"),
    "meshers": (":", "with another mesher"),
    "sizes": ("--", "with the smallest $h$"),
}
#: entries of a row of the legend
_COLUMNS = 4
_X_AXIS = f"{H} / thickness"


def convergence_figure(runs: Sequence[Run], table: pd.DataFrame) -> Figure:
    """Every number of every run against h over thickness, with limits at 0, and correlations of fold locations."""
    shown = [*(name for name in QUANTITIES if name != "area_mm2")]
    meshers = list(dict.fromkeys(run.mesher for run in runs))
    with drawn(PAGE, 2.5) as figure:
        *axes, places = figure.subplots(1, len(shown) + 1)
        largest = max(run.cell_size_mm / run.thickness_mm for run in runs)
        for axis, column in zip(axes, shown, strict=True):
            name, unit = QUANTITIES[column]
            axis.set(xlabel=_X_AXIS, ylabel=name + (f" ({unit})" if unit else ""))
            for number, mesher in enumerate(meshers):
                own = [run for run in runs if run.mesher == mesher]
                _draw_number(axis, own, table, column, zero=0.03 * largest * (number - (len(meshers) - 1) / 2))
        _draw_places(places, table)
        for axis in (*axes, places):
            axis.set_xlim(-0.08 * largest, 1.05 * largest)
        letter([*axes, places])
        handles = [
            *map(_handle, meshers),
            *_meanings(limits=bool((table["cell_size_mm"] == 0).any())),
            *_pairs(table, panel=ascii_lowercase[len(axes)]),
        ]
        cases = ", ".join(dict.fromkeys(run.case for run in runs))
        legend = figure.legend(
            handles=handles, loc="outside upper center", ncols=min(len(handles), _COLUMNS), title=cases
        )
        legend.get_title().set_fontsize(7)
    return figure


def _handle(mesher: str) -> Line2D:
    colour, marker = _MARKERS.get(mesher, (GREEN, "s"))
    return Line2D([], [], color=colour, marker=marker, fillstyle="none", label=f"{MESHERS[mesher].printed} mesher")


def _meanings(*, limits: bool) -> list[Line2D]:
    """What marks and lines mean, for the legend."""
    one = Line2D([], [], color="black", marker="o", fillstyle="none", linestyle="none", label="one realisation")
    mean = Line2D([], [], color="black", label="mean")
    end = Line2D([], [], color="black", marker="o", linestyle="none", label=f"limit for {H} = 0, with its error")
    return [one, mean, *([end] if limits else [])]


def _pairs(table: pd.DataFrame, panel: str) -> list[Line2D]:
    """What lines of the panel of correlations mean, for the legend."""
    return [
        Line2D([], [], linestyle=style, color="black", label=f"{panel}: {words}")
        for pair, (style, words) in _PAIR_LINES.items()
        if table[f"correlation_{pair}"].notna().any()
    ]


def _draw_number(axis: Axes, runs: Sequence[Run], table: pd.DataFrame, column: str, *, zero: float) -> None:
    """Draw a number of the runs of one mesher; its limit for h = 0 stands at `zero`, beside those of other meshers."""
    colour, marker = _MARKERS.get(runs[0].mesher, (GREEN, "s"))
    x = [run.cell_size_mm / run.thickness_mm for run in runs]
    axis.plot(x, [run.values[column] for run in runs], marker, color=colour, fillstyle="none")
    rows = table[(table["mesher"] == runs[0].mesher)]
    for _, own in rows.groupby("case", sort=False):
        measured, end = own[own["cell_size_mm"] > 0], own[own["cell_size_mm"] == 0]
        axis.plot(measured["h_over_thickness"], measured[column], color=colour)
        if len(end) and not pd.isna(end[column].iloc[0]):
            axis.errorbar([zero], end[column], end[f"{column}_error"], fmt=marker, color=colour, capsize=2)


def _draw_places(axis: Axes, table: pd.DataFrame) -> None:
    """Correlations of gained depth against h over thickness, one line per kind of pair and mesher."""
    measured = table[table["cell_size_mm"] > 0]
    for (_, mesher), rows in measured.groupby(["case", "mesher"], sort=False):
        colour, marker = _MARKERS.get(mesher, (GREEN, "s"))
        for pair, (style, _) in _PAIR_LINES.items():
            axis.plot(
                rows["h_over_thickness"],
                rows[f"correlation_{pair}"],
                style,
                color=colour,
                marker=marker,
                ms=2,
                clip_on=False,
            )
    axis.set(xlabel=_X_AXIS, ylabel="$r$ of gained depth", ylim=(None, 1))


def write_convergence(folders: Sequence[Path], outputs: Sequence[str | Path]) -> None:
    """Write table, figure and sentence of the runs in some folders."""
    runs = [read_run(folder) for folder in folders]
    table = convergence_table(runs)
    write_outputs(outputs, CONVERGENCE, table, convergence_figure(runs, table), sentence(table) + "\n")
