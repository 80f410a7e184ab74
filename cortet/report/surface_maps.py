"""Values at the vertices of surfaces, as figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cortet.meshes import TriSurface
from cortet.report.figures import PAGE, drawn, letter
from cortet.report.pages import SIDES
from cortet.report.render import surface_view

#: percent of the vertices that the range of colours leaves out at either end
_TAIL = 2.0


def usual_range(values: NDArray[Any], tail: float = _TAIL) -> tuple[float, float]:
    """The range of colours of values: without their tails, so many percent at either end, and never empty."""
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, [tail, 100 - tail]) if len(known) else (0.0, 1.0)
    return float(low), max(float(high), float(low) + 1e-6)


def map_view(
    surface: TriSurface,
    values: NDArray[Any],
    side: Literal["L", "R"],
    limits: tuple[float, float],
    colours: str | Colormap = "viridis",
    size: tuple[int, int] = (450, 340),
) -> tuple[NDArray[np.uint8], ScalarMappable]:
    """A picture of values (v,) from one side, as `surface_view`, and its colours; NaN has the lowest."""
    of_faces = np.nan_to_num(values.astype(np.float64), nan=limits[0])[surface.faces].mean(axis=1)
    image = surface_view(surface, side=side, size=size, values=of_faces, limits=limits, colours=colours)
    return image, ScalarMappable(Normalize(*limits), colours)


def maps_figure(surface: TriSurface, maps: Mapping[str, NDArray[Any]], hemi: Literal["L", "R"] | None = None) -> Figure:
    """Each map (v,) on a surface, seen from both sides, with its own colours; keys are labels.

    Parameters
    ----------
    hemi : of the surface, whose sides are then called lateral and medial
    """
    with drawn(PAGE, 2.6 * len(maps)) as figure:
        axes = figure.subplots(len(maps), len(SIDES), squeeze=False)
        for row, (label, values) in zip(axes, maps.items(), strict=True):
            limits = usual_range(values, 1.0)
            for axis, (side, word) in zip(row, SIDES.items(), strict=True):
                image, colours = map_view(surface, values, side, limits, size=(900, 675))
                _show(axis, image, f"from the {word}" if hemi is None else "lateral" if side == hemi else "medial")
            figure.colorbar(colours, ax=row, shrink=0.6, extend="both", label=label)
        if len(maps) > 1:
            letter(axes[:, 0])
    return figure


def _show(axis: Axes, image: NDArray[np.uint8], title: str) -> None:
    axis.imshow(image, interpolation="antialiased")
    axis.set_axis_off()
    axis.set_title(title)
