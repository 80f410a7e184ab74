"""Bounds of parameters beyond which they make no sense, or take all memory: for the command, the configuration and the
functions alike.

This module is light: the command and the configuration read it to name their bounds.
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
#: ages a surface can plausibly have, gestational weeks: below there is no cortical plate to mesh, above lies infancy
SCAN_AGES = (12.0, 60.0)
#: gestational ages that a fold may begin and end at, weeks: its time is a fit to 22 to 44 weeks, before 20 of which a
#: brain is smooth, and before 15 growth is negative
FOLD_AGES = (20.0, 60.0)
#: of a synthetic cortex: ages, weeks, and thickness, mm
PHANTOM_AGES, THICKNESS_MM = (21.0, 38.0), (0.1, 10.0)


def require_within(value: float, bounds: tuple[float, float], what: str) -> None:
    """Raise InputError for a value that is not within its bounds, both included."""
    low, high = bounds
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{what} is {value:g}", remedy=f"use {low:g} to {high:g}")
