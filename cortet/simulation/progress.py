"""How far a run has come, in one line."""

from __future__ import annotations

from cortet.simulation.measurements import Measurements

_WIDTH = 20


def status(now: Measurements, part: float, seconds: float) -> str:
    """A bar, time, age, worst element, folds and the time that is left, from the part of the steps that are done."""
    done = round(_WIDTH * part)
    left = seconds / part * (1 - part) if part > 0 else float("nan")
    return (
        f"[{'#' * done}{'.' * (_WIDTH - done)}] {part:4.0%}  t {now.time:.3f}  {now.gestational_age:.2f} weeks  "
        f"min J {now.min_j:.3f}  gyrification {now.gyrification_index:.3f}  {_duration(left)} left"
    )


def _duration(seconds: float) -> str:
    if seconds != seconds:
        return "?"
    minutes = seconds / 60
    return f"{seconds:.0f} s" if minutes < 1 else f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"
