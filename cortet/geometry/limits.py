"""Bounds of parameters, for the configuration and the functions alike.

This module is light: the configuration reads it to name its bounds.
"""

from __future__ import annotations

import math

from cortet.errors import InputError

#: cell size, mm: 0.05 makes a billion tetrahedra of a hemisphere, and none fits into a cell of more than 20
CELL_SIZE_MM = (0.05, 20.0)
#: subdivisions of an icosahedron, 10 * 4**n + 2 vertices: 2 has 162, 7 has 163,842
SUBDIVISIONS = (2, 7)
#: gap of a boundary over that of its surface, from which on it is no slit; that of good meshes is 0.16 and
#: more on fine real surfaces, 0.07 on coarse ones
LEAST_BANK_GAP = 0.03


def require_within(value: float, bounds: tuple[float, float], what: str) -> None:
    """Raise InputError for a value that is not within its bounds, both included."""
    low, high = bounds
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{what} is {value:g}", remedy=f"use {low:g} to {high:g}")
