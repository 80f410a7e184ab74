"""Values at the vertices of surfaces, as figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cortet.meshes import TriSurface
from cortet.report.figures import PAGE, drawn, letter
from cortet.report.pages import SIDES
from cortet.report.render import surface_view


def usual_range(values: NDArray[Any], tail: float = 2.0) -> tuple[float, float]:
    """The range of colours of values: without their tails, so many percent at either end, and never empty."""
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, [tail, 100 - tail]) if len(known) else (0.0, 1.0)
    return float(low), max(float(high), float(low) + 1e-6)


def maps_figure(surface: TriSurface, maps: Mapping[str, NDArray[Any]], hemi: Literal["L", "R"] | None = None) -> Figure:
    """Each map (v,) on a surface, seen from both sides, with its own colours, of which NaN has the lowest.

    Parameters
    ----------
    maps : label -> values of the vertices
    hemi : of the surface, whose sides are then called lateral and medial
    """
    with drawn(PAGE, 2.6 * len(maps)) as figure:
        axes = figure.subplots(len(maps), len(SIDES), squeeze=False)
        for row, (label, values) in zip(axes, maps.items(), strict=True):
            limits = usual_range(values, 1.0)
            of_faces = np.nan_to_num(values.astype(np.float64), nan=limits[0])[surface.faces].mean(axis=1)
            for axis, (side, word) in zip(row, SIDES.items(), strict=True):
                image = surface_view(surface, side=side, values=of_faces, limits=limits, colours="viridis")
                axis.imshow(image, interpolation="antialiased")
                axis.set_axis_off()
                axis.set_title(f"from the {word}" if hemi is None else "lateral" if side == hemi else "medial")
            colours = ScalarMappable(Normalize(*limits), "viridis")
            figure.colorbar(colours, ax=row, shrink=0.6, extend="both", label=label)
        if len(maps) > 1:
            letter(axes[:, 0])
    return figure
