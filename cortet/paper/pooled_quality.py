"""Quality of all elements of a cohort after each stage: Fig. 2 of the paper, from quality records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cortet.errors import counted
from cortet.paper.experiments import ABLATED
from cortet.report import published
from cortet.report.colours import BLUE, DARK_GREY, GREEN, ORANGE, PURPLE
from cortet.report.figures import (
    PAGE,
    Q_AXIS,
    H,
    Q,
    distribution,
    drawn,
    in_powers_of_ten,
    legend,
    letter,
    mark_limit,
    save,
)
from cortet.report.records import Origin, by_origin

VERSION: int = 6

#: stages that have run -> colour, and the line of the published distribution
_COLOURS = {"S1-S2": ORANGE, "S1-S3": PURPLE, "S1-S4": BLUE, "S1-S4+": GREEN}
_PUBLISHED_LINES = {"S1-S2": "-", "S1-S3": "--", "S1-S4": ":"}
#: stages that have run -> what the elements are then
_NAMES = {"S1-S2": "generated", "S1-S3": "relocated", "S1-S4": "cleaned", "S1-S4+": "reconnected"}


@dataclass(frozen=True)
class Pooled:
    """Distributions of q over the elements of many meshes, in one setting."""

    setting: str
    meshes: int
    #: stages that have run -> elements (200,) per bin of q
    counts: Mapping[str, NDArray[np.integer[Any]]]
    #: q at which reconnection stops, None without it
    target: float | None = None


def pooled_quality_figure(pooled: Sequence[Pooled], *, cell_size: float, limit: float | None = None) -> Figure:
    """Quality of all elements after each stage, one row per setting: distribution of q, and number of elements above q.

    The published distributions (arXiv:2607.12157, Fig. 2) are thin grey lines behind. The tail is cumulative, so that
    it can be read at the limit even if few elements are there.

    Parameters
    ----------
    pooled : summed histograms
    cell_size : mm
    limit : of the worst q, drawn as a line; None draws none
    """
    theirs = {stages: published.histogram(stages) for stages in _PUBLISHED_LINES}
    with drawn(PAGE, 2.3 * len(pooled) + 0.3) as figure:
        axes = figure.subplots(len(pooled), 2, squeeze=False, sharex="col", sharey="col")
        for (bulk, tail), row in zip(axes, pooled, strict=True):
            for stages, line in _PUBLISHED_LINES.items():
                label = f"{_NAMES[stages]}, published (CORTET), {H} = {published.CELL_SIZE:g} mm"
                distribution(bulk, tail, theirs[stages], color=DARK_GREY, linestyle=line, linewidth=0.7, label=label)
            for stages, counts in row.counts.items():
                distribution(bulk, tail, counts, color=_COLOURS[stages], linewidth=1.0, label=_NAMES[stages])
            elements = max(int(counts.sum()) for counts in row.counts.values())
            title = (
                f"setting {row.setting}, {H} = {cell_size:g} mm: {counted(row.meshes, 'mesh', 'meshes')}, "
                f"{elements:,} elements"
            )
            bulk.set_title(title, loc="left")
            bulk.set(xlim=(0, 0.6), ylim=(0, None), ylabel="elements (% per bin of 0.005)")
            tail.set(xlim=(0.2, 0.9), ylim=(1e-3, 1e6), yscale="log", ylabel=f"elements above {Q} (per million)")
            in_powers_of_ten(tail.yaxis)
            if limit is not None:
                mark_limit(tail, limit)
            if row.target is not None:
                mark_limit(tail, row.target, "target", ":")
        for axis in axes[-1]:
            axis.set_xlabel(Q_AXIS)
        letter(axes.ravel())
        # published ones fill the first column
        columns = 2 if len({stages for row in pooled for stages in row.counts}) <= len(theirs) else 3
        legend(figure, axes[:, 0], columns=columns)
    return figure


def pooled(
    records: Mapping[Origin, Mapping[str, Any]], settings: Mapping[str, tuple[str, float | None]]
) -> list[Pooled]:
    """Summed histograms by setting and stage.

    Parameters
    ----------
    settings : setting -> its mesher, and the target of its reconnection; settings of one mesher share the meshes of S1
    """
    result = []
    for setting, (mesher, target) in settings.items():
        members: dict[str, list[Mapping[str, Any]]] = {}
        for origin in sorted(records, key=lambda origin: list(ABLATED).index(origin.stage)):
            if origin.mesher == mesher and origin.setting in (None, setting):
                members.setdefault(ABLATED[origin.stage][0], []).append(records[origin])
        counts = {
            stages: np.sum([record["histogram"] for record in group], axis=0) for stages, group in members.items()
        }
        result.append(Pooled(setting, max(map(len, members.values())), counts, target))
    return result


def draw_pooled(
    records: Iterable[str], outputs: Iterable[str], *, settings: Mapping[str, tuple[str, float | None]], limit: float
) -> None:
    """Draw the pooled quality from the files of the records of one cell size.

    Parameters
    ----------
    settings : as `pooled` takes them, in the order of the rows
    limit : of the worst q
    """
    content = by_origin(records)
    (size,) = {origin.cell_size_mm for origin in content}
    save(pooled_quality_figure(pooled(content, settings), cell_size=size, limit=limit), *outputs)
