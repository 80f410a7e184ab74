"""The pictures by which people check a mesh: plane sections through its tetrahedra, alone or over an image."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cortet.formats.atomic import atomic_path
from cortet.formats.volumes import Volume, to_scanner
from cortet.geometry.voxels import in_voxels
from cortet.meshes import REGION, CoordinateFrame, FloatArray, IntArray, TetMesh
from cortet.report.colours import GREY, REGION_COLOURS, VERMILION

VERSION: int = 3

#: planes by name: the axis across them, and the axes that run right and up in the picture
PLANES = {"sagittal": (0, 1, 2), "coronal": (1, 0, 2), "axial": (2, 0, 1)}
#: what stands at the axes of a picture, RAS coordinates
_AXES = (
    "left \u2190 x (mm) \u2192 right",
    "posterior \u2190 y (mm) \u2192 anterior",
    "inferior \u2190 z (mm) \u2192 superior",
)
#: margin around the mesh, mm; samples of the image per voxel; how pale its labels are, and how dark edges of the mesh
_MARGIN, _SAMPLES, _PALE, _DARK = 3.0, 2, 0.45, 0.6
#: pixels per inch; inches of one slice, and of a section alone
_DPI, _INCHES, _SECTION = 150, 6.0, 4.5
#: left, bottom, width and height of the axes of a section, fractions of its figure
_IN_FIGURE = (0.13, 0.11, 0.85, 0.87)
#: width of the edges in a section, points
_LINE = 0.25


def slices(mesh: TetMesh, name: str, volume: Volume, path: str | Path, frame: CoordinateFrame | None = None) -> None:
    """Draw the image in three planes through the middle of the mesh, each with the cut through its tetrahedra.

    Edges of the cut have the colour of their label, and labels of the image a paler one; numbers are grey.

    Parameters
    ----------
    mesh : with the cell field of the volume (`solver_files.volumes.with_volumes`)
    name : of the volume
    path : PNG file
    frame : of the surface that the mesh was made from
    """
    from cortet.report.figures import letter  # the module loads pandas, which no job on a case needs

    points = to_scanner(mesh.points, frame or CoordinateFrame())
    labelled = volume.kind == "labels"
    keys = np.unique(mesh.cell_data[name]).tolist() if labelled else []
    labels = mesh.cell_data[name] if labelled else np.zeros(len(mesh.cells), int)
    colours = _colours(keys) if labelled else {0: np.array(to_rgb(VERMILION))}
    low, high = points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN
    middle = (low + high) / 2
    widths = [(high - low)[right] / (high - low)[up] for _, right, up in PLANES.values()]
    figure = Figure(figsize=(_INCHES * sum(widths) + 3, _INCHES + 1.2), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    panes = zip(figure.subplots(1, 3, width_ratios=widths), PLANES.items(), strict=True)
    for axes, (title, (across, right, up)) in panes:
        plane = _image(volume, low, high, middle, (across, right, up))
        extent = (low[right], high[right], low[up], high[up])
        if labelled:
            axes.imshow(_painted(plane, colours), extent=extent, origin="lower", interpolation="nearest")
        else:
            axes.imshow(plane, extent=extent, origin="lower", interpolation="nearest", cmap="gray")
        polygons, cell = cut(points, mesh.cells, across, float(middle[across]))
        flat = polygons[:, :, [right, up]]
        lines = [_DARK * colours[key] for key in labels[cell].tolist()]
        axes.add_collection(_drawn(flat, facecolors="none", edgecolors=lines, linewidths=0.5))
        axes.set_title(f"{title}, {where(across, middle[across])}")
        axes.set(xlabel=_AXES[right], ylabel=_AXES[up])
        axes.set_facecolor("white" if labelled else "black")
    letter(figure.axes, size=14)
    shown = [Patch(color=colours[key], label=volume.names.get(key, str(key) if key else "no label")) for key in keys]
    if shown:
        figure.legend(handles=shown[:20], loc="outside lower center", ncols=10, frameon=False)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", bbox_inches="tight", metadata={"Software": None})


def where(across: int, position: float) -> str:
    """The plane of a section: ``y = -3.0 mm``, with a true minus sign."""
    return f"{'xyz'[across]} = {position:.1f} mm".replace("-", "\N{MINUS SIGN}")


def middle_of(mesh: TetMesh, plane: str) -> float:
    """Position of a plane of `PLANES` through the middle of a mesh, mm."""
    along = mesh.points[:, PLANES[plane][0]]
    return float(along.min() + along.max()) / 2


def draw_section(axes: Axes, mesh: TetMesh, plane: str, position: float, colours: FloatArray | None = None) -> None:
    """Draw the section of a mesh by a plane of `PLANES`; axes in mm.

    Parameters
    ----------
    colours : (m, 3) of tetrahedra; None: those of their regions
    """
    across, right, up = PLANES[plane]
    polygons, cell = cut(mesh.points, mesh.cells, across, position)
    flat = polygons[:, :, [right, up]]
    fill = (_of_regions(mesh) if colours is None else colours)[cell]
    axes.add_collection(_drawn(flat, facecolors=fill, edgecolors=_DARK * fill, linewidths=_LINE))
    axes.autoscale_view()
    axes.set(aspect="equal", xlabel=_AXES[right], ylabel=_AXES[up])


def _drawn(polygons: FloatArray, **look: Any) -> PolyCollection:
    """Polygons (k, 4, 2) for an axis."""
    return PolyCollection(polygons, **look)  # type: ignore[arg-type]  # of one array it makes paths three times as fast


def _of_regions(mesh: TetMesh) -> FloatArray:
    """The colour of each tetrahedron by its region: (m, 3)."""
    if REGION not in mesh.cell_data:
        return np.tile(to_rgb(GREY), (len(mesh.cells), 1))
    fills = np.array([to_rgb(colour) for colour in REGION_COLOURS])
    return fills[(np.asarray(mesh.cell_data[REGION], int) - 1) % len(fills)]


def section(mesh: TetMesh, plane: str, position: float, colours: FloatArray | None = None) -> NDArray[np.uint8]:
    """The picture of a section, as `draw_section` draws it: (height, width, 4)."""
    figure = Figure(figsize=(_SECTION, _SECTION), dpi=_DPI)
    canvas = FigureCanvasAgg(figure)
    # with room for the numbers and names of two axes; to measure these takes longer than to draw them
    draw_section(figure.add_axes(_IN_FIGURE), mesh, plane, position, colours)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def cut(points: FloatArray, cells: IntArray, axis: int, position: float) -> tuple[FloatArray, NDArray[Any]]:
    """Polygons in which a plane across an axis cuts tetrahedra: (k, 4, 3), and the tetrahedron of each.

    The last corner of a triangle comes twice.
    """
    import pyvista  # loads VTK, which a module of pages need not

    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, points)
    grid.cell_data["cell"] = np.arange(len(cells))
    found = grid.slice(normal="xyz"[axis], origin=np.full(3, position))
    corners = [polygon[[0, 1, 2, -1]] for polygon in found.irregular_faces]
    return np.asarray(found.points)[np.array(corners, int).reshape(-1, 4)], np.asarray(found.cell_data["cell"])


def _image(
    volume: Volume, low: FloatArray, high: FloatArray, middle: FloatArray, axes: tuple[int, int, int]
) -> NDArray[Any]:
    """The voxels on a plane, rows upward; 0 outside the volume. Of tensors it is the mean of the eigenvalues."""
    across, right, up = axes
    step = volume.voxel / _SAMPLES
    along = [np.arange(low[axis] + step / 2, high[axis], step) for axis in (right, up)]
    grid = np.empty((len(along[1]), len(along[0]), 3))
    grid[..., right], grid[..., up], grid[..., across] = along[0], along[1][:, None], middle[across]
    values = volume.values if volume.values.ndim == 3 else np.nan_to_num(volume.values[..., :3]).mean(axis=-1)
    where = np.rint(in_voxels(volume.affine, grid.reshape(-1, 3))).astype(int)
    within = ((where >= 0) & (where < values.shape)).all(axis=1)
    found = np.zeros(len(where), values.dtype)
    found[within] = values[tuple(where[within].T)]
    return found.reshape(grid.shape[:2])


def _colours(keys: list[int]) -> dict[int, FloatArray]:
    """The colour (3,) of each label; 0 is grey."""
    others = [key for key in keys if key]
    names = {0: "#999999"} | {key: REGION_COLOURS[i % len(REGION_COLOURS)] for i, key in enumerate(others)}
    return {key: np.array(to_rgb(name)) for key, name in names.items()}


def _painted(plane: NDArray[Any], colours: Mapping[int, FloatArray]) -> FloatArray:
    """Labels as pale colours (rows, columns, 3); white without a label, light grey for labels that the mesh lacks."""
    result = np.full((*plane.shape, 3), 1.0)
    result[plane != 0] = 0.85
    for key, colour in colours.items():
        if key:
            result[plane == key] = 1 - _PALE * (1 - colour)
    return result
