"""Coordinates that are not mm. The user names their unit; nothing guesses it."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from cortet.errors import InputError
from cortet.meshes import CoordinateFrame, FloatArray, TriSurface

logger = logging.getLogger(__name__)

#: unit of coordinates -> its length, mm
UNITS = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 0.001}

#: shares of the cell size: a distance between neighbouring numbers that is said, and one that is refused
_COARSE, _TOO_COARSE = 0.01, 0.05


def placed(surface: TriSurface, to_mm: float | None) -> TriSurface:
    """The surface and its inner surfaces in mm.

    Parameters
    ----------
    to_mm : of `UNITS`; None if the surface is in mm
    """
    if to_mm is None:
        return surface
    return replace(
        surface,
        points=surface.points * to_mm,
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
