"""Pictures of a folding run: its numbers against age, the surface before and after, and a film."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pandas as pd
import pyvista
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import vtu
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import MEDIAL_WALL
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.report import published
from cortet.report.figures import BLUE, GREY, PAGE, STYLE, VERMILION, drawn, save
from cortet.report.render import off_screen
from cortet.simulation.journal import SERIES, TABLE

VERSION: int = 2

#: files that `draw` adds to the folder of a run
NUMBERS, PICTURE, FILM = "folding.svg", "folded.png", "folding.gif"

#: colours span mean curvatures between minus and plus this, 1 / mm: gyri at one end, sulci at the other
CURVATURE = 0.3
COLOURS = "RdBu_r"
#: pixels of one view, and frames per second of the film
_VIEW, _RATE = (800, 640), 5
#: column that is drawn against age -> label of its panel
_PANELS = {
    "gyrification_index": "gyrification index",
    "relative_area": "area / volume$^{2/3}$",
    "min_j": "smallest J",
    "q_max": r"$q_\mathrm{max}$",
}
#: side from which a left half or a whole brain is seen -> its direction and the upward direction, in RAS coordinates
_SIDE, _MIDDLE, _ABOVE = "side", "middle", "above"
_VIEWS = {
    _SIDE: (np.array([-1.0, 0, 0]), np.array([0, 0, 1.0])),
    _MIDDLE: (np.array([1.0, 0, 0]), np.array([0, 0, 1.0])),
    _ABOVE: (np.array([0, 0, 1.0]), np.array([1.0, 0, 0])),
}
#: colour of the medial wall
_WALL_COLOUR = "#6b6b6b"

Image = NDArray[np.uint8]


def draw(folder: Path, hemisphere: str | None) -> list[Path]:
    """Draw all pictures of the run in a folder; returns their files.

    Parameters
    ----------
    hemisphere : "L" or "R" is filmed from its lateral side; a whole brain (None) from the left
    """
    save(numbers(folder / TABLE, hemisphere), folder / NUMBERS)
    frames = series(folder / SERIES)
    ends = [frames[0], frames[-1]]
    shown = [list(views([path for path, _ in ends], hemisphere, side)) for side in (_SIDE, _MIDDLE, _ABOVE)]
    save(before_and_after(shown, [age for _, age in ends]), folder / PICTURE)
    film(views([path for path, _ in frames], hemisphere), [age for _, age in frames], folder / FILM)
    return [folder / name for name in (NUMBERS, PICTURE, FILM)]


def series(path: Path) -> list[tuple[Path, float]]:
    """Frames of a run and their gestational ages, from its `.pvd` file."""
    try:
        entries = list(ElementTree.parse(path).iter("DataSet"))
    except (OSError, ElementTree.ParseError) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="fold the mesh again") from error
    return [(path.parent / entry.attrib["file"], float(entry.attrib["timestep"])) for entry in entries]


def numbers(table: Path, hemisphere: str | None) -> Figure:
    """Gyrification index, area over volume^(2/3), smallest J and worst q against gestational age.

    Real surfaces are drawn behind the first two: of one hemisphere for half a brain, else of both.
    """
    rows = curves(table)
    with drawn(PAGE, 2.2) as figure:
        for axis, (column, label) in zip(figure.subplots(1, len(_PANELS)), _PANELS.items(), strict=True):
            axis.plot(rows["gestational_age"], rows[column], color=BLUE, label="this run")
            axis.set(xlabel="gestational age (weeks)", ylabel=label)
            if column == "min_j":
                axis.axhline(0, color=VERMILION, linestyle="--", linewidth=0.8)
            if column in ("gyrification_index", "relative_area"):
                real_points(axis, column, hemisphere)
        figure.axes[0].legend(loc="upper left")
    return figure


def curves(table: Path) -> pd.DataFrame:
    """The table of a run as numbers, with area / volume^(2/3) as `relative_area`."""
    rows = read_tsv(table).apply(pd.to_numeric, errors="coerce")
    return rows.assign(relative_area=rows["area_mm2"] / rows["volume_mm3"] ** (2 / 3))


def real_points(axis: Axes, column: str, hemisphere: str | None) -> None:
    """Draw inner surfaces of real brains: fetuses dark, newborns, whose index jumps at birth, in grey."""
    brains = published.real_brains()
    brains["relative_area"] = brains["area_cm2"] / brains["volume_ml"] ** (2 / 3)
    brains = brains[(brains["surface_type"] == "white") & ((brains["hemi"] == "both") == (hemisphere is None))]
    born = brains["source"].str.startswith("dHCP")
    for chosen, colour, label in ((~born, "black", "real, fetal"), (born, GREY, "real, newborn")):
        points = brains[chosen]
        axis.scatter(points["gestational_age_weeks"], points[column], s=6, color=colour, label=label, zorder=3)


def views(frames: list[Path], hemisphere: str | None, side: str = _SIDE) -> Iterator[Image]:
    """The surface of each frame from a side, coloured by mean curvature, all at the scale of the last frame."""
    direction, up = _VIEWS[side]
    if hemisphere == "R":
        direction, up = direction * [-1, 1, 1], up * [-1, 1, 1]
    surfaces = (_surface(vtu.read(path)) for path in frames)
    last = _surface(vtu.read(frames[-1]))
    focus = (last.points.min(axis=0) + last.points.max(axis=0)) / 2
    extent = np.ptp(last.points, axis=0)
    scale = 1.05 * max(extent[2], extent[1] * _VIEW[1] / _VIEW[0]) / 2
    for surface in surfaces:
        yield _view(surface, focus, direction, up, scale)


def _surface(mesh: TetMesh) -> TriSurface:
    """The boundary, with the field of the medial wall if the mesh has it."""
    surface, nodes = boundary_surface(mesh)
    fields = {name: mesh.point_data[name][nodes] for name in (MEDIAL_WALL,) if name in mesh.point_data}
    return replace(surface, point_data=fields)


def _view(surface: TriSurface, focus: FloatArray, direction: FloatArray, up: FloatArray, scale: float) -> Image:
    shell = pyvista.PolyData.from_regular_faces(surface.points, surface.faces)
    curvature = shell.curvature("mean")
    if MEDIAL_WALL in surface.point_data:  # values that are no numbers get the colour of the wall
        curvature = np.where(surface.point_data[MEDIAL_WALL] != 0, np.nan, curvature)
    shell.point_data["curvature"] = curvature
    with off_screen(_VIEW) as plotter:
        plotter.add_mesh(
            shell,
            scalars="curvature",
            cmap=COLOURS,
            clim=(-CURVATURE, CURVATURE),
            nan_color=_WALL_COLOUR,
            smooth_shading=True,
            split_sharp_edges=False,
            show_scalar_bar=False,
            ambient=0.25,
            specular=0.1,
        )
        distance = 10 * scale
        plotter.camera.position, plotter.camera.focal_point = focus + distance * direction, focus
        plotter.camera.up = up
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = scale
        plotter.camera.clipping_range = (0.1 * distance, 3 * distance)
        image: Image = plotter.screenshot(return_img=True)
    return image


def before_and_after(images: list[list[Image]], ages: list[float]) -> Figure:
    """The surface before (upper row) and after, from several sides (columns), with the scale of colours."""
    with drawn(PAGE, 3.4) as figure:
        axes = figure.subplots(len(ages), len(images))
        for column, side in zip(axes.T, images, strict=True):
            for axis, image in zip(column, side, strict=True):
                axis.imshow(image)
                axis.set_axis_off()
        for row, age in zip(axes, ages, strict=True):
            row[0].set_title(f"{age:.1f} weeks", loc="left")
        norm = mpl.colors.Normalize(-CURVATURE, CURVATURE)
        figure.colorbar(
            mpl.cm.ScalarMappable(norm, COLOURS), ax=axes, shrink=0.6, aspect=30, label="mean curvature (1/mm)"
        )
    return figure


def film(images: Iterator[Image], ages: list[float], path: Path) -> None:
    """Write an animated GIF, one image per gestational age; the last image stays for a second."""
    with mpl.rc_context({**STYLE, "font.size": 12}), atomic_path(path) as temporary:
        figure = Figure(figsize=(_VIEW[0] / 100, _VIEW[1] / 100), dpi=100)
        axis = figure.add_axes((0, 0, 1, 1))
        axis.set_axis_off()
        writer = PillowWriter(fps=_RATE)
        with writer.saving(figure, temporary, dpi=100):
            for image, age in zip(images, ages, strict=True):
                axis.clear()
                axis.set_axis_off()
                axis.imshow(image)
                axis.text(0.02, 0.95, f"{age:.1f} weeks", transform=axis.transAxes)
                writer.grab_frame()
            for _ in range(_RATE - 1):
                writer.grab_frame()
