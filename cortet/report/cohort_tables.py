"""Tables over all meshes: quality, stages, tissues. A JSON sidecar explains every column."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from cortet.cohort.sheet import Case
from cortet.formats.tables import Column, names, read_columns, values
from cortet.formats.tsv import read_tsv
from cortet.formats.volumes import TISSUE_COLUMNS
from cortet.measure.counts import COUNTED_LIMITS
from cortet.report import DATA
from cortet.report.numbers import Certificate
from cortet.report.records import read_record
from cortet.report.table_files import Table, write

VERSION: int = 9

#: columns of a case from the cohort sheet; its further columns follow
CASE_COLUMNS = (
    Column("case", "Name of the case; its files begin with it", heading="Case"),
    Column("participant_id", "Participant"),
    Column("session_id", "Session"),
    Column("hemi", "Hemisphere; n/a for a whole brain", levels={"L": "left", "R": "right"}, heading="Hemisphere"),
    Column("scan_age", "Gestational age at scan", "weeks", heading="Age (weeks)", form="g"),
)
#: columns of a mesh from its certificate, one per line of the file
QUALITY_COLUMNS = read_columns(DATA / "cohort_quality_columns.tsv")

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
#: columns that say which mesh a row is about
_MESH = [
    column
    for column in (*CASE_COLUMNS, *QUALITY_COLUMNS)
    if column.name in ("case", "scan_age", "cell_size_mm", "mesher")
]
#: columns of `cohort_tissues.tsv`
TISSUES = Table("Tissue in every mesh, by the labels of its volumes", (*_MESH, *TISSUE_COLUMNS), group=("case",))


def quality_table(certificates: Sequence[Certificate], cases: Iterable[Case]) -> pd.DataFrame:
    """One row per certificate, in their order: the case as in the cohort sheet, then the measured numbers."""
    sheet = {case.name: case for case in cases}
    described = [_of_case(sheet[content["case"]]) for content in certificates]
    rows = pd.DataFrame(described, columns=None if described else names(CASE_COLUMNS))
    measured = values(QUALITY_COLUMNS, [_with_verdict(content) for content in certificates])
    return pd.concat([rows[rows.columns.difference(measured.columns, sort=False)], measured], axis="columns")


def quality_columns(certificates: Sequence[Certificate], present: Iterable[str]) -> list[Column]:
    """The columns of the names `present`, each with the limit by which certificates check it."""
    known = {column.name: column for column in (*CASE_COLUMNS, *QUALITY_COLUMNS)}
    found = [known.get(name, Column(name, "Carried from the cohort sheet")) for name in present]
    return [replace(column, limit=_limit(certificates, column.check)) for column in found]


def _of_case(case: Case) -> dict[str, Any]:
    return {
        "case": case.name,
        "participant_id": f"sub-{case.participant}",
        "session_id": None if case.session is None else f"ses-{case.session}",
        "hemi": case.hemi,
        "scan_age": case.scan_age,
        **case.extra,
    }


def _with_verdict(content: Certificate) -> dict[str, Any]:
    """A certificate with its checks by their identifiers, the verdict in one word, and the reasons as one text."""
    return {
        **content,
        "checks": {check["id"]: check["value"] for check in content["checks"]},
        "surface_state": "repaired" if content["input_repaired"] else "as given",
        "limits": content.get("relaxed") or "default",
        "verdict": "pass" if content["certified"] else "fail",
        "reasons": "; ".join(content["reasons"]),
        "remarks": "; ".join(content.get("remarks", ())),
    }


def _limit(certificates: Sequence[Certificate], check_id: str) -> str:
    """The limit of a check in words; its range if it differs between meshes, as limits by cell size do."""
    checked = [check for content in certificates for check in content["checks"] if check["id"] == check_id]
    limits = sorted({check["limit"] for check in checked if check["comparison"]})
    if not limits:
        return ""
    sign = next(check["comparison"] for check in checked if check["comparison"])
    return f"{sign} {limits[0]:g}" + (f" to {limits[-1]:g}, by the mesh" if len(limits) > 1 else "")


def write_quality(certificates: Sequence[Certificate], cases: Iterable[Case], outputs: Iterable[str | Path]) -> None:
    """Write the quality of every mesh, in the forms of `table_files.write`; parameters as in `quality_table`."""
    rows = quality_table(certificates, cases)
    columns = quality_columns(certificates, rows.columns)
    write(Table("Quality, fidelity and topology of every mesh", columns), rows, *outputs)


def write_stages(records: Iterable[str | Path], outputs: Iterable[str | Path]) -> None:
    """Write `STAGES`, one row per file of a quality record, in the order given."""
    write(STAGES, values(STAGES.columns, [read_record(path) for path in records]), *outputs)


def write_tissues(
    files: Sequence[str | Path], meshes: Sequence[Mapping[str, Any]], outputs: Iterable[str | Path]
) -> None:
    """Write `TISSUES` in the forms of `table_files.write`.

    Parameters
    ----------
    files : the `volumes.tsv` of each mesh
    meshes : its case, scan_age, cell_size_mm and mesher, in the order of the files
    """
    tables = [read_tsv(Path(file)).assign(**mesh) for file, mesh in zip(files, meshes, strict=True)]
    columns = names(TISSUES.columns)
    rows = pd.concat(tables)[columns] if tables else pd.DataFrame(columns=columns)
    write(TISSUES, rows.reset_index(drop=True), *outputs)
