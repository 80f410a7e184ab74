"""Values at the vertices of a surface, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from numpy.typing import NDArray

from cortet.meshes import TriSurface
from cortet.report.figures import PAGE, drawn, save
from cortet.report.pages import SIDES
from cortet.report.render import surface_view

VERSION: int = 1

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
    low, high = limits
    of_faces = np.nan_to_num(values.astype(np.float64), nan=low)[surface.faces].mean(axis=1)
    image = surface_view(surface, side=side, size=size, distances=of_faces, lowest=low, darkest=high, colours=colours)
    return image, ScalarMappable(Normalize(low, high), colours)


def draw_map(surface: TriSurface, values: NDArray[Any], name: str, path: Path) -> None:
    """Write a picture (.png) of values (v,) from both sides, with a bar of their colours.

    Raises
    ------
    StageError : the graphics library cannot draw here
    """
    with drawn(PAGE, 2.4) as figure:
        axes = figure.subplots(1, len(SIDES))
        for axis, (side, word) in zip(axes, SIDES.items(), strict=True):
            image, colours = map_view(surface, values, side, usual_range(values))
            axis.imshow(image, interpolation="antialiased")
            axis.set_axis_off()
            axis.set_title(word)
        figure.colorbar(colours, ax=axes, shrink=0.8, label=name)
    save(figure, path)
