"""Pictures of meshes, drawn off screen: no display is needed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
import pyvista
from numpy.typing import NDArray

from cortet.errors import StageError
from cortet.formats.atomic import atomic_path
from cortet.mesh import FloatArray, TetMesh
from cortet.quality import quality
from cortet.topology import boundary_surface, compact

VERSION: int = 1

#: colour-blind safe, and as dark as it is bad
COLOURS = "viridis_r"
#: q from 0 to the limit of a solver-ready mesh; worse elements get the colour beyond it
RANGE, BEYOND = (0.0, 0.6), "#D55E00"

#: a vertical bar at the left edge
SCALE = {
    "title": "q",
    "vertical": True,
    "position_x": 0.07,
    "position_y": 0.2,
    "height": 0.6,
    "width": 0.06,
    "n_labels": 4,
    "fmt": "%.1f",
    "color": "black",
}

#: white around the mesh, and the part of the width that the scale leaves to it
MARGIN, ROOM = 1.05, 0.7

_AXES = {"x": 0, "y": 1, "z": 2}


def picture(
    mesh: TetMesh,
    path: str | Path,
    *,
    axis: Literal["x", "y", "z"] = "y",
    position: float = 0.5,
    size: tuple[int, int] = (1600, 1200),
) -> None:
    """Draw a mesh cut open, every tetrahedron whole and coloured by its q, seen from the cut.

    Parameters
    ----------
    path : PNG file
    axis : the cut is across it; in RAS coordinates y runs from the back to the front of the head
    position : of the cut along `axis`, as a fraction of the mesh's extent
    size : pixels, width and height

    Raises
    ------
    StageError
        the graphics library cannot draw here
    """
    k = _AXES[axis]
    along = mesh.points[:, k]
    shell = _skin(mesh, along[mesh.cells].mean(axis=1) < along.min() + position * np.ptp(along))
    with off_screen(size) as plotter:
        plotter.add_mesh(
            shell,
            scalars="q",
            cmap=COLOURS,
            clim=RANGE,
            above_color=BEYOND,
            show_edges=True,
            edge_color="#303030",
            line_width=0.6,
            ambient=0.5,
            diffuse=0.5,
            scalar_bar_args=SCALE,
        )
        _aim(plotter.camera, np.asarray(shell.points, float), k, width_to_height=size[0] / size[1])
        with atomic_path(path) as temporary:
            plotter.screenshot(temporary)


@contextmanager
def off_screen(size: tuple[int, int]) -> Iterator[pyvista.Plotter]:
    """A white picture of `size` pixels to draw in, without a display.

    Raises
    ------
    StageError
        the graphics library cannot draw here
    """
    try:
        with pyvista.vtk_verbosity("error"):  # without a display VTK first warns, then draws without one
            plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
            plotter.render()
        plotter.set_background("white")
        yield plotter
        plotter.close()
    except RuntimeError as error:
        raise StageError(f"the picture could not be drawn: {error}", remedy="install libegl1 or libosmesa6") from error


def lateral_view(
    mesh: TetMesh, *, side: Literal["L", "R"], cut: bool, half_width: float, half_height: float, width: int
) -> NDArray[np.uint8]:
    """A mesh in parallel projection from the left or the right of the head: (height, width, 3), white around it.

    Parameters
    ----------
    mesh : RAS coordinates, x to the right and y to the front of the head
    side : where it is seen from
    cut : leave out the half towards the viewer and colour elements by q; else the grey surface
    half_width, half_height : mm from the middle of the mesh to the edges of the picture
    width : pixels

    Raises
    ------
    StageError
        the graphics library cannot draw here
    """
    towards = -1.0 if side == "L" else 1.0
    middle = (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2
    shell = _section(mesh, towards, middle[0]) if cut else _surface(mesh)
    look = {"scalars": "q", "cmap": COLOURS, "clim": RANGE, "above_color": BEYOND} if cut else {"color": "#D0D0D0"}
    light = {"ambient": 0.6, "diffuse": 0.4} if cut else {"ambient": 0.15, "diffuse": 0.85, "smooth_shading": True}
    with off_screen((width, round(width * half_height / half_width))) as plotter:
        plotter.add_mesh(shell, show_scalar_bar=False, **look, **light)
        distance = 10 * max(half_width, half_height)
        camera = plotter.camera
        camera.position = middle + towards * distance * np.eye(3)[0]
        camera.focal_point, camera.up = middle, (0, 0, 1)
        camera.parallel_projection, camera.parallel_scale = True, half_height
        camera.clipping_range = (0.1 * distance, 2 * distance)
        image: NDArray[np.uint8] = plotter.screenshot(None, return_img=True)
    return image


def _surface(mesh: TetMesh) -> pyvista.PolyData:
    boundary, _ = boundary_surface(mesh)
    return pyvista.PolyData.from_regular_faces(boundary.points, boundary.faces)


def _section(mesh: TetMesh, towards: float, x: float) -> pyvista.PolyData:
    """The skin of the elements beyond a plane across x, with the q of its elements."""
    beyond = towards * (mesh.points[mesh.cells][:, :, 0].mean(axis=1) - x) < 0
    return _skin(mesh, beyond)


def _skin(mesh: TetMesh, kept: NDArray[np.bool_]) -> pyvista.PolyData:
    """The skin of some of the elements; faces carry the q of their tetrahedron."""
    points, cells, _ = compact(mesh.points, mesh.cells[kept])
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: cells}, points)
    grid.cell_data["q"] = quality(points, cells)
    return grid.extract_surface(algorithm="dataset_surface")


def _aim(camera: pyvista.Camera, points: FloatArray, k: int, *, width_to_height: float) -> None:
    """Look at a cut across axis k from its open side, a little from above and beside, and fill the picture."""
    up = np.eye(3)[1 if k == 2 else 2]
    view = np.eye(3)[k] + 0.3 * up - 0.4 * np.cross(up, np.eye(3)[k])
    view /= np.linalg.norm(view)
    right = np.cross(up, view) / np.linalg.norm(np.cross(up, view))
    frame = np.stack([right, np.cross(view, right), view])  # rows: right, up, towards the camera
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    focus, extent = (low + high) / 2 @ frame, high - low
    camera.position, camera.focal_point, camera.up = focus + 2 * extent.max() * view, focus, up
    camera.parallel_projection = True
    camera.parallel_scale = MARGIN * max(extent[1], extent[0] / (width_to_height * ROOM)) / 2
    camera.clipping_range = (0.1 * extent.max(), 4 * extent.max())
