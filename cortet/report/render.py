"""Pictures of meshes, drawn off screen without a display."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
import pyvista
from numpy.typing import NDArray
from PIL import Image

from cortet.errors import InputError, StageError
from cortet.formats import tags
from cortet.formats.atomic import atomic_path
from cortet.formats.surface_sets import interface_sets
from cortet.geometry.topology import boundary_surface, compact
from cortet.measure.quality import quality
from cortet.meshes import REGION, FloatArray, TetMesh, TriSurface
from cortet.report.colours import REGION_COLOURS

VERSION: int = 8

#: colours that colour-blind readers tell apart; worse elements are darker
COLOURS = "viridis_r"
#: q from 0 to the limit of a solver-ready mesh; worse elements get the colour beyond it
RANGE, BEYOND = (0.0, 0.6), "#D55E00"

#: a vertical bar at the left edge
SCALE = {
    "title": "$q$",
    "vertical": True,
    "position_x": 0.095,
    "position_y": 0.2,
    "height": 0.6,
    "width": 0.06,
    "n_labels": 4,
    "fmt": "%.1f",
    "color": "black",
}

#: margin around the mesh, and the share of the width beside the scale
MARGIN, ROOM = 1.05, 0.7

#: width or height of the largest picture, which graphics libraries limit
_MOST_PIXELS = 16384

Plane = Literal["x", "y", "z"]
View = Literal["left", "right", "front", "back", "top", "bottom"]
_AXES = {"x": 0, "y": 1, "z": 2}
#: side from which a mesh is seen -> axis and direction, in RAS coordinates
_VIEWS = {"left": (0, -1), "right": (0, 1), "back": (1, -1), "front": (1, 1), "bottom": (2, -1), "top": (2, 1)}

#: light that keeps colours readable and still shows the shape
_FLAT = {"ambient": 0.5, "diffuse": 0.5}
_EDGES = {"show_edges": True, "edge_color": "#303030", "line_width": 0.6, **_FLAT}
_BY_Q = {"scalars": "q", "cmap": COLOURS, "clim": RANGE, "above_color": BEYOND}
_GREY = {"color": "#D0D0D0", "ambient": 0.15, "diffuse": 0.85, "smooth_shading": True}
#: directions in a picture: along its width, its height and the view; lengths of scale bars, mm
_DIRECTIONS = (("on the left", "on the right"), ("down", "up"), ("away from you", "towards you"))
_BARS = (1, 2, 5, 10, 20, 50)
#: room for the words below a bar, a share of the height; their colour, which shows on white and on black
_BELOW, _INK = 0.09, "#767676"
#: letters of pictures that stand in figures, which have the same
_FONT = str(Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"))


def picture(
    mesh: TetMesh,
    path: str | Path,
    *,
    axis: Plane = "y",
    position: float = 0.5,
    view: View | None = None,
    regions: bool | None = None,
    size: tuple[int, int] = (1600, 1200),
) -> None:
    """Draw a mesh cut open, seen from the cut, with the plane, a scale bar and where anterior is.

    Every tetrahedron is whole. It has the colour of its region or of its q.

    Parameters
    ----------
    path : PNG file
    axis : axis across which the mesh is cut; in RAS coordinates y runs from the back to the front of the head
    position : position of the cut along `axis`, a fraction of the mesh's extent; 1 leaves nothing out
    view : side from which it is seen; None: from the cut, a little from above and beside
    regions : whether colours are those of regions (`REGION_COLOURS`) instead of q; None: where surfaces part them
    size : pixels, width and height
    """
    k = _AXES[axis]
    if regions is None:
        regions = REGION in mesh.cell_data and bool(interface_sets(mesh) or not mesh.sets.cells)
    if regions and REGION not in mesh.cell_data:
        raise InputError("the mesh has no regions", remedy="leave --region out")
    shell = _cut(mesh, k, position)
    along = mesh.points[:, k]
    where = f"cut at {axis} = {along.min() + position * np.ptp(along):.1f} mm".replace("-", "\N{MINUS SIGN}")
    with off_screen(size) as plotter:
        if regions:
            _add_regions(plotter, shell, names={number: name for name, number in tags.regions(mesh).items()})
        else:
            plotter.add_mesh(shell, **_BY_Q, **_EDGES, scalar_bar_args=SCALE)
        from_side: Any = {"above": 0.0, "beside": 0.0} if view else {}
        across, towards = _VIEWS[view] if view else (k, 1)
        said = where if position < 1 else ""
        _frame(plotter, np.asarray(shell.points, float), across, towards, said, room=ROOM, **from_side)
        with atomic_path(path) as temporary:
            plotter.screenshot(temporary)


def _frame(
    plotter: pyvista.Plotter,
    points: FloatArray,
    across: int,
    towards: float,
    said: str = "",
    *,
    room: float = 1.0,
    font: str | None = None,
    **aim: float,
) -> None:
    """Fill a share `room` of the width with points, as `_aim` sees them; below stand a scale bar and directions."""
    width, height = plotter.window_size
    frame, camera = _seen_from(across, towards, **aim), plotter.camera
    bar = _bar(points, frame)
    below = bar - _BELOW * np.ptp(points @ frame[1]) * frame[1]
    _aim(camera, np.concatenate([points, bar, below]), frame, width_to_height=room * width / height)
    plotter.add_lines(bar, color=_INK, width=max(height // 150, 2))
    right, above, _ = (bar.mean(axis=0) - camera.focal_point) @ _axes(camera).T / (2 * camera.parallel_scale)
    lines = [f"{np.linalg.norm(bar[1] - bar[0]):.3g} mm", ", ".join(_directions(camera)), said]
    text = plotter.add_text(
        "\n".join(filter(None, lines)),
        position=(0.5 + right * height / width, 0.49 + above),
        viewport=True,
        font_size=max(height // 80, 5),
        font_file=font,
        color=_INK,
    )
    text.prop.justification_horizontal, text.prop.justification_vertical = "center", "top"


def _bar(points: FloatArray, frame: FloatArray) -> FloatArray:
    """Ends of a horizontal scale bar (2, 3) below points and before all of them, in the picture with these axes."""
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    wide, tall, _ = high - low
    length = max((bar for bar in _BARS if 4 * bar <= wide), default=wide / 4)
    middle = np.array([(low[0] + high[0]) / 2, low[1] - 0.03 * tall, high[2]])
    ends: FloatArray = (middle + np.outer([-length / 2, length / 2], [1, 0, 0])) @ frame
    return ends


def _up(across: int) -> int:
    """The axis that points up in a picture seen along the axis `across`."""
    return 1 if across == 2 else 2


def _directions(camera: pyvista.Camera) -> list[str]:
    """Where anterior, superior and left are in a picture, RAS coordinates: ``anterior towards you``."""
    frame, found = _axes(camera), []
    for name, axis, sign in (("anterior", 1, 1), ("superior", 2, 1), ("left", 0, -1)):
        seen = sign * frame[:, axis]
        most = int(np.abs(seen).argmax())
        found.append(f"{name} {_DIRECTIONS[most][int(seen[most] > 0)]}")
    return found


def _axes(camera: pyvista.Camera) -> FloatArray:
    """Unit vectors to the right, upwards and towards the viewer: (3, 3)."""
    towards = np.subtract(camera.position, camera.focal_point)
    right = np.cross(camera.up, towards)
    return np.stack([axis / np.linalg.norm(axis) for axis in (right, np.cross(towards, right), towards)])


def cut_view(mesh: TetMesh, *, regions: bool = False, size: tuple[int, int] = (1200, 900)) -> NDArray[np.uint8]:
    """Draw a mesh cut open at the middle of y, without a legend: (height, width, 4), transparent around the mesh.

    Parameters
    ----------
    regions : each tetrahedron has the colour of its region (`REGION_COLOURS`), not that of its q
    """
    shell = _cut(mesh, _AXES["y"], 0.5)
    with off_screen(size) as plotter:
        if regions:
            _add_regions(plotter, shell)
        else:
            plotter.add_mesh(shell, **_BY_Q, **_EDGES, show_scalar_bar=False)
        _frame(plotter, np.asarray(shell.points, float), _AXES["y"], 1)
        return _cut_out(plotter)


def surface_view(
    surface: TriSurface,
    *,
    side: Literal["L", "R"],
    size: tuple[int, int] = (900, 675),
    values: FloatArray | None = None,
    limits: tuple[float, float] = (0.0, 1.0),
    colours: str = "Greys",
    framed: bool = True,
) -> NDArray[np.uint8]:
    """Draw a surface from the left or the right of the head; open and branching edges are drawn over it.

    Parameters
    ----------
    surface : RAS coordinates, x to the right; it need not be closed
    side : side from which it is seen
    size : pixels, width and height
    values : (m,) one per face, which colours the faces; None: the surface is grey
    limits : values of the first and the last colour
    colours : name of a colour map of Matplotlib
    framed : whether a scale bar and the directions stand below the surface

    Returns
    -------
    (height, width, 4), transparent around the surface
    """
    shape = pyvista.PolyData.from_regular_faces(surface.points, surface.faces)
    wrong = shape.extract_feature_edges(
        boundary_edges=True, non_manifold_edges=True, feature_edges=False, manifold_edges=False
    )
    with off_screen(size) as plotter:
        if values is None:
            plotter.add_mesh(shape, **_GREY)
        else:
            plotter.add_mesh(shape, scalars=values, cmap=colours, clim=limits, show_scalar_bar=False, **_FLAT)
        if wrong.n_points:
            plotter.add_mesh(wrong, color=BEYOND, line_width=4, lighting=False)
        look: Any = {"across": 0, "towards": _towards(side), "above": 0.0, "beside": 0.0}
        if framed:
            _frame(plotter, surface.points, font=_FONT, **look)
        else:
            _aim(plotter.camera, surface.points, _seen_from(**look), width_to_height=size[0] / size[1])
        return _cut_out(plotter)


def _towards(side: Literal["L", "R"]) -> float:
    """Direction along x from which a side of the head is seen."""
    return -1.0 if side == "L" else 1.0


def webp(image: NDArray[np.uint8]) -> bytes:
    """A picture as a WebP file, which keeps transparency in a fifth of the bytes of a PNG."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, "webp", quality=85, method=2)  # the default of 4 takes twice as long for 2 %
    return file.getvalue()


