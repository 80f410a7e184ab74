"""How sure a prediction is: the same with other cells, stiffness and thickness, and whether the truth is among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from prediction_tables import map_views
from series import Series, aligned

from cortet.errors import InputError
from cortet.folding.measurements import depth_below_hull
from cortet.meshes import FloatArray

#: the truth is among the predictions where it is at most so many standard deviations from their mean
_AMONG = 2.0
#: a vertex at most so deep, mm, lies on the hull
_ON_HULL = 1e-6
#: colours of standard deviations span 0 to the value that this share of the vertices does not exceed
_DARKEST = 0.99


@dataclass(frozen=True, eq=False)
class Spread:
    """Predictions of one age, per vertex (n,), mm."""

    #: mean depth below the hull, and its standard deviation over the runs
    depth: FloatArray
    depth_sd: FloatArray
    #: distance of a vertex from where it is on average, root mean square over the runs
    position_sd: FloatArray


def spreads(series: Series, runs: Sequence[Mapping[float, FloatArray]]) -> dict[float, Spread]:
    """How far runs lie apart, at each age that all of them have reached.

    Parameters
    ----------
    runs : age -> (n, 3) mm, of each run

    Raises
    ------
    InputError : there are fewer than two runs
    """
    if len(runs) < 2:
        raise InputError("one run has no spread", remedy="name two prediction.variants or more")
    ages = sorted(set.intersection(*(set(run) for run in runs)))
    return {age: _spread([aligned(run[age], series.at(age).points, series.weights) for run in runs]) for age in ages}


def _spread(laid: Sequence[FloatArray]) -> Spread:
    depths, points = np.array([depth_below_hull(one) for one in laid]), np.array(laid)
    away = ((points - points.mean(axis=0)) ** 2).sum(axis=2)
    return Spread(
        depth=depths.mean(axis=0),
        depth_sd=depths.std(axis=0, ddof=1),
        position_sd=np.sqrt(away.sum(axis=0) / (len(laid) - 1)),
    )


def checked(series: Series, found: Mapping[float, Spread]) -> list[dict[str, Any]]:
    """A row per age: means over the cortex of the spread, and the share where the real depth is among the predicted.

    That share leaves out vertices that lie on the hull in truth and in every prediction: there is nothing to predict.
    """
    rows = []
    for age, spread in found.items():
        real = depth_below_hull(series.at(age).points)
        error = np.abs(real - spread.depth)
        below = series.weights * (np.maximum(real, spread.depth) > _ON_HULL)
        values = {"depth_sd_mm": spread.depth_sd, "position_sd_mm": spread.position_sd, "depth_error_mm": error}
        means = {name: float(np.average(of, weights=series.weights)) for name, of in values.items()}
        among = float(np.average(error <= _AMONG * spread.depth_sd, weights=below)) if below.any() else None
        rows.append({"gestational_age": age, **means, "among": among})
    return rows


def maps_of(found: Mapping[float, Spread]) -> dict[str, FloatArray]:
    """The standard deviations as fields of the vertices."""
    return {
        f"{name}_sd_at_{age:g}": getattr(spread, f"{name}_sd")
        for age, spread in found.items()
        for name in ("depth", "position")
    }


def spread_views(series: Series, found: Mapping[float, Spread], hemisphere: str | None) -> Figure:
    """Where predictions of depth lie apart, on the real brains, from three sides."""
    darkest = max(float(np.quantile(spread.depth_sd[series.weights > 0], _DARKEST)) for spread in found.values())
    return map_views(
        series,
        {age: spread.depth_sd for age, spread in found.items()},
        hemisphere,
        span=(0.0, darkest),
        colours="YlOrRd",
        label="standard deviation of the predicted depth below the hull (mm)",
    )
