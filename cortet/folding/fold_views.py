"""Views of simulated and real brains from several sides, at one scale, coloured by their folds."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pyvista
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cortet.folding.body import scale_of
from cortet.folding.measurements import smoothed_curvature
from cortet.folding.medial_wall import medial_wall
from cortet.formats import vtu
from cortet.formats.gifti import read_surface
from cortet.formats.surface_sets import MEDIAL_WALL
from cortet.geometry.topology import boundary_surface
from cortet.meshes import FloatArray, TriSurface
from cortet.report.colours import VERMILION
from cortet.report.figures import PAGE, STYLE
from cortet.report.render import off_screen

#: colours span mean curvatures between minus and plus this, 1/mm: gyri at one end, sulci at the other
CURVATURE = 0.3
COLOURS = "RdBu_r"
#: colour of the medial wall, and what stands beside it
WALL_COLOUR = "#6b6b6b"
_WALL_MEANS = "medial wall: the cut towards the other half, no cortex"

#: inches of the sheet: left of the brains, above and below them, between rows and columns, and the tallest sheet
_LEFT, _TOP, _BOTTOM, _ROW_GAP, _GAP, _TALLEST = 0.62, 0.46, 0.62, 0.2, 0.1, 9.5
#: left end of the legend for grey, inches from the left
_LEGEND = 2.1
#: letters in a line of a warning, and inches of a line
_LETTERS, _LINE = 115, 0.12
#: pixels of a view per inch of the sheet, twice those of the file
_PIXELS = 600
#: lengths that a scale bar may have, mm
_BARS = (1, 2, 5, 10, 20, 50)

Image = NDArray[np.uint8]


class Colours(NamedTuple):
    """What the colours of brains mean."""

    #: of the values and their unit
    label: str
    #: values at both ends of the colours, and the name of these
    span: tuple[float, float]
    name: str
    #: what grey stands for
    grey: str


FOLDS = Colours("mean curvature (1/mm): sulci blue, gyri red", (-CURVATURE, CURVATURE), COLOURS, _WALL_MEANS)


class Brain(NamedTuple):
    """A surface and the folds on it."""

    surface: TriSurface
    #: (n,) 1/mm, smoothed, or the values of a map; NaN on the medial wall
    curvature: FloatArray


class Row(NamedTuple):
    """The brains of one age."""

    #: age of the simulated brain, weeks
    age: float
    simulated: Brain
    #: a real brain, and its name
    real: Brain | None = None
    name: str = ""


class Side(NamedTuple):
    """Direction from which a brain is seen, in RAS coordinates."""

    name: str
    towards: FloatArray
    up: FloatArray
    #: which way the front is, and what is up if that is not the top
    directions: str

    @property
    def right(self) -> FloatArray:
        """The direction to the right of the picture."""
        return np.asarray(np.cross(self.up, self.towards))


def sides(hemisphere: str | None) -> list[Side]:
    """Lateral, medial and superior side of a hemisphere ("L" or "R"); left, right and superior one of a whole brain."""
    x, y, z = np.eye(3)
    if hemisphere == "R":
        x = -x
    names = ("left", "right", "superior") if hemisphere is None else ("lateral", "medial", "superior")
    above = "right side up" if hemisphere is None else "midline up"
    found = []
    for name, towards, up, what in zip(names, (-x, x, z), (z, z, x), ("", "", f", {above}"), strict=True):
        front = "right" if np.cross(up, towards) @ y > 0 else "left"
        found.append(Side(name, towards, up, f"anterior {front}{what}"))
    return found


def brain_of(surface: TriSurface, wall: NDArray[np.bool_]) -> Brain:
    """The brain of a closed surface; `wall` (n,) marks the nodes of its medial wall."""
    curvature = smoothed_curvature(surface.points, surface.faces)
    return Brain(surface, np.where(wall, np.nan, curvature))


def simulated_brain(frame: Path) -> Brain:
    """The brain of a frame of a run (.vtu)."""
    mesh = vtu.read(frame)
    surface, nodes = boundary_surface(mesh)
    marks = mesh.point_data.get(MEDIAL_WALL)
    return brain_of(surface, np.zeros(len(nodes), bool) if marks is None else np.asarray(marks[nodes] != 0))


def real_brain(path: Path, hemisphere: str | None) -> Brain:
    """The brain of a surface in mm and RAS coordinates; a hemisphere has a medial wall."""
    surface, wall = read_surface(path), None
    if hemisphere is not None:
        scale = scale_of(surface, hemisphere)
        wall = medial_wall(surface, hemisphere, scale.origin, scale.length).nodes
    return brain_of(surface, np.zeros(len(surface.points), bool) if wall is None else wall)


def extent(brain: Brain, side: Side) -> FloatArray:
    """Width and height of a brain as seen from a side, mm (2,)."""
    return np.ptp(brain.surface.points @ np.stack([side.right, side.up]).T, axis=0)


def centre(brain: Brain) -> FloatArray:
    """Middle of the extents of a brain, mm (3,)."""
    return np.asarray((brain.surface.points.min(axis=0) + brain.surface.points.max(axis=0)) / 2)


def view(
    brain: Brain,
    side: Side,
    focus: FloatArray,
    size: tuple[int, int],
    pixels_per_mm: float,
    *,
    span: tuple[float, float] = (-CURVATURE, CURVATURE),
    colours: str = COLOURS,
) -> Image:
    """A brain from a side in parallel projection: (height, width, 3).

    Parameters
    ----------
    focus : mm (3,), point in the middle of the picture
    size : pixels, width and height
    span, colours : values that the colours span, and their name
    """
    shell = pyvista.PolyData.from_regular_faces(brain.surface.points, brain.surface.faces)
    shell.point_data["curvature"] = brain.curvature  # NaN gets the colour of the medial wall
    half_height = size[1] / pixels_per_mm / 2
    distance = 10 * max(half_height, float(np.ptp(brain.surface.points, axis=0).max()))
    with off_screen(size) as plotter:
        plotter.add_mesh(
            shell,
            scalars="curvature",
            cmap=colours,
            clim=span,
            nan_color=WALL_COLOUR,
            smooth_shading=True,
            split_sharp_edges=False,
            show_scalar_bar=False,
            ambient=0.25,
            specular=0.1,
        )
        plotter.camera.position, plotter.camera.focal_point = focus + distance * side.towards, focus
        plotter.camera.up = side.up
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = half_height
        plotter.camera.clipping_range = (0.1 * distance, 3 * distance)
        image: Image = plotter.screenshot(return_img=True)
    return image


def bar_length(width: float, times: int = 20) -> int:
    """Length of a scale bar, mm, that fits at least `times` times into the width of a picture, mm."""
    return max((bar for bar in _BARS if bar * times <= width), default=_BARS[0])


def draw_bar(axis: Axes, place: tuple[float, float], per_mm: float, mm: int) -> None:
    """Draw a scale bar from a point to the right, with its length above it; `per_mm` is in units of the axis."""
    x, y = place
    axis.plot([x, x + mm * per_mm], [y, y], color="black", linewidth=1.5, solid_capstyle="butt")
    axis.annotate(
        f"{mm} mm", (x + mm * per_mm / 2, y), xytext=(0, 2), textcoords="offset points", ha="center", va="bottom"
    )


def sheet(rows: Sequence[Row], hemisphere: str | None, colours: Colours = FOLDS, doubts: Sequence[str] = ()) -> Figure:
    """Brains of some ages, one below the other, from three sides, and real ones beside them, all at one scale.

    Parameters
    ----------
    hemisphere : "L" or "R"; None: whole brains
    doubts : sentences, written below the brains
    """
    seen, said = sides(hemisphere), [line for doubt in doubts for line in textwrap.wrap(f"Warning: {doubt}", _LETTERS)]
    pairs = [[row.simulated, row.real] if any(one.real for one in rows) else [row.simulated] for row in rows]
    sizes = np.array(
        [[extent(brain, side) if brain else (0.0, 0.0) for brain in pair for side in seen] for pair in pairs]
    )
    widths, heights = sizes[:, :, 0].max(axis=0), sizes[:, :, 1].max(axis=1)
    scale = min(
        (PAGE - _LEFT - len(widths) * _GAP) / widths.sum(),
        (_TALLEST - _TOP - _BOTTOM - len(rows) * _ROW_GAP) / heights.sum(),
    )  # inches per mm
    lefts = _LEFT + np.cumsum([0, *(widths[:-1] * scale + _GAP)])
    full = _TOP + _BOTTOM + heights.sum() * scale + len(rows) * _ROW_GAP + len(said) * _LINE
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(PAGE, full))
        axis = figure.add_axes((0, 0, 1, 1))
        top = full - _TOP
        _head(axis, seen, lefts, widths * scale, full, real=len(pairs[0]) > 1)
        for row, pair, height in zip(rows, pairs, heights * scale, strict=True):
            top -= _ROW_GAP
            middle = top - height / 2
            axis.text(0.05, middle, f"{row.age:.1f}".removesuffix(".0") + " weeks", va="center", fontweight="bold")
            if row.real is not None:
                axis.text(lefts[len(seen)], top + 0.04, row.name, va="bottom", fontsize=5, color="#404040")
            for place, (brain, side) in enumerate((brain, side) for brain in pair for side in seen):
                if brain is not None:
                    across = lefts[place] + widths[place] * scale / 2
                    _put(axis, brain, side, (across, middle), scale, colours)
            top -= height
        wall = any(np.isnan(one.curvature).any() for pair in pairs for one in pair if one)
        _foot(figure, axis, scale, colours, wall=wall, base=len(said) * _LINE)
        axis.text(_LEFT, 0.05, "\n".join(said), va="bottom", color=VERMILION, linespacing=1)
        axis.set(xlim=(0, PAGE), ylim=(0, full), aspect="equal")
        axis.set_axis_off()
    return figure


def _put(axis: Axes, brain: Brain, side: Side, middle: tuple[float, float], scale: float, colours: Colours) -> None:
    """Draw a brain around a point of the picture; `scale` is in inches per mm."""
    dots = _PIXELS * scale  # per mm
    width, height = (int(np.ceil(mm * dots)) + 4 for mm in extent(brain, side))
    image = view(brain, side, centre(brain), (width, height), dots, span=colours.span, colours=colours.name)
    half = np.array([width, height]) / dots * scale / 2
    left, right, low, high = middle[0] - half[0], middle[0] + half[0], middle[1] - half[1], middle[1] + half[1]
    axis.imshow(image, extent=(left, right, low, high), zorder=0)


def _head(axis: Axes, seen: Sequence[Side], lefts: FloatArray, widths: FloatArray, full: float, *, real: bool) -> None:
    """Write the headings of the columns: simulated or real, the side, and which way is the front."""
    for place, (left, width) in enumerate(zip(lefts, widths, strict=True)):
        side = seen[place % len(seen)]
        axis.text(left + width / 2, full - 0.34, side.name, ha="center")
        axis.text(left + width / 2, full - 0.46, side.directions, ha="center", fontsize=5, color="#404040")
    for number, name in enumerate(("simulated", "real")[: 1 + real]):
        first, last = number * len(seen), number * len(seen) + len(seen) - 1
        ends = lefts[first], lefts[last] + widths[last]
        axis.text(sum(ends) / 2, full - 0.16, name, ha="center", fontweight="bold")
        axis.plot(ends, [full - 0.2] * 2, color="black", linewidth=0.6)


def _foot(figure: Figure, axis: Axes, scale: float, colours: Colours, *, wall: bool, base: float) -> None:
    """Draw the legend below the brains, `base` inches up: scale bar, meaning of grey, and colour scale."""
    mm = bar_length(PAGE / scale)
    draw_bar(axis, (_LEFT + 0.1, base + 0.26), scale, mm)
    axis.text(_LEFT + 0.2 + mm * scale, base + 0.26, "at all ages", va="center")
    if wall:
        handles = [Patch(color=WALL_COLOUR, label=colours.grey)]
        place = (_LEGEND / PAGE, (base + 0.26) / figure.get_figheight())
        figure.legend(handles=handles, loc="center left", bbox_to_anchor=place, borderaxespad=0)
    strip = figure.add_axes((0.7, (base + 0.34) / figure.get_figheight(), 0.26, 0.07 / figure.get_figheight()))
    values = mpl.cm.ScalarMappable(mpl.colors.Normalize(*colours.span), colours.name)
    bar = figure.colorbar(values, cax=strip, orientation="horizontal", extend="both")
    bar.set_label(colours.label, labelpad=1)
