"""Scores of predictions of later brains against real surfaces, with their table, figures and pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from outputs import write_outputs
from prediction import Prediction
from series import Series, aligned

from cortet.folding.fold_figures import weeks
from cortet.folding.fold_views import Brain, Row, brain_of, centre, extent, sheet, sides, view
from cortet.folding.measurements import depth_below_hull, shape, smoothed_curvature
from cortet.formats.gifti import read_surface, write_fields, write_surface
from cortet.formats.tables import Column, names
from cortet.meshes import FloatArray, TriSurface
from cortet.report.colours import BLUE, GREEN, VERMILION
from cortet.report.figures import PAGE, drawn, letter
from cortet.report.table_files import Table
from cortet.solver_files.names import growth_field

#: prefix of the names of predicted surfaces
_PREDICTED = "predicted_"
#: colours of depth errors span minus to plus this
_DEPTH_ERROR_MM = 5.0
#: pixels across a view, and its width over that of the widest brain
_PIXELS, _ROOM = 900, 1.05


def _column(name: str, meaning: str, unit: str, heading: str, form: str) -> Column:
    return Column(name, meaning, unit, heading=heading, form=form)


PREDICTION = Table(
    "Predicted and real later brains",
    (
        Column("series", "Name of the first case of the series", heading="Series"),
        Column("kind", "What is imposed", heading="Prediction"),
        Column("lobe", "Lobe of which the scores are; none: the whole cortex", heading="Lobe"),
        _column("gestational_age", "Age that is predicted", "weeks", "age (weeks)", "g"),
        _column(
            "gained_depth",
            "Correlation of the depth below the hull that vertices have gained since the first age, weighted by area",
            "",
            "r, gained depth",
            ".3f",
        ),
        _column("depth", "Correlation of the depth below the hull", "", "r, depth", ".3f"),
        _column("curvature", "Correlation of the mean curvature, smoothed over 1.5 mm", "", "r, curvature", ".3f"),
        _column("distance_mm", "Mean distance of corresponding vertices", "mm", "distance (mm)", ".2f"),
        _column("distance_95_mm", "Distance below which 95 % of them are", "mm", "95 % (mm)", ".2f"),
        *(
            Column(
                f"{which}{column}",
                f"{words} of the {whose} surface",
                unit,
                heading=f"{words}, {whose} ({unit})" if unit else f"{words}, {whose}",
                form=form,
            )
            for column, words, unit, form in (
                ("area_mm2", "area", "mm2", ".0f"),
                ("volume_mm3", "volume", "mm3", ".0f"),
                ("gyrification_index", "gyrification index", "", ".3f"),
                ("fold_spacing_mm", "width of folds", "mm", ".1f"),
            )
            for which, whose in (("", "predicted"), ("real_", "real"))
        ),
        Column("residual", "Measured less simulated growth after the last round: logarithm of the area, rms"),
        Column("outcome", "How the fold ended"),
    ),
    first=(),
    group=("series", "kind"),
)


def scores(series: Series, points: Mapping[float, FloatArray]) -> list[dict[str, Any]]:
    """Scores of predicted surfaces: a row per age, and one for each of its lobes, with the columns of `PREDICTION`.

    Parameters
    ----------
    points : age -> (n, 3) mm; none of them need be aligned
    """
    first, whole = series.first, series.weights
    depth = depth_below_hull(first.points)
    rows = []
    for age, predicted in sorted(points.items()):
        real = series.at(age)
        laid = aligned(predicted, real.points, whole)
        away = np.linalg.norm(laid - real.points, axis=1)
        deep, really = depth_below_hull(laid), depth_below_hull(real.points)
        curved, curvature = (smoothed_curvature(one, first.faces) for one in (laid, real.points))
        parts: dict[str | None, FloatArray] = {None: whole, **{name: whole * at for name, at in series.lobes.items()}}
        for lobe, weights in parts.items():
            if not weights.any():
                continue
            rows.append(
                {
                    "lobe": lobe,
                    "gestational_age": age,
                    "gained_depth": _known(correlation(deep - depth, really - depth, weights)),
                    "depth": _known(correlation(deep, really, weights)),
                    "curvature": _known(correlation(curved, curvature, weights)),
                    "distance_mm": float(np.average(away, weights=weights)),
                    "distance_95_mm": _quantile(away, weights, 0.95),
                }
            )
            if lobe is None:
                rows[-1] |= {**_shape(series, laid, ""), **_shape(series, real.points, "real_")}
    return rows


def correlation(a: FloatArray, b: FloatArray, weights: FloatArray) -> float:
    """Weighted correlation of two fields; NaN if one of them is the same everywhere."""
    a, b = (values - np.average(values, weights=weights) for values in (a, b))
    size = float(np.sqrt((weights * a * a).sum() * (weights * b * b).sum()))
    return float((weights * a * b).sum()) / size if size else float("nan")


def _known(value: float) -> float | None:
    """A value that JSON can hold; None for NaN."""
    return value if np.isfinite(value) else None


def _quantile(values: FloatArray, weights: FloatArray, part: float) -> float:
    order = np.argsort(values)
    return float(np.interp(part, np.cumsum(weights[order]) / weights.sum(), values[order]))


def _shape(series: Series, points: FloatArray, prefix: str) -> dict[str, Any]:
    """Area, volume, index and width of folds."""
    found = shape(points, series.first.faces, series.weights == 0, float("nan"))
    return {
        f"{prefix}{name}": found[name] for name in ("area_mm2", "volume_mm3", "gyrification_index", "fold_spacing_mm")
    }


_LINES = {
    "mechanics": (BLUE, "-"),
    "core": (BLUE, ":"),
    "forecast": (VERMILION, "-"),
    "uniform": (GREEN, "-"),
    "shuffled": (GREEN, ":"),
    "unmapped": ("black", "-"),
    "braingrowth": ("black", "--"),
    "path": (VERMILION, ":"),
    "nothing": ("black", ":"),
}


def prediction_figure(table: pd.DataFrame) -> Figure:
    """How well each kind predicts, against age."""
    with drawn(PAGE, 2.2) as figure:
        axes = figure.subplots(1, 4)
        for axis, (column, words) in zip(
            axes,
            (
                ("gained_depth", "correlation of gained depth"),
                ("depth", "correlation of depth"),
                ("curvature", "correlation of curvature"),
                ("distance_mm", "distance (mm)"),
            ),
            strict=True,
        ):
            whole = table[table["lobe"].isna()]
            for number, (_, own) in enumerate(whole.groupby("series", sort=False)):
                for kind, rows in own.groupby("kind", sort=False):
                    colour, style = _LINES[str(kind)]
                    label = "_" if number else str(kind)  # every series has the same kinds
                    axis.plot(rows["gestational_age"], rows[column], style, color=colour, label=label, marker=".", ms=3)
            axis.set(xlabel="gestational age (weeks)", ylabel=words)
            weeks(axis, table["gestational_age"].min(), table["gestational_age"].max())
        letter(axes)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(_LINES))
    return figure


def prediction_views(series: Series, points: Mapping[float, FloatArray], hemisphere: str | None) -> Figure:
    """Predicted brains and the real ones beside them, at one scale, from three sides."""
    rows = [
        Row(age, _brain(series, predicted), _brain(series, series.at(age).points))
        for age, predicted in sorted(points.items())
    ]
    return sheet(rows, hemisphere)


def error_views(series: Series, points: Mapping[float, FloatArray], hemisphere: str | None) -> Figure:
    """Where predictions are too shallow (blue) or too deep (red), on the real brains, from three sides."""
    return map_views(
        series,
        {age: depth_below_hull(laid) - depth_below_hull(series.at(age).points) for age, laid in points.items()},
        hemisphere,
        span=(-_DEPTH_ERROR_MM, _DEPTH_ERROR_MM),
        colours="RdBu_r",
        label="depth below the hull, predicted less real (mm)",
    )


def map_views(
    series: Series,
    values: Mapping[float, FloatArray],
    hemisphere: str | None,
    *,
    span: tuple[float, float],
    colours: str,
    label: str,
) -> Figure:
    """Values of the vertices on the real brains of their ages, from three sides; the medial wall is grey.

    Parameters
    ----------
    values : age -> (n,)
    span, colours, label : of the scale of colours
    """
    seen, ages = sides(hemisphere), sorted(values)
    brains = [
        _brain(series, series.at(age).points)._replace(curvature=np.where(series.weights > 0, values[age], np.nan))
        for age in ages
    ]
    widest = max(float(extent(brain, side).max()) for brain in brains for side in seen)
    with drawn(PAGE, 1.5 * len(ages) + 0.6) as figure:
        axes = figure.subplots(len(ages), len(seen), squeeze=False)
        for row, age, brain in zip(axes, ages, brains, strict=True):
            for axis, side in zip(row, seen, strict=True):
                size = (_PIXELS, _PIXELS * 3 // 4)
                axis.imshow(
                    view(brain, side, centre(brain), size, size[0] / widest / _ROOM, span=span, colours=colours)
                )
                axis.set(xticks=[], yticks=[], frame_on=False, title=f"{age:g} weeks, {side.name}")
        scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(*span), colours)
        bar = figure.colorbar(scale, ax=axes, orientation="horizontal", shrink=0.4, aspect=40, extend="both")
        bar.set_label(label)
    return figure


def _brain(series: Series, points: FloatArray) -> Brain:
    return brain_of(TriSurface(points, series.first.faces), series.weights == 0)


def write_run(prediction: Prediction, series: Series, folder: Path) -> dict[str, Any]:
    """Write the predicted surfaces and the imposed growth in place of earlier ones; returns the entries of a record."""
    for earlier in folder.glob(f"{_PREDICTED}*"):
        earlier.unlink()
    if prediction.imposed:
        fields = {growth_field(age): values for age, values in sorted(prediction.imposed.items())}
        write_fields(fields, folder / "imposed.func.gii")
    for age, points in prediction.points.items():
        path = folder / f"{_PREDICTED}{_exactly(age)}.surf.gii"
        write_surface(replace(series.first, points=points, point_data={}), path)
    return {
        "kind": prediction.kind,
        "verdict": asdict(prediction.verdict) if prediction.verdict else None,
        "residuals": prediction.residuals,
        "scores": scores(series, prediction.points),
    }


def prediction_table(records: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """A row per series, kind and age from the records of runs."""
    rows = []
    for record in records:
        left = record["residuals"][-1] if record["residuals"] else {}
        for row in record["scores"]:
            outcome = record["verdict"]["outcome"] if record["verdict"] else None
            residual = None if row["lobe"] else left.get(f"rms_{row['gestational_age']:g}")
            which = {"series": record["series"], "kind": record["kind"]}
            rows.append({**which, **row, "residual": residual, "outcome": outcome})
    return pd.DataFrame(rows, columns=names(PREDICTION.columns))


def _exactly(age: float) -> str:
    """An age as short as it can be read back: 28, 26.2857142857."""
    return f"{age:g}" if float(f"{age:g}") == age else repr(age)


def predicted_surfaces(folder: Path) -> dict[float, FloatArray]:
    """The points of the surfaces that `write_run` wrote, by age."""
    files = {float(path.name.split("_")[1].removesuffix(".surf.gii")): path for path in folder.glob(f"{_PREDICTED}*")}
    return {age: read_surface(path).points for age, path in sorted(files.items())}


def write_prediction(records: Sequence[Path], outputs: Sequence[str | Path]) -> None:
    """Write table and figure of the records of some runs."""
    table = prediction_table([json.loads(path.read_text(encoding="utf-8")) for path in records])
    write_outputs(outputs, PREDICTION, table, prediction_figure(table))
