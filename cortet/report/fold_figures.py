"""Pictures of a folding run: its numbers against age, the surface before and after, and a film."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import pandas as pd
import pyvista
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cortet.errors import InputError
from cortet.formats import vtu
from cortet.formats.atomic import atomic_path
from cortet.formats.tsv import read_tsv
from cortet.geometry.topology import boundary_surface
from cortet.mesh import FloatArray, TetMesh, TriSurface
from cortet.report.figures import BLUE, PAGE, STYLE, VERMILION, save
from cortet.report.render import off_screen
from cortet.simulation.fold import SERIES, TABLE

VERSION: int = 1

#: files that `draw` adds to the folder of a run
NUMBERS, PICTURE, FILM = "folding.svg", "folded.png", "folding.gif"

#: mean curvature is coloured between minus and plus this, 1 / mm: gyri one way, sulci the other
CURVATURE = 0.3
COLOURS = "RdBu_r"
#: pixels of one view, and frames per second of the film
_VIEW, _RATE = (800, 640), 5
#: column -> label of its panel
_PANELS = {"min_j": "smallest J", "q_max": r"$q_\mathrm{max}$", "gyrification_index": "gyrification index"}

Image = NDArray[np.uint8]


def draw(folder: Path, hemisphere: str | None) -> list[Path]:
    """Draw everything there is to see of the run in a folder; returns the files made.

    Parameters
    ----------
    hemisphere : "L" or "R" is seen from its lateral side; a whole brain (None) as a left one
    """
    save(numbers(folder / TABLE), folder / NUMBERS)
    frames = series(folder / SERIES)
    before, after = frames[0], frames[-1]
    shown = views([path for path, _ in (before, after)], hemisphere)
    figure = side_by_side(list(shown), [before[1], after[1]])
    save(figure, folder / PICTURE)
    film(views([path for path, _ in frames], hemisphere), [age for _, age in frames], folder / FILM)
    return [folder / name for name in (NUMBERS, PICTURE, FILM)]


def series(path: Path) -> list[tuple[Path, float]]:
    """Frames of a run and their gestational ages, from its `.pvd` file."""
    try:
        entries = list(ElementTree.parse(path).iter("DataSet"))
    except (OSError, ElementTree.ParseError) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy="fold the mesh again") from error
    return [(path.parent / entry.attrib["file"], float(entry.attrib["timestep"])) for entry in entries]


def numbers(table: Path) -> Figure:
    """Smallest J, worst q and gyrification index against gestational age."""
    rows = read_tsv(table).apply(pd.to_numeric, errors="coerce")
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(PAGE, 2.2), layout="constrained")
        for axis, (column, label) in zip(figure.subplots(1, 3), _PANELS.items(), strict=True):
            axis.plot(rows["gestational_age"], rows[column], color=BLUE)
            axis.set(xlabel="gestational age (weeks)", ylabel=label)
            if column == "min_j":
                axis.axhline(0, color=VERMILION, linestyle="--", linewidth=0.8)
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure


def views(frames: list[Path], hemisphere: str | None) -> Iterator[Image]:
    """The surface of each frame from its side, coloured by mean curvature, all at the scale of the last one."""
    direction = np.array([1.0 if hemisphere == "R" else -1.0, 0.0, 0.0])
    surfaces = (_surface(vtu.read(path)) for path in frames)
    last = _surface(vtu.read(frames[-1]))
    focus = (last.points.min(axis=0) + last.points.max(axis=0)) / 2
    extent = np.ptp(last.points, axis=0)
    scale = 1.05 * max(extent[2], extent[1] * _VIEW[1] / _VIEW[0]) / 2
    for surface in surfaces:
        yield _view(surface, focus, direction, scale)


def _surface(mesh: TetMesh) -> TriSurface:
    return boundary_surface(mesh)[0]


def _view(surface: TriSurface, focus: FloatArray, direction: FloatArray, scale: float) -> Image:
    shell = pyvista.PolyData.from_regular_faces(surface.points, surface.faces)
    shell.point_data["curvature"] = shell.curvature("mean")
    with off_screen(_VIEW) as plotter:
        plotter.add_mesh(
            shell,
            scalars="curvature",
            cmap=COLOURS,
            clim=(-CURVATURE, CURVATURE),
            smooth_shading=True,
            split_sharp_edges=False,
            show_scalar_bar=False,
            ambient=0.25,
            specular=0.1,
        )
        distance = 10 * scale
        plotter.camera.position, plotter.camera.focal_point = focus + distance * direction, focus
        plotter.camera.up = (0, 0, 1)
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = scale
        plotter.camera.clipping_range = (0.1 * distance, 3 * distance)
        image: Image = plotter.screenshot(return_img=True)
    return image


def side_by_side(images: list[Image], ages: list[float]) -> Figure:
    """The surface before and after, at the same scale, and what the colours mean."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(PAGE, 3.1), layout="constrained")
        axes = figure.subplots(1, len(images))
        for axis, image, age in zip(axes, images, ages, strict=True):
            axis.imshow(image)
            axis.set_title(f"{age:.1f} weeks")
            axis.set_axis_off()
        norm = mpl.colors.Normalize(-CURVATURE, CURVATURE)
        figure.colorbar(
            mpl.cm.ScalarMappable(norm, COLOURS), ax=axes, shrink=0.6, aspect=30, label="mean curvature (1/mm)"
        )
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    return figure


def film(images: Iterator[Image], ages: list[float], path: Path) -> None:
    """Write an animated GIF, one image per gestational age, the last one held for a second."""
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
