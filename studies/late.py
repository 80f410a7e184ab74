"""Folds by week against real fetuses: size, index and width, bands of curvature, and sulcal basins.

Real surfaces are of fetuses or of newborns, and a fold is compared with fetuses only: at birth the gyrification index
jumps by half of what a fetus gains in all (Communications Biology 2025, s42003-025-08155-z). Between the ages of real
surfaces, values are interpolated; beyond them there is no truth.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from late_cells import CARRIED, differences, differences_in_words
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from outputs import write_outputs
from spectrum import BANDS, band_powers, basins

from cortet.folding.fold_figures import as_real_brains, weeks
from cortet.folding.fold_views import Brain
from cortet.folding.measurements import depth_below_hull, shape
from cortet.folding.surface_growth import smoothed
from cortet.formats.tables import Column, names
from cortet.meshes import FloatArray, TriSurface
from cortet.report.colours import BLUE, GREY, VERMILION
from cortet.report.figures import PAGE, drawn, letter
from cortet.report.table_files import Table

FETUS, NEWBORN = "fetus", "newborn"
#: colour, marker and name in the legend of real brains
_REAL = {FETUS: ("black", "o", "fetuses"), NEWBORN: (GREY, "s", "newborns")}
#: column -> heading, unit, digits
QUANTITIES = {
    "gyrification_index": ("gyrification index", "", 3),
    "area_cm2": ("area", "cm²", 0),
    "volume_ml": ("volume", "mL", 0),
    "fold_spacing_mm": ("width of folds", "mm", 1),
    "sulcal_depth_mm": ("depth of sulci", "mm", 2),
    "basins": ("sulcal basins", "", 0),
    "basin_depth_mm": ("depth of basins", "mm", 2),
    **{f"band_{band}": (f"power of band {band}", "", 0) for band in range(4, BANDS + 1)},
}
LATE = Table(
    "Folds by week, and real brains",
    (
        Column("brain", "Name of the surface", heading="Brain"),
        Column("kind", f"{FETUS}, {NEWBORN}, or the changes with which the brain was folded", heading="Kind"),
        Column("cell_size_mm", "Cell size h", "mm", heading="h (mm)", form="g"),
        Column("tets", "Number of tetrahedra", heading="tetrahedra", form=",.0f"),
        Column("cpu_s", "CPU time of the fold", "s", heading="CPU (s)", form=".0f"),
        Column("week", "Gestational age", "weeks", heading="week", form="g"),
        *(
            Column(name, words, unit.replace("²", "2"), heading=words + (f" ({unit})" if unit else ""), form=f".{n}f")
            for name, (words, unit, n) in QUANTITIES.items()
        ),
    ),
    first=(),
    group=("brain", "kind", "cell_size_mm"),
)


def measured(brain: Brain) -> dict[str, Any]:
    """The `QUANTITIES` of a surface; its medial wall, where curvature is NaN, has no folds."""
    surface, wall = brain.surface, np.isnan(brain.curvature)
    found = as_real_brains(pd.DataFrame([shape(surface.points, surface.faces, wall, float("nan"))])).iloc[0]
    powers, _ = band_powers(surface, np.where(wall, 0.0, brain.curvature))
    bottoms = basins(np.where(wall, 0.0, depth_below_hull(surface.points)), surface.faces)
    folds = {
        "basins": len(bottoms),
        "basin_depth_mm": float(bottoms.mean()) if len(bottoms) else None,
        **{f"band_{band}": float(power) for band, power in enumerate(powers, 1)},
    }
    return {name: folds[name] if name in folds else found[name] for name in QUANTITIES}


def undulation(surface: TriSurface, mean_mm: float, sd_mm: float, length_mm: float, seed: int) -> FloatArray:
    """Thickness that varies by place: a smooth random field on a surface, mm (n,), at least a third of its mean.

    Parameters
    ----------
    length_mm : full width at half maximum of the smoothing of the noise
    """
    noise = np.random.default_rng(seed).normal(size=(len(surface.points), 1))
    alike = noise * [1, 1, 1, 0, 0, 0]  # in all directions
    field = smoothed(alike, surface, length_mm).tensors[:, :3].sum(axis=1)
    return np.maximum(mean_mm + sd_mm * (field - field.mean()) / field.std(), mean_mm / 3)


def truth(table: pd.DataFrame, ages: Sequence[float]) -> pd.DataFrame:
    """Means of the fetuses of a table at some ages, a line between ages, NaN beyond them."""
    known = table[table["kind"] == FETUS].groupby("week")[[*QUANTITIES]].mean().astype(float)
    between = known.reindex(known.index.union(ages)).interpolate("index", limit_area="inside")
    return between.loc[[*ages]]


def late_figure(table: pd.DataFrame) -> Figure:
    """Each quantity by week: real fetuses and newborns as points, unchanged folds as lines, by cell size."""
    shown = [name for name in QUANTITIES if name != "volume_ml"]
    folds = table[~table["kind"].isin([FETUS, NEWBORN])]
    usual = folds[folds["kind"] == folds["kind"].iloc[0]] if len(folds) else folds
    sizes = sorted(usual["cell_size_mm"].unique())
    looks = {size: (colour, style) for size, colour, style in zip(sizes, (BLUE, VERMILION), ("-", "--"), strict=False)}
    real = [(kind, *look) for kind, look in _REAL.items() if (table["kind"] == kind).any()]
    with drawn(PAGE, 4.6) as figure:
        axes = figure.subplots(3, 3).ravel()
        for axis, name in zip(axes, shown, strict=True):
            words, unit, _ = QUANTITIES[name]
            for kind, colour, marker, _ in real:
                brains = table[table["kind"] == kind]
                axis.scatter(brains["week"], brains[name], s=9, color=colour, marker=marker, zorder=3)
            for (_, size), rows in usual.groupby(["brain", "cell_size_mm"], sort=False):
                if size in looks:
                    colour, style = looks[size]
                    axis.plot(rows["week"], rows[name], style, color=colour)
            axis.set(xlabel="gestational age (weeks)", ylabel=words + (f" ({unit})" if unit else ""))
            weeks(axis, table["week"].min(), table["week"].max())
        letter(axes)
        handles = [
            *(Line2D([], [], color=colour, marker=marker, linestyle="", markersize=3) for _, colour, marker, _ in real),
            *(Line2D([], [], color=colour, linestyle=style) for colour, style in looks.values()),
        ]
        labels = [*(label for *_, label in real), *(f"folded, h = {size:g} mm" for size in looks)]
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels))
    return figure


def comparison(table: pd.DataFrame) -> str:
    """Differences of folds from fetuses, means over the brains, as a table in Markdown for each week."""
    folds = table[~table["kind"].isin([FETUS, NEWBORN])]
    ages = sorted(folds["week"].unique())
    real, blocks = truth(table, ages), []
    for age in ages:
        rows = []
        for (kind, size), some in folds[folds["week"] == age].groupby(["kind", "cell_size_mm"], sort=False):
            cells = [_difference(name, some[name].astype(float), float(real.loc[age, name])) for name in QUANTITIES]
            rows.append([kind, f"{size:g}", str(len(some)), *cells])
        rows.append(
            ["real fetuses", "", "", *(_number(real.loc[age, name], QUANTITIES[name][2]) for name in QUANTITIES)]
        )
        head = [f"{age:g} weeks", "h (mm)", "brains", *(words for words, _, _ in QUANTITIES.values())]
        blocks.append("\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rows]))
    return "\n\n".join(blocks) + "\n"


def _number(value: float, digits: int) -> str:
    return "n/a" if np.isnan(value) else f"{value:.{digits}f}"


def _difference(name: str, values: pd.Series, real: float) -> str:
    """The mean, and in brackets its difference from real brains: in % except for the index."""
    mean, digits = values.mean(), QUANTITIES[name][2]
    away = f"{mean - real:+.3f}" if name == "gyrification_index" else f"{100 * (mean / real - 1):+.0f} %"
    return f"{mean:.{digits}f} ({'n/a' if np.isnan(real) else away})"


def late_table(records: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """A row per brain, kind, cell size and week."""
    rows = [{**record["of"], **row} for record in records for row in record["rows"]]
    return pd.DataFrame(rows, columns=names(LATE.columns))


def write_late(records: Sequence[Path], outputs: Sequence[str | Path]) -> None:
    """Write table, figure and comparison of the records of some brains."""
    table = late_table(json.loads(path.read_text(encoding="utf-8")) for path in records)
    folds = [path for path in records if (path.parent / CARRIED).exists()]
    words = "\n".join([comparison(table), differences_in_words(differences(folds))])
    write_outputs(outputs, LATE, table, late_figure(table), words)
