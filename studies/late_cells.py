"""What cells and changes do to folds by week: differences from the next smaller cells, and from the first kind.

With smaller cells h the gain g of the gyrification index rises and the width w of folds falls. Both g (1 + c r) and
w (1 - d r), r = (h / thickness)^2, are taken to be the same for all sizes, so two sizes give the errors c and d.
Positions are those of the vertices of the surface that was meshed, after a rigid alignment.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from series import aligned

from cortet.folding.journal import TABLE
from cortet.folding.measurements import depth_below_hull
from cortet.formats.tsv import read_tsv
from cortet.geometry.spheres import vertex_areas
from cortet.meshes import TriSurface

#: the vertices of the surface that was meshed, in the folder of a fold
CARRIED = "carried.npz"
#: columns by which rows are grouped, and means over the brains: heading and form
_GROUPS = {
    "kind": ("kind", "s"),
    "cell_size_mm": ("h (mm)", "g"),
    "beside": ("beside", "s"),
    "beside_mm": ("h (mm)", "g"),
    "week": ("week", "g"),
}
_MEANS = {
    "index": ("index gains", "+.1%"),
    "width": ("width", "+.1%"),
    "index_error": ("error of gain / (h / thickness)²", ".2f"),
    "width_error": ("error of width / (h / thickness)²", ".2f"),
    "moved_mm": ("vertices differ by, mm", ".2f"),
    "correlation": ("r of gained depth", ".4f"),
}


def differences(records: Sequence[Path]) -> pd.DataFrame:
    """A row per brain, week, and pair of folds: of one kind with the next smaller cells, or of two kinds."""
    folds = [{"folder": path.parent, **json.loads(path.read_text(encoding="utf-8"))} for path in records]
    rows = []
    for fold in folds:
        own = fold["of"]
        same_brain = [one for one in folds if one["of"]["brain"] == own["brain"]]
        finer = [
            one
            for one in same_brain
            if one["of"]["kind"] == own["kind"] and one["of"]["cell_size_mm"] < own["cell_size_mm"]
        ]
        first = next(one for one in same_brain if one["of"]["cell_size_mm"] == own["cell_size_mm"])
        others = [max(finer, key=lambda one: float(one["of"]["cell_size_mm"]))] if finer else []
        for other in [*others, *([first] if first is not fold else [])]:
            rows += list(_by_week(fold, other))
    return pd.DataFrame(rows, columns=["brain", *_GROUPS, *_MEANS])


def _by_week(fold: dict[str, Any], other: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Differences of a fold from another one of the same brain, in the weeks after the start that both reached."""
    start, other_start = (_index_at_start(one["folder"]) for one in (fold, other))
    carried, others = (dict(np.load(one["folder"] / CARRIED)) for one in (fold, other))
    size, smaller = ((one["of"]["cell_size_mm"] / one["verdict"]["thickness_mm"]) ** 2 for one in (fold, other))
    weights, depth = vertex_areas(TriSurface(carried["start"], carried["faces"])), depth_below_hull(carried["start"])
    for number, (row, same_week) in enumerate(zip(fold["rows"], other["rows"], strict=False)):
        if row["week"] <= fold["verdict"]["settings"]["gestational_age"]:
            continue
        gain, other_gain = row["gyrification_index"] - start, same_week["gyrification_index"] - other_start
        width, other_width = row["fold_spacing_mm"], same_week["fold_spacing_mm"]
        points, other_points = (one["points"][number].astype(float) for one in (carried, others))
        apart = np.linalg.norm(aligned(points, other_points, weights) - other_points, axis=1)
        gained = np.array([depth_below_hull(one) - depth for one in (points, other_points)])
        covariance = np.cov(gained, aweights=weights)
        finer = other["of"]["cell_size_mm"] < fold["of"]["cell_size_mm"]
        yield {
            **{key: fold["of"][key] for key in ("brain", "kind", "cell_size_mm")},
            "beside": other["of"]["kind"],
            "beside_mm": other["of"]["cell_size_mm"],
            "week": row["week"],
            "index": gain / other_gain - 1,
            "width": width / other_width - 1,
            "index_error": (other_gain - gain) / (gain * size - other_gain * smaller) if finer else np.nan,
            "width_error": (width - other_width) / (width * size - other_width * smaller) if finer else np.nan,
            "moved_mm": np.average(apart, weights=weights),
            "correlation": covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]),
        }


def _index_at_start(folder: Path) -> float:
    return float(read_tsv(folder / TABLE)["gyrification_index"].iloc[0])


def differences_in_words(table: pd.DataFrame) -> str:
    """The rows of `differences`, means over the brains, as a table in Markdown; empty if there are none."""
    if table.empty:
        return ""
    columns = {**_GROUPS, "brains": ("brains", "d"), **_MEANS}
    head = [heading for heading, _ in columns.values()]
    lines = [head, ["---"] * len(head)]
    for group, some in table.groupby([*_GROUPS], sort=False):
        row = dict(zip(_GROUPS, group, strict=True)) | {"brains": len(some)} | dict(some[[*_MEANS]].mean())
        lines.append(
            ["n/a" if row[name] != row[name] else format(row[name], form) for name, (_, form) in columns.items()]
        )
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
