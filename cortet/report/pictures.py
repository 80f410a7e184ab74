"""Pictures of surfaces and meshes with their captions, as parts of a page."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Literal

import matplotlib.image
import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from cortet.errors import StageError
from cortet.geometry.mending import measurable
from cortet.geometry.topology import boundary_surface, sheet, surface_topology
from cortet.measure.layers import cortical_layers
from cortet.measure.lost import distances_to
from cortet.meshes import REGION, FloatArray, TetMesh, TriSurface
from cortet.report import pages
from cortet.report.boundary_view import colour_scale
from cortet.report.colours import COLOUR_NAMES, LIGHT_GREY
from cortet.report.pages import SIDES
from cortet.report.render import cut_view, surface_view, webp
from cortet.report.slices import PLANES, middle_of, section, where

Picture = dict[str, Any]

#: pixels of a thumbnail, width and height: twice those on the page, for fine screens
_THUMBNAIL = (192, 144)
#: mm, distance that rounding of coordinates may make, so that it is not shown in the darkest red
_ROUNDED = 0.01


def captioned(image: NDArray[Any], caption: str, more: str = "", *, scaled: bool = False) -> Picture:
    """A picture (rows, columns, 4) for a page; its caption is also the text for screen readers.

    Below it stands the scale of q if it is `scaled`.
    """
    height, width, _ = image.shape
    text = f"{caption}, {more}" if more else caption
    uri = pages.data_uri(webp(image))
    scale = {"scale": colour_scale()} if scaled else {}
    return {"uri": uri, "width": width, "height": height, "caption": text, "alt": text, **scale}


def png(path: Path) -> NDArray[Any]:
    """The pixels of a PNG file: (rows, columns, 4)."""
    return np.asarray(np.round(255 * matplotlib.image.imread(path)), np.uint8)


def shown(draw: Callable[[], list[Picture]]) -> list[pages.Part]:
    """Pictures as a part of a page; a note if they cannot be drawn."""
    try:
        return [("pictures", draw())]
    except StageError as error:
        return [("note", f"Pictures are missing: {error}")]


def thumbnail(surface: TriSurface | None, hemi: Literal["L", "R"] | None) -> bytes:
    """A small WebP picture of a surface from the outer side of its hemisphere; empty if it cannot be drawn."""
    image = np.zeros((*_THUMBNAIL[::-1], 4), np.uint8)
    if surface is not None and len((drawable := measurable(surface)).faces):
        with contextlib.suppress(StageError):
            image = surface_view(drawable, side=hemi or "L", size=_THUMBNAIL, framed=False)
    return webp(image)


def of_input(surface: TriSurface) -> list[Picture]:
    """The surface of the file from both sides."""
    topology = surface_topology(surface.faces)
    wrong = "open or branching edges in orange" if topology.open_edges + topology.nonmanifold_edges else ""
    return [
        captioned(surface_view(surface, side=side), f"Input surface from the {word}, anterior {word}", wrong)
        for side, word in SIDES.items()
    ]


def of_mesh(mesh: TetMesh, meshed: TriSurface) -> list[Picture]:
    """The mesh cut open, and the surfaces that were meshed in the colours of their distance to it."""
    cut = captioned(cut_view(mesh), "Mesh, cut open halfway to the front", "tetrahedra coloured by q", scaled=True)
    boundary, _ = boundary_surface(mesh)
    return [cut, *_of_inner(mesh, meshed), *_by_distance(meshed, boundary, "Meshed surface", "the mesh")]


def of_sections(mesh: TetMesh, names: list[str]) -> list[Picture]:
    """Sections through the middle of the mesh, its regions in colours; names are those of the regions, if several."""
    named = ", ".join(f"{name} {COLOUR_NAMES[number % len(COLOUR_NAMES)]}" for number, name in enumerate(names))
    regions = f"; {named}" if len(names) > 1 else ""
    shown = []
    for plane, (across, _, _) in PLANES.items():
        position = middle_of(mesh, plane)
        caption = f"{plane.capitalize()}, {where(across, position)}{regions}"
        shown.append(captioned(section(mesh, plane, position), caption))
    return shown


def of_layers(mesh: TetMesh, inner: Iterable[str], bounds: FloatArray) -> list[Picture]:
    """The coronal section through the middle of the mesh, its tetrahedra in the colours of their layers."""
    number = cortical_layers(mesh, inner, bounds).number
    layers = colormaps["viridis_r"](np.linspace(0, 1, len(bounds) - 1))[:, :3]
    colours = np.vstack([to_rgb(LIGHT_GREY), layers])[number]
    position = middle_of(mesh, "coronal")
    last = f", layer {len(layers)} violet" if len(layers) > 1 else ""
    caption = f"Coronal, {where(PLANES['coronal'][0], position)}; layer 1 yellow{last}, the rest grey"
    return [captioned(section(mesh, "coronal", position, colours), caption)]


def _of_inner(mesh: TetMesh, meshed: TriSurface) -> list[Picture]:
    """Each inner surface in the colours of its distance to its interface."""
    if not meshed.inner or REGION not in mesh.cell_data:
        return []
    return [
        picture
        for number, (name, inner) in enumerate(meshed.inner.items(), start=1)
        for picture in _by_distance(inner, sheet(mesh, number)[0], f"Inner surface {name}", "the interface")
    ]


def of_repair(file: TriSurface, repaired: TriSurface) -> list[Picture]:
    """The repaired surface, in the colours of its distance to the surface of the file."""
    return _by_distance(repaired, file, "Meshed surface", "the file", red=True)


def _by_distance(surface: TriSurface, to: TriSurface, what: str, other: str, *, red: bool = False) -> list[Picture]:
    """A surface from both sides, each face in the colour of its distance to another surface."""
    distances: FloatArray = distances_to(to, surface)[len(surface.points) :]
    darkest = float(distances.max())
    if red:
        darkest = max(darkest, _ROUNDED)
    scale = f"coloured by its distance to {other}, white at 0, {'red' if red else 'black'} at {darkest:.2g} mm"
    colours = "Reds" if red else "Greys"
    return [
        captioned(
            surface_view(surface, side=side, values=distances, limits=(0.0, darkest), colours=colours),
            f"{what}, seen from the {word}",
            scale,
        )
        for side, word in SIDES.items()
    ]
