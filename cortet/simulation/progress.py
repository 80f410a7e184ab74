"""How far a run has come, in one line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from cortet.errors import InputError
from cortet.formats.tables import names
from cortet.formats.tsv import read_tsv
from cortet.simulation.fold import SECONDS, TABLE, Progress
from cortet.simulation.measurements import COLUMNS, Measurements

_WIDTH = 20


def status(now: Measurements, part: float, seconds: float) -> str:
    """A bar, time, age, worst element, folds and the time that is left, from the part of the steps that are done."""
    done = round(_WIDTH * part)
    left = seconds / part * (1 - part) if part > 0 else float("nan")
    return (
        f"[{'#' * done}{'.' * (_WIDTH - done)}] {part:4.0%}  t {now.time:.3f}  {now.gestational_age:.2f} weeks  "
        f"min J {now.min_j:.3f}  gyrification {now.gyrification_index:.3f}  {_duration(left)} left"
    )


def per_percent(say: Callable[[str], None]) -> Progress:
    """A progress callback for `fold` that speaks once per percent, and at the end."""
    said = -1

    def progress(now: Measurements, part: float, seconds: float) -> None:
        nonlocal said
        if int(100 * part) > said:
            said = int(100 * part)
            say(status(now, part, seconds))

    return progress


def reached(folder: Path) -> str:
    """How far the run in a folder had come when it wrote its last row; it may be going on, killed, or done.

    Raises
    ------
    InputError : no run has written anything there
    """
    if not (folder / TABLE).exists() or not (folder / SECONDS).exists():
        raise InputError(
            "no run has begun there", file=folder, remedy="name the folder that `cortet fold -o` writes to"
        )
    rows = read_tsv(folder / TABLE).apply(pd.to_numeric, errors="coerce").reindex(columns=names(COLUMNS))
    clock = read_tsv(folder / SECONDS).apply(pd.to_numeric, errors="coerce").iloc[-1]
    return status(Measurements(**rows.iloc[-1].to_dict()), float(clock["part"]), float(clock["seconds"]))


def _duration(seconds: float) -> str:
    if seconds != seconds:
        return "?"
    minutes = seconds / 60
    return f"{seconds:.0f} s" if minutes < 1 else f"{minutes:.0f} min" if minutes < 100 else f"{minutes / 60:.1f} h"
