"""What a user should know of a mesh although every number of it is within its limit: how far surfaces were changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

#: a repair is worth a remark from this change of volume on, a surface that gave way from this share of the volume
#: between it and the surface around it
_REPAIRED, _EXCHANGED = 0.005, 0.05


def remarks(reports: Mapping[str, Any], parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Sentences on repairs and on inner surfaces that gave way, where they went far.

    Parameters
    ----------
    reports, parameters : of the stages, as a certificate has them
    """
    return (*_repairs(reports.get("repair") or {}), *_gaps(reports, parameters))


def _repairs(report: Mapping[str, Any]) -> Iterator[str]:
    surfaces = {"the surface": report, **report.get("inner", {})}
    for name, one in surfaces.items():
        change = one.get("relative_volume_change", 0.0)
        if abs(change) >= _REPAIRED:
            yield f"repair changed the volume of {name} by {change:+.1%}"


def _gaps(reports: Mapping[str, Any], parameters: Mapping[str, Any]) -> Iterator[str]:
    asked = parameters.get("separate", {}).get("min_gap", 0.0) * parameters.get("generate", {}).get("cell_size", 0.0)
    for one in (reports.get("separate") or {}).get("surfaces", ()):
        exchanged = one["around_ml"] - one["around_before_ml"]
        share = exchanged / one["around_ml"]
        if share >= _EXCHANGED:
            yield (
                f"{one['name']} gave way to the surface around it: {exchanged:.2f} mL, {share:.0%} "
                f"of what is now between the two, was in {one['name']} (remedy: a smaller cell size or regions.min_gap)"
            )
        if one["min_gap_mm"] < 0.99 * asked:
            yield (
                f"{one['name']} keeps {one['min_gap_mm']:.2g} mm from the surface around it instead of {asked:.2g} mm: "
                "with more, triangles cross"
            )
