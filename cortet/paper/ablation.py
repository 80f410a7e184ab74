"""Table 1 of the paper: what each stage does to the quality, from the quality records of a cohort.

A mesh that could not be made has no record. It still counts in its row of the table, which says why it is missing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pandas as pd

from cortet.formats.tables import Row, names, read_columns
from cortet.meshers import MESHERS
from cortet.paper.experiments import ABLATED
from cortet.report import published
from cortet.report.records import Origin
from cortet.report.table_files import Table, mean_and_sd, median_and_range
from cortet.stages import STAGES

VERSION: int = 6

#: names of more than four cases before a reason: the first three, and the others
_MORE = re.compile(r"((?:sub-[\w-]+, ){3})((?:sub-[\w-]+, )+sub-[\w-]+): ")
#: columns whose values, if any, are whole numbers
_COUNTS = (
    *("meshes", "failed", "fallback", "wrong_topology", "tets_total"),
    *("q_above_0.6_min", "q_above_0.6_max", "q_above_0.6_total"),
)
#: columns that identify the rows of this cohort
_GROUP = ["cell_size_mm", "mesher", "setting", "stage"]
#: numbers that are taken from the quality record of a mesh
_QUALITY = ["tets", "q_mean", "q_max", "q_above_0.6"]
#: column -> column of the meshes and how it is summarised over them
_SUMMARIES: dict[str, tuple[str, Any]] = {
    "meshes": ("tets", "count"),
    "tets_total": ("tets", "sum"),
    "q_mean_mean": ("q_mean", "mean"),
    "q_mean_sd": ("q_mean", "std"),
    **{
        f"{name}_{statistic}": (name, statistic)
        for name in ("q_max", "q_above_0.6")
        for statistic in ("median", "min", "max")
    },
    "q_above_0.6_total": ("q_above_0.6", lambda counts: counts.sum(min_count=1)),
}


def _meshes(row: Row) -> str:
    return str(row["meshes"]) + (f" ({row['failed']} failed)" if row.get("failed") else "")


def _told(row: Row) -> str:
    """Remarks as printed: of more than three cases with one reason, the others are counted."""
    remarks = _MORE.sub(lambda found: f"{found[1][:-2]} and {found[2].count('sub-')} more: ", row["remarks"] or "")
    fallback = f"{row['fallback']} by S1's fallback" if row.get("fallback") else ""
    return "; ".join(part for part in (remarks, fallback) if part)


def _of_median(row: Row, name: str, digits: int = 3) -> str:
    return median_and_range(row[f"{name}_median"], row[f"{name}_min"], row[f"{name}_max"], digits)


#: columns that print the values of several columns
_FORMS: dict[str, Callable[[Row], str]] = {
    "meshes": _meshes,
    "q_mean_mean": lambda row: mean_and_sd(row["q_mean_mean"], row["q_mean_sd"], n=row["meshes"]),
    "q_max_median": lambda row: _of_median(row, "q_max"),
    "q_above_0.6_median": lambda row: _of_median(row, "q_above_0.6", 0),
    "remarks": _told,
}
ABLATION = Table(
    "Element quality after each stage",
    [
        replace(column, form=_FORMS.get(column.name, column.form))
        for column in read_columns(Path(__file__).with_name("data") / "table_ablation_columns.tsv")
    ],
    first=("cell_size_mm", "configuration"),
    group=("source", "cell_size_mm", "mesher"),
)


def ablation_table(
    records: Mapping[Origin, Mapping[str, Any]],
    reports: Mapping[Origin, Mapping[str, Any]],
    missing: Mapping[Origin, str],
    references: Mapping[str, Mapping[str, Any]],
) -> pd.DataFrame:
    """Table 1: this cohort by cell size, mesher, setting and stage; reference meshes; the published table.

    Parameters
    ----------
    records : quality records
    reports : reports of S1, or `{"failure": reason}` if a mesher failed
    missing : reasons why records are missing
    references : name -> quality record of a reference mesh

    Returns
    -------
    table : columns of `ABLATION`; None, NaN or NA for a missing value
    """
    parts = [_cohort_rows(_meshes_of(records, reports, missing)), _reference_rows(references), _published_rows()]
    table = pd.concat([part.reindex(columns=names(ABLATION.columns)).astype(object) for part in parts])
    return table.astype(dict.fromkeys(_COUNTS, "Int64")).reset_index(drop=True)


def _meshes_of(
    records: Mapping[Origin, Mapping[str, Any]],
    reports: Mapping[Origin, Mapping[str, Any]],
    missing: Mapping[Origin, str],
) -> pd.DataFrame:
    """One row per mesh after each stage: its origin, its quality, the report of S1, and why it is missing, if so."""
    failed = {origin: report["failure"] for origin, report in reports.items() if "failure" in report}
    rows = []
    for origin in dict.fromkeys([*records, *missing, *failed]):
        s1 = reports.get(replace(origin, setting=None, stage=STAGES["generate"].label), {})
        rows.append(
            {
                **asdict(origin),
                **(_quality(records[origin]) if origin in records else {}),
                "fallback": origin.mesher == "cgal" and s1.get("backend") == "tetgen",
                "wrong_topology": s1.get("topology_ok") is False,
                "reason": missing.get(origin) or failed.get(origin),
            }
        )
    columns = ["case", *_GROUP, *_QUALITY, "fallback", "wrong_topology", "reason"]
    return pd.DataFrame(rows, columns=columns).astype(dict.fromkeys(_QUALITY, float))


def _quality(record: Mapping[str, Any]) -> dict[str, float]:
    values = record["tets"], record["q"]["mean"], record["q"]["max"], record["count_above"]["0.6"]
    return dict(zip(_QUALITY, values, strict=True))


def _cohort_rows(meshes: pd.DataFrame) -> pd.DataFrame:
    """The meshes of `_meshes_of` by cell size, mesher, setting and stage."""
    meshes = meshes.assign(
        mesher=pd.Categorical(meshes["mesher"], list(MESHERS), ordered=True),
        setting=meshes["setting"].fillna(""),  # first in the order
        stage=pd.Categorical(meshes["stage"], list(ABLATED), ordered=True),
    )
    groups = meshes.groupby(_GROUP, observed=True)
    how = {"failed": ("reason", "count"), "fallback": ("fallback", "sum"), "wrong_topology": ("wrong_topology", "sum")}
    rows = groups.agg(**_SUMMARIES, **how)
    rows["remarks"] = [_remarks(members) for _, members in groups]
    rows = rows.reset_index()
    return rows.assign(
        source="this cohort",
        setting=rows["setting"].replace("", None),
        stages=[ABLATED[stage][0] for stage in rows["stage"]],
        configuration=[
            _configuration(mesher, stage) for mesher, stage in zip(rows["mesher"], rows["stage"], strict=True)
        ],
    )


def _configuration(mesher: str, stage: str) -> str:
    return f"{MESHERS[mesher].printed} only" if stage == STAGES["generate"].label else ABLATED[stage][1]


def _remarks(meshes: pd.DataFrame) -> str:
    """Why meshes are missing: each reason with its cases, in the order of their first case."""
    missing = meshes.dropna(subset="reason").sort_values("case")
    cases = missing.groupby("reason", sort=False)["case"].agg(", ".join)
    return "; ".join(f"{names}: {reason}" for reason, names in cases.items())


def _reference_rows(references: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    meshes = pd.DataFrame(
        [{"configuration": name, **_quality(record)} for name, record in references.items()],
        columns=["configuration", *_QUALITY],
    )
    rows = meshes.groupby("configuration", sort=False).agg(**_SUMMARIES).reset_index()
    return rows.assign(source="reference mesh", remarks="reference mesh, as it is")


def _published_rows() -> pd.DataFrame:
    rows = published.ablation()
    after_s2 = rows["stages"].notna() & (rows["stages"] != "S1-S2")
    return rows.assign(
        source="arXiv:2607.12157",
        cell_size_mm=pd.Series(published.CELL_SIZE, rows.index).where(rows["mesher"] == "cgal"),
        setting=pd.Series("published", rows.index).where(after_s2),
        remarks="arXiv:2607.12157",
    )
