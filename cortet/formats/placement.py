"""Coordinates that are not mm: in another unit, or in voxels of an image. The user names the unit; nothing guesses."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cortet.errors import InputError
from cortet.formats.untrusted import by_library, check_file
from cortet.formats.volumes import is_singular, require_geometry
from cortet.meshes import CoordinateFrame, FloatArray, TriSurface

logger = logging.getLogger(__name__)

#: unit of coordinates -> mm
UNITS = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 0.001}

#: shares of the cell size: a distance between neighbouring numbers that is said, and one that is refused
_COARSE, _TOO_COARSE = 0.01, 0.05


def matrix(unit: str, affine: Sequence[Sequence[float]] | str | Path | None) -> tuple[tuple[float, ...], ...] | None:
    """Row-major 4 x 4 matrix from stored coordinates to mm; None if they are mm already.

    Parameters
    ----------
    unit : one of `UNITS`, the unit of the coordinates after the affine if there is one
    affine : 4 x 4, or an image (NIfTI, MGH) whose voxel indices the coordinates are
    """
    if unit not in UNITS:
        raise InputError(f"unit {unit!r} is not known", remedy=f"use one of {', '.join(UNITS)}")
    if affine is None and unit == "mm":
        return None
    file = affine if isinstance(affine, (str, Path)) else None
    whole = np.eye(4) if affine is None else _of_image(file) if file is not None else np.array(affine, float)
    if whole.shape != (4, 4) or not np.isfinite(whole).all() or (whole[3] != [0, 0, 0, 1]).any() or is_singular(whole):
        what = f"affine {whole.tolist()} is not 4 x 4 with the last row 0 0 0 1, or flattens space"
        raise InputError(what, file=file, remedy="give the four rows of the voxel-to-mm affine")
    scale = np.diag([*[UNITS[unit]] * 3, 1.0])
    return tuple(tuple(row) for row in (scale @ whole).tolist())


def placed(surface: TriSurface, to_mm: Sequence[Sequence[float]] | None) -> TriSurface:
    """The surface and its inner surfaces in mm: a matrix of `matrix` maps their coordinates.

    Triangles are turned if the matrix mirrors space.
    """
    if to_mm is None:
        return surface
    whole = np.array(to_mm)
    mirrored = np.linalg.det(whole[:3, :3]) < 0
    return replace(
        surface,
        points=surface.points @ whole[:3, :3].T + whole[:3, 3],
        faces=surface.faces[:, ::-1] if mirrored else surface.faces,
        inner={name: placed(one, to_mm) for name, one in surface.inner.items()},
        frame=CoordinateFrame(),  # the frame in the file does not hold for the new coordinates
    )


def require_precision(points: FloatArray, cell_size: float) -> None:
    """Warn if files of single precision place coordinates (n, 3), mm, coarsely for a cell size, mm."""
    furthest = np.abs(points).max(initial=0)
    step = float(np.spacing(np.float32(furthest)))
    if step <= _COARSE * cell_size:
        return
    what = (
        f"coordinates reach {furthest:.4g} mm, where single precision resolves only {step:.2g} mm, "
        f"{step / cell_size:.1%} of the cell size"
    )
    if step > _TOO_COARSE * cell_size:
        raise InputError(what, remedy="translate the surface and its volumes to the origin")
    logger.warning("the surface: %s", what)


def _of_image(path: str | Path) -> Any:
    """Voxel-to-mm affine in the header of an image."""
    import nibabel

    check_file(path)
    with by_library("an image", path):
        image: Any = nibabel.load(path)
        affine = np.asarray(image.affine, float)
    require_geometry(image, path)
    return affine