@contextmanager
def off_screen(size: tuple[int, int]) -> Iterator[pyvista.Plotter]:
    """A white picture of `size` pixels to draw in, without a display."""
    sides = size if isinstance(size, tuple | list) and len(size) == 2 else [0]
    if not all(isinstance(pixels, int | np.integer) and 1 <= pixels <= _MOST_PIXELS for pixels in sides):
        what = f"a picture of {size!r} pixels cannot be drawn"
        raise InputError(what, remedy=f"give width and height, whole numbers from 1 to {_MOST_PIXELS}")
    try:
        with pyvista.vtk_verbosity("error"):  # without a display VTK first warns, then draws without one
            plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
            plotter.render()
        plotter.set_background("white")
        yield plotter
        plotter.close()
    except RuntimeError as error:
        raise StageError(f"cannot draw the picture: {error}", remedy="install libegl1 or libosmesa6") from error


def lateral_view(
    mesh: TetMesh, *, side: Literal["L", "R"], cut: bool, half_width: float, half_height: float, width: int
) -> NDArray[np.uint8]:
    """A mesh in parallel projection from the left or the right of the head: (height, width, 3), white around it.

    Parameters
    ----------
    mesh : RAS coordinates, x to the right and y to the front of the head
    side : side from which it is seen
    cut : leave out the half towards the viewer and colour elements by q; else draw the grey surface
    half_width, half_height : mm from the middle of the mesh to the edges of the picture
    width : pixels
    """
    towards = _towards(side)
    middle = (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2
    if cut:
        beyond = towards * (mesh.points[mesh.cells][:, :, 0].mean(axis=1) - middle[0]) < 0
        shell, look = _skin(mesh, beyond), {**_BY_Q, "ambient": 0.6, "diffuse": 0.4}
    else:
        boundary, _ = boundary_surface(mesh)
        shell, look = pyvista.PolyData.from_regular_faces(boundary.points, boundary.faces), _GREY
    corners = middle + np.array([[0, -half_width, -half_height], [0, half_width, half_height]]) / MARGIN
    shape = half_width / half_height
    with off_screen((width, round(width / shape))) as plotter:
        plotter.add_mesh(shell, show_scalar_bar=False, **look)
        _aim(plotter.camera, corners, _seen_from(0, towards, above=0, beside=0), width_to_height=shape)
        image: NDArray[np.uint8] = plotter.screenshot(None, return_img=True)
    return image


def _add_regions(plotter: pyvista.Plotter, shell: pyvista.PolyData, *, names: Mapping[int, str] | None = None) -> None:
    """Draw the faces of each region in its colour, with a legend of their names by number, if these are given."""
    number = np.asarray(shell.cell_data[REGION])
    for one in np.unique(number).tolist():
        colour = REGION_COLOURS[(one - 1) % len(REGION_COLOURS)]
        label = {"label": names[one]} if names else {}
        plotter.add_mesh(shell.extract_cells(number == one), color=colour, **label, **_EDGES)
    if names:
        plotter.add_legend(bcolor=None, face="rectangle", loc="center left", size=(0.11, 0.1))


def _cut_out(plotter: pyvista.Plotter) -> NDArray[np.uint8]:
    """The drawing, without its background and without the empty rows and columns around it."""
    image: NDArray[np.uint8] = plotter.screenshot(None, transparent_background=True, return_img=True)
    drawn = image[:, :, 3] > 0
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    if not len(rows):
        return image
    return np.ascontiguousarray(image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1])


