"""The developmental series: meshes of several ages side by side, on one scale, from the outside and cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from cortet.formats import vtu
from cortet.meshes import TetMesh
from cortet.report.figures import PAGE, Q_AXIS, H, drawn, letter, save
from cortet.report.records import read_certificate
from cortet.report.render import BEYOND, COLOURS, RANGE, lateral_view

VERSION: int = 9

#: hemisphere -> its name, in the order of the rows
_HEMISPHERES = {"L": "left", "R": "right", "n/a": "whole brain"}
#: white around the largest mesh, length of the scale bar in mm, and resolution of the pictures
_MARGIN, _BAR, _DPI = 1.04, 20.0, 400
#: least number of columns of a page
_FEWEST = 3


@dataclass(frozen=True)
class Brain:
    """The meshes of a brain at one age."""

    #: weeks; None if it is not known
    age: float | None
    #: by hemisphere: `L`, `R`, or `n/a` for all of it
    meshes: Mapping[str, TetMesh]
    #: written below its age
    name: str = ""
    #: whether all its meshes are certified; below the name it says if they are not
    certified: bool = True


def series_figure(brains: Sequence[Brain], *, cell_size: float | None = None) -> Figure:
    """Meshes by age: each hemisphere from its lateral side, and the first one of each brain cut, with q in colour.

    If a brain has more than one hemisphere, each has a row of its own.

    Parameters
    ----------
    cell_size : mm, written beside the scale bar
    """
    hemispheres = [[hemi for hemi in _HEMISPHERES if hemi in brain.meshes] for brain in brains]
    several = max(map(len, hemispheres)) > 1
    rows = [hemi for hemi in _HEMISPHERES if any(hemi in brain.meshes for brain in brains)] if several else [None]
    extents = [np.ptp(mesh.points, axis=0) for brain in brains for mesh in brain.meshes.values()]
    half_width, half_height = _MARGIN / 2 * np.max(extents, axis=0)[1:]
    # where one is not certified, an empty line keeps the names of the others at its height
    marks = ("", "") if all(brain.certified for brain in brains) else ("\n", "\nnot certified")
    room = PAGE / max(len(brains), _FEWEST)
    size = (room * len(brains), room * half_height / half_width * (len(rows) + 1) + 0.75)

    def draw(axis: Axes, mesh: TetMesh, hemi: str, cut: bool) -> None:
        side = _lateral_side(mesh, hemi)
        image = lateral_view(
            mesh,
            side=side,
            cut=cut,
            half_width=half_width,
            half_height=half_height,
            width=round(_DPI * room),
        )
        axis.imshow(image, extent=(0, 2 * half_width, 0, 2 * half_height), interpolation="antialiased")
        if not cut:  # the cut below it has the same directions
            place: dict[str, Any] = {"x": 0.02, "ha": "left"} if side == "L" else {"x": 0.98, "ha": "right"}
            axis.text(
                y=0,
                s="\u2190 anterior" if side == "L" else "anterior \u2192",
                va="bottom",
                fontsize="small",
                transform=axis.transAxes,
                **place,
            )

    with drawn(*size) as figure:
        axes = figure.subplots(len(rows) + 1, len(brains), squeeze=False)
        for column, brain, (first, *_) in zip(axes.T, brains, hemispheres, strict=True):
            weeks = "age n/a" if brain.age is None else f"{brain.age:g} weeks"
            side = "" if several else f", {_HEMISPHERES[first]}"
            name = f"\n{brain.name}" if brain.name else ""
            column[0].set_title(weeks + side + name + marks[not brain.certified])
            for axis, row in zip(column, [*rows, None], strict=True):
                _bare(axis)
                hemi = row or first
                if hemi in brain.meshes:
                    draw(axis, brain.meshes[hemi], hemi, cut=axis is column[-1])
        shown = [_HEMISPHERES[hemi] if hemi else "surface" for hemi in rows]
        for axis, what in zip(axes[:, 0], [*shown, "sagittal cut\nthrough the middle"], strict=True):
            axis.set_ylabel(what)
        letter(axes[:, 0])
        _draw_scale(axes[-1, 0])
        if cell_size is not None:
            axes[-1, 0].annotate(
                f"{H} = {cell_size:g} mm", (1.2 * _BAR, -1.5), va="center", fontsize="small", annotation_clip=False
            )
        _colour_bar(figure, axes)
    return figure


def _lateral_side(mesh: TetMesh, hemi: str) -> Literal["L", "R"]:
    """The side of the head from which a hemisphere shows its lateral side; if it is not named, x tells."""
    return "R" if hemi == "R" or (hemi != "L" and mesh.points[:, 0].min() >= 0) else "L"


def draw_series(
    brains: Sequence[Mapping[str, Any]], outputs: Sequence[str | Path], *, cell_size: float | None = None
) -> None:
    """Draw the series from files: each brain has its `name`, `age` in weeks, `meshes` and `certificates` by hemisphere.

    A mesh without a certificate is not certified.
    """
    loaded = [
        Brain(
            brain["age"],
            {hemi: vtu.read(path) for hemi, path in brain["meshes"].items()},
            brain["name"],
            _is_certified(brain),
        )
        for brain in brains
    ]
    save(series_figure(loaded, cell_size=cell_size), *outputs)


def _is_certified(brain: Mapping[str, Any]) -> bool:
    """Whether all meshes of a brain are certified."""
    certificates = brain["certificates"]
    known = (read_certificate(certificates[hemi])["certified"] for hemi in brain["meshes"] if hemi in certificates)
    return certificates.keys() >= brain["meshes"].keys() and all(known)


def _bare(axis: Axes) -> None:
    axis.set(xticks=[], yticks=[])
    axis.spines[:].set_visible(False)


def _draw_scale(axis: Axes) -> None:
    """A scale bar below the picture."""
    axis.plot([0, _BAR], [-1.5, -1.5], color="black", linewidth=1.5, clip_on=False, solid_capstyle="butt")
    axis.annotate(
        f"{_BAR:g} mm",
        (_BAR / 2, -1.5),
        xytext=(0, -3),
        textcoords="offset points",
        ha="center",
        va="top",
        fontsize="small",
    )


def _colour_bar(figure: Figure, axes: Any) -> None:
    colours = mpl.colormaps[COLOURS].with_extremes(over=BEYOND)
    bar = figure.colorbar(
        ScalarMappable(Normalize(*RANGE), colours),
        ax=axes,
        location="bottom",
        extend="max",
        shrink=0.4,
        aspect=30,
        pad=0.02,
    )
    bar.set_label(Q_AXIS)
