"""Bounds of parameters, beyond which a value makes no sense or takes all memory. The command, the configuration and the
functions share them.

This module imports nothing heavy: the command and the configuration read it to name their bounds.
"""

from __future__ import annotations

import math
from numbers import Real

from cortet.errors import InputError

#: cell size, mm: at 0.05 a hemisphere has a billion tetrahedra; above 20 cells are too large for any hemisphere
CELL_SIZE_MM = (0.05, 20.0)
#: subdivisions of an icosahedron, 10 * 4**n + 2 vertices: 2 has 162, 7 has 163,842
SUBDIVISIONS = (2, 7)
#: least gap of a boundary over the gap of its surface; below it is a slit. Good meshes have 0.16 and more on fine real
#: surfaces, 0.07 on coarse ones
LEAST_BANK_GAP = 0.03
#: plausible ages of a surface, gestational weeks: below there is no cortical plate to mesh, above lies infancy
SCAN_AGES = (12.0, 60.0)
#: gestational ages at which a fold may begin and end, weeks: its time scale is a fit to 22 to 44 weeks; before 20 a
#: brain is smooth, and before 15 the fit gives negative growth
FOLD_AGES = (20.0, 60.0)
#: bounds of a synthetic cortex: age, weeks, and thickness, mm
PHANTOM_AGES, THICKNESS_MM = (21.0, 38.0), (0.1, 10.0)
#: layers of a cortex; laminar models have 3 to 20
MOST_LAYERS = 100

#: what the name of an inner surface or a volume must match: it stands in names of files and sets
NAME = "[A-Za-z][A-Za-z0-9]*"


def require_within(value: float, bounds: tuple[float, float], what: str) -> None:
    """Raise InputError for a value that is not within its bounds, both included."""
    low, high = bounds
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{what} is {value!r}, not a number", remedy=f"use {low:g} to {high:g}")
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{what} is {value:g}", remedy=f"use {low:g} to {high:g}")
