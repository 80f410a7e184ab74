"""Quality records by the meshes that they are about."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.report.records import read_record


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
    """Contents of the files of records by their origins, in the order given."""
    records = [read_record(path) for path in paths]
    return {Origin(**record["origin"]): record for record in records}
