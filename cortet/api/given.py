"""Inputs of a caller: surfaces, fields and settings in memory or as files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cortet.config import load, read
from cortet.errors import InputError
from cortet.formats.gifti import read_surface, require_anatomical, surface_of
from cortet.geometry.kernel_cache import require_threads
from cortet.geometry.limits import NAME
from cortet.meshes import TriSurface

#: a file of any readable format, `TriSurface`, NiBabel's `GiftiImage`, PyVista's `PolyData`, trimesh's `Trimesh`,
#: or vertices (n, 3) in mm and faces (m, 3)
SurfaceLike = Any
#: a file, or keys of the configuration by section
Settings = str | Path | Mapping[str, Any]


def values_of(given: ArrayLike, what: str = "values") -> NDArray[Any]:
    """Numbers or labels, one or several for each place: (n,) or (n, k); masked numbers are NaN."""
    if np.ma.is_masked(given) and np.ma.asarray(given).dtype.kind in "biuf":
        given = np.ma.filled(np.ma.asarray(given).astype(np.float64), np.nan)
    try:
        values = np.asarray(given)
        values = values.astype(np.float64) if values.dtype == object else values
    except (TypeError, ValueError) as error:  # rows of several lengths, no numbers, or masked labels
        what = f"{what}: not all values are numbers: {error}"
        raise InputError(what, remedy="give numbers, (n,) or (n, k)") from error
    if values.dtype.kind not in "biuf" or values.ndim not in (1, 2):
        raise InputError(
            f"{what}: the type is {values.dtype} and the shape {values.shape}",
            remedy="give real numbers, (n,) or (n, k), such as the real part of complex ones",
        )
    return values


def depths_of(depths: Sequence[float]) -> list[float]:
    """Depths of the cortex, (d,) from 0 to 1; InputError for another shape, or for what are no numbers."""
    try:
        given = np.asarray(depths, np.float64)
    except (TypeError, ValueError):
        given = np.zeros(())
    if given.ndim != 1 or not ((given >= 0) & (given <= 1)).all():
        raise InputError(
            f"{depths!r} are not depths in the cortex", remedy="give a list of numbers from 0, pial, to 1, white"
        )
    found: list[float] = given.tolist()
    return found


def brought(given: ArrayLike, bring: Callable[[NDArray[Any]], NDArray[Any]]) -> NDArray[Any]:
    """What becomes of numbers or labels of a mesh on a surface, or the reverse: NaN where masked ones have most weight.

    Parameters
    ----------
    bring : takes values as `values_of` gives them; labels remain integers, since it averages other numbers
    """
    if not (np.ma.is_masked(given) and np.ma.asarray(given).dtype.kind in "iu"):
        return bring(values_of(given))
    labels: Any = np.ma.asarray(given)
    hidden = int(labels.max() if labels.count() else 0) + 1
    found = bring(values_of(labels.astype(np.int64).filled(hidden)))
    return np.where(found == hidden, np.nan, found)


def surface(shape: SurfaceLike, *, finite: bool = True) -> TriSurface:
    """A surface from any object that holds one.

    Parameters
    ----------
    shape : a file, NiBabel's `GiftiImage`, PyVista's `PolyData`, trimesh's `Trimesh`, a `TriSurface`, or vertices
        (n, 3) in mm and faces (m, 3), counted from 0
    finite : whether the coordinates in a file must be finite

    Returns
    -------
    `points` (n, 3) float64, as stored; `faces` (m, 3) int32; fields of the vertices, `point_data`

    Examples
    --------
    >>> cortet.surface("x.surf.gii").faces.shape
    (1280, 3)
    """
    if isinstance(shape, TriSurface):
        return shape
    if isinstance(shape, str | Path):
        return read_surface(shape, finite=finite)
    if hasattr(shape, "agg_data") and hasattr(shape, "darrays"):  # nibabel.gifti.GiftiImage
        return surface_of(shape)
    if hasattr(shape, "regular_faces"):  # pyvista.PolyData
        return _of_polydata(shape)
    if hasattr(shape, "vertices") and hasattr(shape, "faces"):  # trimesh.Trimesh
        return TriSurface(shape.vertices, shape.faces)
    if isinstance(shape, tuple | list) and len(shape) == 2:
        return TriSurface(*shape)
    raise InputError(
        f"an object of type {type(shape).__name__} is not a surface",
        remedy="give a file, a NiBabel image, a mesh of PyVista or trimesh, or vertices and faces",
    )


def cortex(shape: SurfaceLike, *, finite: bool = True) -> TriSurface:
    """As `surface`, of what is to be meshed: InputError for a file or image of an inflated surface or a sphere."""
    require_threads()
    if isinstance(shape, str | Path):
        require_anatomical(shape)
    elif hasattr(shape, "agg_data") and hasattr(shape, "darrays"):
        return surface_of(shape, anatomical=True)
    return surface(shape, finite=finite)


def sections(settings: Settings | None) -> dict[str, Any]:
    """The keys of a configuration by section."""
    if isinstance(settings, str | Path):
        load(settings)  # its errors name the file
        settings = read(Path(settings))
    return dict(settings or {})


def require_hemisphere(hemi: Any) -> None:
    """Raise InputError for what is not a hemisphere; None is a whole brain, or unknown."""
    if hemi not in ("L", "R", None):
        raise InputError(f"{hemi!r} is not a hemisphere", remedy='use "L", "R" or None')


def require_region_names(names: Iterable[Any]) -> None:
    """Raise InputError for names that no inner surface can have."""
    for name in names:
        if not (isinstance(name, str) and re.fullmatch(NAME, name)):
            what = f"{name!r} cannot be the name of an inner surface"
            raise InputError(what, remedy="use letters and digits, a letter first")


def _of_polydata(shape: Any) -> TriSurface:
    if not shape.n_cells:
        raise InputError(f"the PolyData has {shape.n_points} points and no faces", remedy="give a mesh with triangles")
    if not shape.is_all_triangles:
        raise InputError("the PolyData has faces that are not triangles", remedy="call triangulate() on it first")
    return TriSurface(shape.points, shape.regular_faces, dict(shape.point_data))
