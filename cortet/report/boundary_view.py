"""The boundary of a mesh in three dimensions, coloured by the worst q around each vertex, for a page."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pyvista
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cortet.geometry.topology import boundary_surface
from cortet.measure.quality import quality
from cortet.meshes import FloatArray, TetMesh, TriSurface
from cortet.report.render import BEYOND, COLOURS, RANGE

#: most faces in a page; a finer boundary is simplified. 60,000 faces are 0.7 MB
MAX_FACES = 60_000
#: colours between which the page interpolates
_STOPS = 25


def boundary_view(
    mesh: TetMesh, worst_elements: Sequence[Mapping[str, Any]], *, max_faces: int = MAX_FACES
) -> dict[str, Any]:
    """What `templates/view.js` draws, ready for JSON; arrays are little-endian, in base64.

    Parameters
    ----------
    mesh : coordinates in mm, x to the right, y to the front, z up
    worst_elements : `q` and `centre_mm` of the elements to mark
    max_faces : a boundary with more faces is simplified; the worst q stay in their locations

    Returns
    -------
    points : (n, 3) uint16, `low` + `step` * points are mm
    faces : (m, 3) unsigned, of `index_bytes` each
    q : (n,) uint16, worst q of the tetrahedra at a vertex, times 65535
    """
    boundary, nodes = boundary_surface(mesh)
    worst = _worst_around(mesh)[nodes]
    shown = boundary if len(boundary.faces) <= max_faces else _simplified(boundary, max_faces)
    if shown is not boundary:
        worst = _carried(boundary.points, worst, shown.points)
    low, extent = shown.points.min(axis=0), float(np.ptp(shown.points, axis=0).max())
    index = np.dtype("<u2" if len(shown.points) <= 1 << 16 else "<u4")
    return {
        "points": _packed(np.round((shown.points - low) * (65535 / extent)), "<u2"),
        "low": low.round(4).tolist(),
        "step": extent / 65535,
        "faces": _packed(shown.faces, index.str),
        "index_bytes": index.itemsize,
        "q": _packed(np.round(worst * 65535), "<u2"),
        **colour_scale(),
        "range": list(RANGE),
        "worst": [{"q": element["q"], "centre": list(element["centre_mm"])} for element in worst_elements],
        "face_count": len(shown.faces),
        "boundary_faces": len(boundary.faces),
    }


def colour_scale() -> dict[str, Any]:
    """RGB, 0 to 255: `colours` of q, evenly spaced over `render.RANGE`, and `beyond`, the colour of worse elements."""
    stops = mpl.colormaps[COLOURS](np.linspace(0, 1, _STOPS))
    return {"colours": [_rgb(colour) for colour in stops], "beyond": _rgb(BEYOND)}


def _worst_around(mesh: TetMesh) -> FloatArray:
    """Largest q of the tetrahedra at each node: (n,)."""
    worst = np.zeros(len(mesh.points))
    np.maximum.at(worst, mesh.cells, quality(mesh.points, mesh.cells)[:, None])
    return worst


def _simplified(surface: TriSurface, faces: int) -> TriSurface:
    """Fewer faces by quadric error metrics (Garland and Heckbert 1997, in VTK)."""
    shape = pyvista.PolyData.from_regular_faces(surface.points, surface.faces)
    fewer = shape.decimate(1 - faces / len(surface.faces))
    return TriSurface(np.asarray(fewer.points, float), fewer.regular_faces)


def _carried(points: FloatArray, values: FloatArray, targets: FloatArray) -> FloatArray:
    """Values at targets: the largest of the nearest point's value and those of all points nearest to the target."""
    carried = values[cKDTree(points).query(targets)[1]]
    np.maximum.at(carried, cKDTree(targets).query(points)[1], values)
    return carried


def _packed(array: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array).astype(dtype).tobytes()).decode()


def _rgb(colour: Any) -> list[int]:
    return [round(255 * part) for part in mpl.colors.to_rgb(colour)]
