"""Quality records and certificates of a cohort, as read; and the table of every mesh, stage by stage.

A record is the JSON of `quality.QualitySummary`; its key `origin` names the mesh.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from cortet.errors import InputError
from cortet.formats.tables import Column, values
from cortet.measure.counts import COUNTED_LIMITS
from cortet.report.table_files import Table, write

VERSION: int = 3


def read_certificate(path: str | Path) -> dict[str, Any]:
    """Content of a certificate; checks of an earlier cortet, which had names alone, get their identifiers.

    Raises
    ------
    InputError : the file holds no checks
    """
    content = read_record(path)
    if not content.get("checks"):
        raise InputError("is not a certificate", file=path, remedy="delete it, and run the cohort again")
    if "schema" not in content:
        from cortet.measure.checks import NAMES  # which loads what measures: tables need it for old files only

        ids = {name: key for key, name in NAMES.items()}
        for check in content["checks"]:
            check["id"] = ids.get(check["name"], check["name"])
    return content


def read_record(path: str | Path) -> dict[str, Any]:
    """Content of the file of a record."""
    content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return content


#: columns of `cohort_stages.tsv`
STAGES = Table(
    "Every mesh, stage by stage",
    (
        Column("case", "Case", place="origin.case"),
        Column("cell_size_mm", "Cell size h", "mm", place="origin.cell_size_mm"),
        Column("mesher", "Mesher of stage S1", place="origin.mesher"),
        Column("stage", "Stage whose mesh was measured, as file names give it", place="origin.stage"),
        Column("nodes", "Number of nodes"),
        Column("tets", "Number of tetrahedra"),
        Column("q_mean", "Mean q", place="q.mean"),
        Column("q_max", "Largest q", place="q.max"),
        *(
            Column(f"q_above_{limit}", f"Number of tetrahedra with q > {limit}", place=f"count_above.{limit}")
            for limit in COUNTED_LIMITS
        ),
    ),
)


def write_stages(records: Iterable[str | Path], outputs: Iterable[str | Path]) -> None:
    """Write the table of every mesh, one row per file of a record, in the order given."""
    write(STAGES, values(STAGES.columns, [read_record(path) for path in records]), *outputs)
