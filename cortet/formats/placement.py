"""Coordinates that are not mm. The user names their unit; nothing guesses it."""

from __future__ import annotations

from dataclasses import replace

from cortet.meshes import CoordinateFrame, TriSurface

#: unit of coordinates -> its length, mm
UNITS = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 0.001}


def placed(surface: TriSurface, to_mm: float | None) -> TriSurface:
    """The surface and its inner surfaces in mm.

    Parameters
    ----------
    to_mm : of `UNITS`; None as 1: the surface is in mm
    """
    if to_mm in (None, 1):
        return surface
    return replace(
        surface,
        points=surface.points * to_mm,
        inner={name: placed(one, to_mm) for name, one in surface.inner.items()},
        frame=CoordinateFrame(),  # the frame in the file does not hold for the new coordinates
    )