def _cut(mesh: TetMesh, k: int, position: float) -> pyvista.PolyData:
    """The outer faces of the elements below a plane across axis k, at a fraction of the mesh's extent."""
    along = mesh.points[:, k]
    return _skin(mesh, along[mesh.cells].mean(axis=1) < along.min() + position * np.ptp(along))


def _skin(mesh: TetMesh, kept: NDArray[np.bool_]) -> pyvista.PolyData:
    """The outer faces of some of the elements; faces carry the q of their tetrahedron."""
    if not kept.any():
        raise InputError("no tetrahedron lies behind the cut", remedy="give a larger position")
    points, cells, _ = compact(mesh.points, mesh.cells[kept])
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, points)
    grid.cell_data["q"] = quality(points, cells)
    if REGION in mesh.cell_data:
        grid.cell_data[REGION] = mesh.cell_data[REGION][kept]
    return grid.extract_surface(algorithm="dataset_surface")


def _seen_from(across: int, towards: float = 1.0, *, above: float = 0.3, beside: float = 0.4) -> FloatArray:
    """Unit vectors right, up and towards a viewer who looks along an axis from above and beside: (3, 3)."""
    up, along = np.eye(3)[_up(across)], towards * np.eye(3)[across]
    view = along + above * up - beside * np.cross(up, along)
    view /= np.linalg.norm(view)
    right = np.cross(up, view) / np.linalg.norm(np.cross(up, view))
    return np.stack([right, np.cross(view, right), view])


def _aim(camera: pyvista.Camera, points: FloatArray, frame: FloatArray, *, width_to_height: float) -> None:
    """Fill the picture with points, as seen with the axes `frame`, from `_seen_from`."""
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    focus, extent = (low + high) / 2 @ frame, high - low
    camera.position, camera.focal_point, camera.up = focus + 2 * extent.max() * frame[2], focus, frame[1]
    camera.parallel_projection = True
    camera.parallel_scale = MARGIN * max(extent[1], extent[0] / width_to_height) / 2
    camera.clipping_range = (0.1 * extent.max(), 4 * extent.max())
