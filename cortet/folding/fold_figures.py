"""Pictures of a folding run: its numbers against age, the folding brain beside real ones, and a film."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from scipy.spatial import cKDTree

from cortet.folding.fold_views import (
    COLOURS,
    FOLDS,
    Brain,
    Colours,
    Image,
    Row,
    bar_length,
    centre,
    draw_bar,
    extent,
    real_brain,
    sheet,
    sides,
    simulated_brain,
    view,
)
from cortet.folding.journal import SERIES, TABLE, VERDICT, series
from cortet.folding.measures import MEASURES
from cortet.formats.atomic import atomic_path
from cortet.formats.gifti import hemisphere_of, read_fields, read_surface
from cortet.formats.ownership import delete_abandoned
from cortet.formats.tsv import read_tsv
from cortet.report.colours import BLUE, VERMILION
from cortet.report.figures import PAGE, STYLE, drawn, letter, save
from cortet.report.published import numbers_of
from cortet.report.surface_maps import usual_range

VERSION: int = 6

#: files that `draw` adds to the folder of a run
NUMBERS, PICTURE, FILM = "folding.svg", "folded.png", "folding.gif"

#: candidate weeks between two brains in the picture, best first; most between a frame and the real brain beside it
_EVERY, _ALIKE = (4, 3, 5, 2, 6), 0.5
#: pixels of the film, its margin, and its frames per second
_VIEW, _MARGIN, _RATE = (800, 640), 1.05, 5
#: column that is drawn against age -> label of its panel, row by row; the last of each row is drawn small
_PANELS = {
    "gyrification_index": "gyrification index",
    "area_cm2": "area (cm²)",
    "volume_ml": "volume (mL)",
    "min_j": "smallest $J$",
    "fold_spacing_mm": "width of folds (mm)",
    "sulcal_depth_mm": "depth of sulci (mm)",
    "hull_volume_ml": "hull volume (mL)",
    "distortion_max": "largest distortion",
}
_ROWS, _SMALL = 2, ("min_j", "distortion_max")
#: panel -> column of the error that is due to the cells, and its sign
_ERRORS = {"gyrification_index": ("gyrification_index_error", 1), "fold_spacing_mm": ("fold_spacing_error_mm", -1)}
#: candidate weeks between ticks of the age axis, of which the first with few enough ticks is used; and most ticks
_STEPS, _MOST_TICKS = (1, 2, 4, 5, 10), 6
#: size, shape and folds of real brains; `data/real_brains.json` explains them
_REAL_BRAINS = Path(__file__).with_name("data") / "real_brains.tsv"
#: sources of those whose anatomy is abnormal, and of those who were born
ABNORMAL, BORN = "spina bifida atlas", "dHCP neonatal atlas"
#: source of real brains -> its name in the legend, marker, colour; open markers for abnormal anatomy
_SOURCES = {
    "CRL atlas": ("CRL atlas, fetal", "o", "black"),
    "FetoMorph (individual)": ("FetoMorph, individual fetuses", "^", "black"),
    ABNORMAL: ("spina bifida atlas, fetal", "o", "black"),
    BORN: ("dHCP atlas, newborns", "s", "#8C8C8C"),
}

logger = logging.getLogger(__name__)


def draw(
    folder: Path,
    hemisphere: str | None,
    real: Mapping[float, Path] | None = None,
    maps: Mapping[float, tuple[Path, Path]] | None = None,
    measure: str | None = None,
) -> list[Path]:
    """Draw all pictures of the run in a folder; returns their files.

    Parameters
    ----------
    hemisphere : "L" or "R" is filmed from its lateral side; a whole brain (None) from the left
    real : gestational age, weeks -> surface of a real brain, of the same hemisphere, that is drawn beside the frame of
        that age
    maps, measure : as in `mapped`, instead of folds and real brains in the picture
    """
    delete_abandoned(folder, NUMBERS, PICTURE, FILM)
    save(numbers(folder / TABLE, hemisphere), folder / NUMBERS)
    frames = series(folder / SERIES)
    if maps and measure:
        rows, colours = mapped(frames, maps, measure)
    else:
        rows, colours = rows_of(frames, hemisphere, real or {}), FOLDS
    verdict = folder / VERDICT
    doubts = json.loads(verdict.read_text(encoding="utf-8"))["warnings"] if verdict.exists() else []
    save(sheet(rows, hemisphere, colours, doubts), folder / PICTURE)
    film(frames, hemisphere, folder / FILM)
    return [folder / name for name in (NUMBERS, PICTURE, FILM)]


def numbers(table: Path, hemisphere: str | None) -> Figure:
    """Size and folds against gestational age, over real brains, smallest J and largest distortion.

    Real surfaces are those of one hemisphere if the run is of one, else of both.
    """
    rows = curves(table)
    with drawn(PAGE, 3.9) as figure:
        columns = len(_PANELS) // _ROWS
        axes = figure.subplots(_ROWS, columns, width_ratios=[1.0] * (columns - 1) + [0.62]).ravel()
        for axis, (column, label) in zip(axes, _PANELS.items(), strict=True):
            axis.plot(rows["gestational_age"], rows[column], color=BLUE, label="this run")
            if column in _ERRORS and rows[_ERRORS[column][0]].notna().any():
                error, sign = _ERRORS[column]
                axis.plot(
                    rows["gestational_age"], rows[column] + sign * rows[error], ":", color=BLUE,
                    label="with far smaller cells, estimated",
                )  # fmt: skip
            axis.set(xlabel="gestational\nage (weeks)" if column in _SMALL else "gestational age (weeks)", ylabel=label)
            if column == "min_j":
                axis.axhline(0, color=VERMILION, linestyle="--", linewidth=0.8)
                axis.annotate(
                    "inversion", (0.05, 0), xycoords=axis.get_yaxis_transform(), xytext=(0, 2),
                    textcoords="offset points", fontsize=6, color=VERMILION,
                )  # fmt: skip
            weeks(axis, float(rows["gestational_age"].min()), float(rows["gestational_age"].max()))
            if column not in _SMALL:
                real_points(axis, column, hemisphere, axis.get_xlim())
                _fit(axis)
        letter(axes)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 4))
    return figure


def weeks(axis: Axes, first: float, last: float) -> None:
    """Set whole weeks as the limits of an age axis: major ticks every 1, 2, 4, 5 or 10 weeks, minor ticks each week."""
    low, high = np.floor(first + 1e-6), np.ceil(last - 1e-6)
    step = next((step for step in _STEPS if high - low <= _MOST_TICKS * step), _STEPS[-1])
    axis.set_xlim(low - 0.02 * (high - low), high + 0.02 * (high - low))
    axis.set_xticks(np.arange(low, high + 0.5, step))
    axis.xaxis.set_minor_locator(MultipleLocator(1))


def _fit(axis: Axes) -> None:
    """Fit the value axis to what is drawn within the limits of the age axis."""
    low, high = axis.get_xlim()
    drawn = [np.asarray(line.get_xydata(), float) for line in axis.lines]
    drawn += [np.asarray(points.get_offsets(), float) for points in axis.collections]
    x, y = np.concatenate(drawn).T
    seen = y[(x >= low) & (x <= high) & np.isfinite(y)]
    if len(seen):
        room = 0.05 * float(np.ptp(seen)) or 0.05 * abs(float(seen[0])) or 1.0
        axis.set_ylim(seen.min() - room, seen.max() + room)


def curves(table: Path) -> pd.DataFrame:
    """The table of a run as numbers, with the names of `real_brains`, and `relative_area`."""
    rows = as_real_brains(read_tsv(table).apply(pd.to_numeric, errors="coerce"))
    return rows.assign(relative_area=rows["area_mm2"] / rows["volume_mm3"] ** (2 / 3))


def real_brains() -> pd.DataFrame:
    """Size, shape and folds of real surfaces, 22 to 42 weeks, one row each."""
    return numbers_of(_REAL_BRAINS)


def healthy_hemispheres() -> pd.DataFrame:
    """The rows of `real_brains` that are the inner surface of one healthy hemisphere."""
    brains = real_brains()
    return brains[(brains["surface_type"] == "white") & (brains["hemi"] != "both") & (brains["source"] != ABNORMAL)]


def healthy_fetuses() -> pd.DataFrame:
    """Those of `healthy_hemispheres` that were not born yet, 22 to 34 weeks."""
    brains = healthy_hemispheres()
    return brains[brains["source"] != BORN]


def as_real_brains(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of a fold's table, or of `measurements.shape`, with areas and volumes under the names of `real_brains`."""
    return rows.assign(
        area_cm2=rows["area_mm2"] / 100,
        volume_ml=rows["volume_mm3"] / 1000,
        hull_volume_ml=rows["hull_volume_mm3"] / 1000,
    )


