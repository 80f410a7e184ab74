"""Limits that a mesh must keep to be certified: the section `certify` of the configuration."""

from __future__ import annotations

from cortet.geometry.limits import LEAST_BANK_GAP
from cortet.sections import Fraction, Positive, Section, Threshold


class Certify(Section):
    """What a mesh must be to be called solver-ready."""

    q_max: Threshold = 0.6
    """Worst element: q (0 regular, 1 degenerate) must be below this."""
    max_boundary_distance: Positive | None = 1e-3
    """Largest distance of a boundary node to the surface that was meshed, mm; null: no limit."""
    max_face_distance: Positive | None = 0.75
    """Largest distance of the centre of a boundary face to the surface, a fraction of h; null: no limit."""
    min_bank_gap: Fraction | None = LEAST_BANK_GAP
    """Smallest gap between banks of the boundary, through the outside, a fraction of the surface's own gap there (at
    most an edge of the boundary); null: no limit."""
    max_surface_distance: Positive | None = 0.5
    """Largest distance of the surface (vertices and face centres) to the boundary, a fraction of h; null: no limit."""
    max_mean_surface_distance: Positive | None = 0.1
    """The same, on average; null: no limit."""
    max_area_change: Positive | None = 0.05
    """Largest relative change of the area against the surface, of either sign; null: no limit."""
    max_volume_change: Positive | None = 0.1
    """Largest relative change of the volume against the surface, of either sign; null: no limit."""
    max_native_distance: Positive | None = 1.0
    """Largest distance between the boundary and the native surface, as it was read, of both directions, a fraction of
    h; null: no limit. This and the next two do not apply to surfaces that were repaired."""
    max_mean_native_distance: Positive | None = 0.2
    """The same, on average; null: no limit."""
    max_native_area_change: Positive | None = 0.1
    """Largest relative change of the area against the native surface, of either sign; null: no limit."""
