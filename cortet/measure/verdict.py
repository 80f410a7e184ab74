"""The verdict on a mesh in words: how much of its surface a repair made, and which limits were relaxed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cortet.config.sections import Certify
from cortet.config.settings import SETTINGS

#: before the name of a preset
OF_PRESET = "the limits of"


def surfaces_of(report: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The reports of `repair` on the surfaces that it changed: the outer surface is "", inner ones have their names.

    Parameters
    ----------
    report : of `repair`, with those of inner surfaces under `inner`; empty if the stage did not run
    """
    every = {"": report, **report.get("inner", {})}
    # reports of earlier versions lack what repair made
    return {name: one for name, one in every.items() if one.get("repaired") and "new_area_mm2" in one}


def repaired_share(report: Mapping[str, Any]) -> float:
    """Largest fraction of the area of a surface that repair made or dropped, of all surfaces of a mesh."""
    return max((changed_share(one) for one in surfaces_of(report).values()), default=0.0)


def changed_share(one: Mapping[str, Any]) -> float:
    """Fraction of the area of a surface that repair made, or dropped as separate pieces."""
    share: float = (one["new_area_mm2"] + one["dropped_area_mm2"]) / one["area_mm2"]
    return share


def bulging_share(report: Mapping[str, Any]) -> float:
    """Largest fraction of the volume in a surface that lies between its caps on holes and flat ones, likewise."""
    return max((abs(one["bulge_ml"]) / one["volume_ml"] for one in surfaces_of(report).values()), default=0.0)


def relaxed_limits(limits: Certify) -> str:
    """Which limits are weaker than those of the default preset, in words; empty if none is."""
    weaker = _weaker(limits)
    if not weaker:
        return ""
    for name, setting in SETTINGS.items():
        if weaker == _weaker(Certify(**setting.get("certify", {}))):
            return f"{OF_PRESET} `{name}`"
    return ", ".join(
        f"{key} off" if now is None else f"{key} {now:g} instead of {usual:g}" for key, (now, usual) in weaker
    )


def verdict_in_words(*, certified: bool, relaxed: str, repaired: float | None) -> str:
    """The verdict with what limits it, such as ``certified, 7 % of the surface repaired``.

    Parameters
    ----------
    relaxed : `relaxed_limits`
    repaired : `repaired_share`; None if no surface was repaired
    """
    if not certified:
        return "NOT certified"
    limits = relaxed if relaxed.startswith(OF_PRESET) else f"your limits ({relaxed})"
    words = f"certified to {limits}" if relaxed else "certified"
    return words if repaired is None else f"{words}, {share_in_words(repaired)} of the surface repaired"


def share_in_words(share: float) -> str:
    """A fraction in percent; a small one as an upper bound."""
    return f"{share:.0%}".replace("%", " %") if share >= 0.01 else "less than 1 %"


def _weaker(limits: Certify) -> list[tuple[str, tuple[float | None, float]]]:
    """Keys of the limits that are weaker than by default: their value, and that of the default."""
    found: list[tuple[str, tuple[float | None, float]]] = []
    for key, field in Certify.model_fields.items():
        now, usual = getattr(limits, key), field.default
        lower, higher = (usual, now) if key.startswith("min_") else (now, usual)
        if now is None or lower > higher:
            found.append((key, (now, usual)))
    return found