def real_points(axis: Axes, column: str, hemisphere: str | None, ages: tuple[float, float] = (0.0, np.inf)) -> None:
    """Draw inner surfaces of real brains, source by source: newborns in grey, since their index jumps at birth."""
    brains = real_brains()
    brains = brains[brains["gestational_age_weeks"].between(*ages)]
    brains["relative_area"] = brains["area_cm2"] / brains["volume_ml"] ** (2 / 3)
    brains = brains[(brains["surface_type"] == "white") & ((brains["hemi"] == "both") == (hemisphere is None))]
    for source, (label, marker, colour) in _SOURCES.items():
        points = brains[brains["source"] == source]
        if len(points):
            axis.scatter(
                points["gestational_age_weeks"],
                points[column],
                s=9,
                marker=marker,
                facecolors="none" if source == ABNORMAL else colour,
                edgecolors=colour,
                linewidths=0.6,
                label=label,
                zorder=3,
            )


def rows_of(frames: list[tuple[Path, float]], hemisphere: str | None, real: Mapping[float, Path]) -> list[Row]:
    """Brains in even steps from the first to the last, and those with a real brain of their age.

    Parameters
    ----------
    frames : files and gestational ages
    real : gestational age -> surface
    """
    beside = _beside([age for _, age in frames], hemisphere, real)
    rows = []
    for number in sorted({*_every([age for _, age in frames]), *beside}):
        path, age = frames[number]
        row = Row(age, simulated_brain(path))
        if number in beside:
            real_age = beside[number]
            name = f"{_name(real[real_age])}, {real_age:g} weeks"
            row = row._replace(real=real_brain(real[real_age], hemisphere), name=name)
        rows.append(row)
    return rows


