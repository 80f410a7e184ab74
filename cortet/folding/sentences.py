"""What the methods paragraph of a paper says about folds, from their verdicts."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cortet.config.fold import Fold
from cortet.errors import counted
from cortet.folding.journal import VERDICT
from cortet.formats.ownership import json_of

#: keys of a fold that the sentences say otherwise
_SAID = frozenset(("end", "gestational_age", "hemisphere", "model"))


def verdict_of_fold(folder: Path) -> dict[str, Any]:
    """Content of the verdict of the fold in a folder; empty if it has none, or one of an earlier version.

    There `distorted_share` is of tetrahedra with a large q, and the errors are by other estimates.
    """
    content = json_of(folder / VERDICT)
    return content if "distortion_max" in content else {}


def fold_sentences(verdicts: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Sentences on how meshes were folded, and on what is doubtful about their folds.

    Parameters
    ----------
    verdicts : name of each fold -> content of its verdict.json
    """
    alike: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for verdict in verdicts.values():
        settings = verdict["settings"]
        alike[settings["model"], _changed(settings)].append(verdict)
    told = [_grown(model, changed, some) for (model, changed), some in alike.items()]
    told += [f"{name}: {cells}." for name, one in verdicts.items() if (cells := cells_in_words(one))]
    stopped = [f"{name} ({one['reason']})" for name, one in verdicts.items() if one["outcome"] != "folded"]
    doubted = [f"{name} ({'; '.join(one['warnings'])})" for name, one in verdicts.items() if one["warnings"]]
    if stopped:
        told.append(f"Folds that stopped early: {'; '.join(stopped)}.")
    if doubted:
        told.append(f"Doubts about folds: {'; '.join(doubted)}.")
    return told


def cells_in_words(verdict: Mapping[str, Any]) -> str:
    """What the cell size of a fold changes, as a sentence; empty where that was not measured."""
    index, width = verdict.get("gyrification_index_error"), verdict.get("fold_spacing_error_mm")
    if index is None or width is None:
        return ""
    return (
        f"With far smaller cells than these of {verdict['cell_size_mm']:.2f} mm the gyrification index would be about "
        f"{index:.3f} higher, and folds {width:.1f} mm narrower"
    )


def _grown(model: str, changed: str, verdicts: list[Mapping[str, Any]]) -> str:
    """How folds of the same settings were made, and what came out."""
    index = [one["gyrification_index_last"] for one in verdicts]
    distorted = max(one["distorted_share"] for one in verdicts)
    start = _range(one["settings"]["gestational_age"] for one in verdicts)
    end = _range(one["gestational_age"] for one in verdicts)
    was = "was" if len(verdicts) == 1 else "were"
    return (
        f"{counted(len(verdicts), 'fold')} by growth of the cortex (model {model}, {changed or 'default settings'}) "
        f"{was} simulated, from a gestational age of {start} weeks until one of {end} weeks. At the end the "
        f"gyrification index was {_range(index, '.3f')}; at most {distorted:.1%} of the tetrahedra had an "
        "elastic distortion, the largest over the smallest stretch, above 5."
    )


def _changed(settings: Mapping[str, Any]) -> str:
    """The settings of a fold that differ from the defaults, in words."""
    usual = Fold().values()
    others = {key: value for key, value in settings.items() if key not in _SAID and value != usual.get(key)}
    return ", ".join(f"{key} = {json.dumps(value)}" for key, value in others.items())


def _range(values: Any, form: str = "g") -> str:
    """The smallest and the largest of some numbers, or the only one."""
    numbers = list(values)
    low, high = format(min(numbers), form), format(max(numbers), form)
    return low if low == high else f"{low} to {high}"
