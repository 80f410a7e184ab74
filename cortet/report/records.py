"""Quality records of a cohort: whose they are, and the table of every mesh, stage by stage.

A record is the JSON of `quality.QualitySummary` and says whose it is, under `origin`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from cortet.formats.atomic import write_json
from cortet.formats.tsv import write_tsv
from cortet.measure.quality import COUNTED_LIMITS

VERSION: int = 3


@dataclass(frozen=True)
class Origin:
    """Which mesh a record is about."""

    case: str
    cell_size_mm: float
    mesher: str
    #: `default`, `cgal` or `published`; None before S3, where all settings share the mesh
    setting: str | None
    #: label of the stage, as in names of files, e.g. `Cleaned`
    stage: str


def by_origin(paths: Iterable[str | Path]) -> dict[Origin, dict[str, Any]]:
    """Contents of the files of records, by whose they are, in the order given."""
    records = [read_record(path) for path in paths]
    return {Origin(**record["origin"]): record for record in records}


def reasons_by_origin(missing: Iterable[Mapping[str, Any]]) -> dict[Origin, str]:
    """Why records are missing, from the `origin` of each and the `reason`."""
    return {Origin(**entry["origin"]): entry["reason"] for entry in missing}


def read_record(path: str | Path) -> dict[str, Any]:
    """Content of the file of a record."""
    content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return content


#: columns of `cohort_stages.tsv`
STAGES_COLUMNS: dict[str, dict[str, Any]] = {
    "case": {"Description": "Case"},
    "cell_size_mm": {"Description": "Cell size h", "Units": "mm"},
    "mesher": {"Description": "Mesher of stage S1"},
    "stage": {"Description": "Stage whose mesh was measured, as file names give it"},
    "nodes": {"Description": "Number of nodes"},
    "tets": {"Description": "Number of tetrahedra"},
    "q_mean": {"Description": "Mean q"},
    "q_max": {"Description": "Largest q"},
    **{f"q_above_{limit}": {"Description": f"Number of tetrahedra with q > {limit}"} for limit in COUNTED_LIMITS},
}


def stages_table(records: Mapping[Origin, Mapping[str, Any]]) -> pd.DataFrame:
    """One row per quality record, in the order given; columns `STAGES_COLUMNS`."""
    rows = [
        {
            **asdict(origin),
            "nodes": record["nodes"],
            "tets": record["tets"],
            "q_mean": record["q"]["mean"],
            "q_max": record["q"]["max"],
            **{f"q_above_{limit}": record["count_above"][str(limit)] for limit in COUNTED_LIMITS},
        }
        for origin, record in records.items()
    ]
    return pd.DataFrame(rows, columns=list(STAGES_COLUMNS))


def write_stages(records: Iterable[str | Path], *, table: Path, sidecar: Path) -> None:
    """Write `cohort_stages.tsv` and the JSON file that explains it, from the files of quality records."""
    write_tsv(stages_table(by_origin(records)), list(STAGES_COLUMNS), table)
    write_json(STAGES_COLUMNS, sidecar)