def mapped(
    frames: list[tuple[Path, float]], maps: Mapping[float, tuple[Path, Path]], measure: str
) -> tuple[list[Row], Colours]:
    """The brains of some weeks with one of `MEASURES`, and colours of one range for all: 0 is white between two signs.

    Parameters
    ----------
    frames : files and gestational ages
    maps : week -> folded surface, and its map
    """
    rows = []
    for week, (surface, values) in maps.items():
        frame = min(frames, key=lambda one: abs(one[1] - week))[0]
        folded, boundary = read_surface(surface), simulated_brain(frame)
        nearest = cKDTree(boundary.surface.points).query(folded.points)[1]
        wall = np.isnan(boundary.curvature[nearest])
        rows.append(Row(week, Brain(folded, np.where(wall, np.nan, next(iter(read_fields(values).values()))))))
    low, high = usual_range(np.concatenate([row.simulated.curvature for row in rows]))
    span, name = ((low, high), "viridis")
    if low < 0 < high:
        span, name = (-max(-low, high), max(-low, high)), COLOURS
    unit = MEASURES[measure][1]
    label = measure.replace("_", " ") + (f" ({unit})" if unit else "")
    return rows, Colours(label, span, name, "medial wall, or no value")


def _every(ages: list[float]) -> list[int]:
    """Numbers of the frames in even steps of about four weeks, whole ones if they fit, from the first to the last."""
    span = ages[-1] - ages[0]
    whole = next((step for step in _EVERY if span > step and np.isclose(span % step, 0)), None)
    steps = round(span / whole) if whole else max(round(span / _EVERY[0]), 1)
    wanted = np.linspace(ages[0], ages[-1], steps + 1)
    return sorted({int(np.abs(np.array(ages) - age).argmin()) for age in wanted})


def _beside(ages: list[float], hemisphere: str | None, real: Mapping[float, Path]) -> dict[int, float]:
    """Index of a frame -> age of the real brain beside it; logs which real brains are left out."""
    found: dict[int, float] = {}
    for age, path in sorted(real.items()):
        number = int(np.abs(np.array(ages) - age).argmin())
        named = hemisphere_of(path)
        if abs(ages[number] - age) > _ALIKE:
            logger.warning("%s is not drawn: the run has no frame of %g weeks", path, age)
        elif named not in (None, hemisphere):
            logger.warning("%s is not drawn: its metadata say hemisphere %s", path, named)
        elif number in found and abs(ages[number] - found[number]) <= abs(ages[number] - age):
            logger.warning("%s is not drawn: another surface is nearer to the same frame", path)
        else:
            found[number] = age
    return found


def _name(path: Path) -> str:
    """The name of a file without its suffixes."""
    return path.name.removesuffix(path.suffix).removesuffix(".surf")


def views(frames: list[Path], hemisphere: str | None) -> Iterator[Image]:
    """The brain of each frame from its lateral side (a whole one: left), at the scale and position of the last."""
    last = simulated_brain(frames[-1])
    for path in frames:
        yield view(simulated_brain(path), sides(hemisphere)[0], centre(last), _VIEW, _pixels_per_mm(last, hemisphere))


def _pixels_per_mm(last: Brain, hemisphere: str | None) -> float:
    """The scale at which the last brain fills a view."""
    return float((np.array(_VIEW) / extent(last, sides(hemisphere)[0])).min()) / _MARGIN


def film(frames: list[tuple[Path, float]], hemisphere: str | None, path: Path) -> None:
    """Write an animated GIF of the `views` of some frames, with their ages; the last image stays for a second."""
    files, ages = zip(*frames, strict=True)
    per_mm = _pixels_per_mm(simulated_brain(files[-1]), hemisphere)
    with mpl.rc_context({**STYLE, "font.size": 12}), atomic_path(path) as temporary:
        figure = Figure(figsize=(_VIEW[0] / 100, _VIEW[1] / 100), dpi=100)
        axis = figure.add_axes((0, 0, 1, 1))
        writer = PillowWriter(fps=_RATE)
        with writer.saving(figure, temporary, dpi=100):
            for image, age in zip(views(list(files), hemisphere), ages, strict=True):
                axis.clear()
                axis.set_axis_off()
                axis.imshow(image)
                axis.text(0.02, 0.95, f"{age:.1f} weeks", transform=axis.transAxes)
                draw_bar(axis, (20, _VIEW[1] - 20), per_mm, bar_length(_VIEW[0] / per_mm, times=10))
                writer.grab_frame()
            for _ in range(_RATE - 1):
                writer.grab_frame()
