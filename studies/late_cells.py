"""What cells do to late folds: differences from the smallest cells of the same brain, by week.

A value v of a fold is taken to depend on the cell size h as v (1 + c (h / thickness)^2) = constant. From two sizes
follows c, the error of the value in that unit: of the gain of the gyrification index, and of the width of folds.
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
_HEADINGS = {
    "brains": ("brains", "d"),
    "index": ("index gains", "+.1%"),
    "width": ("width", "+.1%"),
    "index_error": ("error of gain / (h / thickness)²", ".2f"),
    "width_error": ("error of width / (h / thickness)²", ".2f"),
    "moved_mm": ("vertices differ by, mm", ".2f"),
    "correlation": ("r of gained depth", ".2f"),
}


def of_sizes(records: Sequence[Path]) -> pd.DataFrame:
    """A row per brain, kind, cell size and week, of those that were folded with smaller cells, too."""
    folds = [{"folder": path.parent, **json.loads(path.read_text(encoding="utf-8"))} for path in records]
    rows = []
    for fold in folds:
        alike = [one for one in folds if all(one["of"][key] == fold["of"][key] for key in ("brain", "kind"))]
        smallest = min(alike, key=lambda one: one["of"]["cell_size_mm"])
        if smallest is not fold:
            rows += list(_differences(fold, smallest))
    return pd.DataFrame(rows)


def _differences(fold: dict[str, Any], fine: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Differences of a fold from that with the smallest cells, by week."""
    first, other = (_index_at_start(one["folder"]) for one in (fold, fine))
    ours, theirs = (np.load(one["folder"] / CARRIED) for one in (fold, fine))
    size, smallest = ((one["of"]["cell_size_mm"] / one["verdict"]["thickness_mm"]) ** 2 for one in (fold, fine))
    weights, start = vertex_areas(TriSurface(ours["start"], ours["faces"])), depth_below_hull(ours["start"])
    for number, (row, same) in enumerate(zip(fold["rows"], fine["rows"], strict=True)):
        if row["week"] <= fold["verdict"]["settings"]["gestational_age"]:
            continue
        gain, gain_fine = row["gyrification_index"] - first, same["gyrification_index"] - other
        width, width_fine = row["fold_spacing_mm"], same["fold_spacing_mm"]
        own, same_vertices = (carried["points"][number].astype(float) for carried in (ours, theirs))
        apart = np.linalg.norm(aligned(own, same_vertices, weights) - same_vertices, axis=1)
        gained = np.array([depth_below_hull(points) - start for points in (own, same_vertices)])
        covariance = np.cov(gained, aweights=weights)
        yield {
            **{key: fold["of"][key] for key in ("kind", "cell_size_mm")},
            "smallest_mm": fine["of"]["cell_size_mm"],
            "brain": fold["of"]["brain"],
            "week": row["week"],
            "index": gain / gain_fine - 1,
            "width": width / width_fine - 1,
            "index_error": (gain_fine - gain) / (gain * size - gain_fine * smallest),
            "width_error": (width - width_fine) / (width * size - width_fine * smallest),
            "moved_mm": np.average(apart, weights=weights),
            "correlation": covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]),
        }


def _index_at_start(folder: Path) -> float:
    return float(read_tsv(folder / TABLE)["gyrification_index"].iloc[0])


def sizes_in_words(table: pd.DataFrame) -> str:
    """The rows of `of_sizes`, means over the brains, as a table in Markdown; empty for folds of one size."""
    if table.empty:
        return ""
    keys = ["kind", "cell_size_mm", "smallest_mm", "week"]
    means = table.drop(columns="brain").groupby(keys, sort=False).mean()
    means.insert(0, "brains", table.groupby(keys, sort=False)["brain"].count())
    head = ["kind", "h (mm)", "beside h (mm)", "week", *(words for words, _ in _HEADINGS.values())]
    lines = [head, ["---"] * len(head)]
    for (kind, size, smallest, week), row in means.iterrows():
        values = [format(int(row[name]) if form == "d" else row[name], form) for name, (_, form) in _HEADINGS.items()]
        lines.append([kind, f"{size:g}", f"{smallest:g}", f"{week:g}", *values])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
