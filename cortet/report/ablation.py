"""The experiments of the CORTET paper (arXiv:2607.12157) on a cohort: rows of its tables, from quality records.

A record is the JSON of `quality.QualitySummary`; its file name says whose it is. A mesh that could not be made has no
record, but counts in its rows, which say why.
"""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cortet.formats.atomic import write_json
from cortet.formats.tsv import write_tsv
from cortet.measure.quality import COUNTED_LIMITS
from cortet.report import published
from cortet.report.figures import Pooled, pooled_quality_figure, save
from cortet.report.table_files import Shown, Table, mean_and_sd, median_and_range, number, write

VERSION: int = 2

Row = dict[str, Any]

#: stages whose effect is measured, as files name them -> stages that have run, what that adds
ABLATED = {
    "Generated": ("S1-S2", "only"),
    "Relocated": ("S1-S3", "+ Gmsh (S3)"),
    "Cleaned": ("S1-S4", "+ cleaning (S4)"),
    "Reconnected": ("S1-S4+", "+ reconnection (S4+)"),
}
MESHER_NAMES = {
    "cgal": "CGAL",
    "lattice": "Lattice",
    "tetgen": "TetGen",
    "ftetwild": "fTetWild",
    "gmsh": "Gmsh",
    "netgen": "Netgen",
}

_NAME = re.compile(
    r"(?P<case>.+)_res-(?P<res>\d+)um_desc-(?P<mesher>[a-z0-9]+)(?P<setting>Default|Published|Fast|)(?P<stage>[A-Z]\w+?)"
    r"_(quality|tetmesh)\.json"
)


@dataclass(frozen=True)
class Origin:
    """Which mesh a record is about."""

    case: str
    cell_size_mm: float
    mesher: str
    #: `default` or `published`; None before S3, where all settings share the mesh
    setting: str | None
    #: as files name it, e.g. `Cleaned`
    stage: str


def origin(path: str | Path, setting: str) -> Origin:
    """What the name of a record's file says; `setting` is that of the line, whose files do not name it.

    Raises
    ------
    ValueError : another name than the workflow gives
    """
    found = _NAME.fullmatch(Path(path).name)
    if not found:
        raise ValueError(f"{path}: not the name of a record of a mesh")
    own = None if found["stage"] == "Generated" else found["setting"].lower() or setting
    return Origin(found["case"], int(found["res"]) / 1000, found["mesher"], own, found["stage"])


# --- every mesh, stage by stage ---------------------------------------------------------------------------------------

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


def stage_rows(records: Iterable[Path]) -> list[dict[str, Any]]:
    """One row per quality record, in the order given; whose it is, its file name says."""
    rows = []
    for path in records:
        made, record = origin(path, ""), json.loads(path.read_text(encoding="utf-8"))
        rows.append(
            {
                "case": made.case,
                "cell_size_mm": made.cell_size_mm,
                "mesher": made.mesher,
                "stage": made.stage,
                "nodes": record["nodes"],
                "tets": record["tets"],
                "q_mean": record["q"]["mean"],
                "q_max": record["q"]["max"],
                **{f"q_above_{limit}": record["count_above"][str(limit)] for limit in COUNTED_LIMITS},
            }
        )
    return rows


def write_stages(records: Iterable[Path], *, table: Path, sidecar: Path) -> None:
    """Write `cohort_stages.tsv` and the JSON file that explains it, from quality records."""
    write_tsv(stage_rows(records), list(STAGES_COLUMNS), table)
    write_json(STAGES_COLUMNS, sidecar)


# --- Table 1 ---------------------------------------------------------------------------------------------------------

_PER_MESH = "per mesh, over the meshes of the row"

ABLATION_COLUMNS: dict[str, dict[str, Any]] = {
    "source": {"Description": "This cohort, a reference mesh, or the publication"},
    "cell_size_mm": {"Description": "Cell size h; the TetGen baseline takes none", "Units": "mm"},
    "mesher": {"Description": "Mesher of S1"},
    "setting": {"Description": "Setting of S3 and later stages; n/a before them, where all settings share the mesh"},
    "stages": {"Description": "Stages that have run"},
    "configuration": {"Description": "The mesher, or the stage that was added last"},
    "meshes": {"Description": "Number of meshes"},
    "failed": {"Description": "Number of meshes that could not be made"},
    "fallback": {"Description": "Number of meshes for which CGAL found no right topology, and S1 took its fallback"},
    "wrong_topology": {"Description": "Number of meshes whose boundary has another topology than the surface after S1"},
    "tets_total": {"Description": "Number of tetrahedra in all meshes"},
    "q_mean_mean": {"Description": f"Mean q {_PER_MESH}: mean"},
    "q_mean_sd": {"Description": f"Mean q {_PER_MESH}: sample standard deviation"},
    "q_max_median": {"Description": f"Largest q {_PER_MESH}: median"},
    "q_max_min": {"Description": f"Largest q {_PER_MESH}: minimum"},
    "q_max_max": {"Description": f"Largest q {_PER_MESH}: maximum"},
    "q_above_0.6_median": {"Description": f"Number of tetrahedra with q > 0.6 {_PER_MESH}: median"},
    "q_above_0.6_min": {"Description": f"Number of tetrahedra with q > 0.6 {_PER_MESH}: minimum"},
    "q_above_0.6_max": {"Description": f"Number of tetrahedra with q > 0.6 {_PER_MESH}: maximum"},
    "q_above_0.6_total": {"Description": "Number of tetrahedra with q > 0.6 in all meshes"},
    "remarks": {"Description": "Why meshes are missing, or where the row is from"},
}


def _meshes(row: Mapping[str, Any]) -> str:
    return str(row["meshes"]) + (f" ({row['failed']} failed)" if row.get("failed") else "")


def _told(row: Mapping[str, Any]) -> str:
    """Remarks as printed."""
    fallback = f"{row['fallback']} by S1's fallback" if row.get("fallback") else ""
    return "; ".join(part for part in (row["remarks"], fallback) if part)


ABLATION = Table(
    "Element quality after each stage",
    ABLATION_COLUMNS,
    (
        Shown("h (mm)", lambda row: "n/a" if row["cell_size_mm"] is None else f"{row['cell_size_mm']:g}", "Cell size"),
        Shown("Configuration", lambda row: row["configuration"], "The mesher alone, or the stage added last"),
        Shown(
            "Setting",
            lambda row: row["setting"] or "n/a",
            "default: boundary nodes stay on the surface; published: the boundary moves freely, as in the paper. The "
            "mesh of S1 is the same for both",
        ),
        Shown("Stages", lambda row: row["stages"] or "n/a", "Stages that have run"),
        Shown("n", _meshes, "Number of meshes, and of those that could not be made"),
        Shown(
            "mean q",
            lambda row: mean_and_sd(row["q_mean_mean"], row["q_mean_sd"]),
            "Mean over the elements of q, 0 for a regular tetrahedron and 1 for a degenerate one: mean ± standard "
            "deviation over the meshes",
        ),
        Shown(
            "q_max",
            lambda row: median_and_range(row["q_max_median"], row["q_max_min"], row["q_max_max"]),
            "Largest q of a mesh: median [minimum-maximum] over the meshes",
        ),
        Shown(
            "q > 0.6",
            lambda row: median_and_range(row["q_above_0.6_median"], row["q_above_0.6_min"], row["q_above_0.6_max"], 0),
            "Number of elements above the limit of a solver-ready mesh: median [minimum-maximum] over the meshes",
        ),
        Shown("total", lambda row: number(row["q_above_0.6_total"], 0), "The same, in all meshes together"),
        Shown("Remarks", _told, "Why meshes are missing, how many S1 made by its fallback, or where the row is from"),
    ),
    group=lambda row: (row["source"], row["cell_size_mm"], row["mesher"]),
)


def ablation_rows(
    records: Mapping[Origin, Mapping[str, Any]],
    made: Mapping[Origin, Mapping[str, Any]],
    missing: Mapping[Origin, str],
    references: Mapping[str, Mapping[str, Any]],
) -> list[Row]:
    """Rows of Table 1: this cohort by cell size, mesher, setting and stage; reference meshes; the published table.

    Parameters
    ----------
    records : quality records
    made : reports of S1, or `{"failure": reason}` where a mesher failed
    missing : reasons why records are missing
    references : name -> quality record of a reference mesh
    """
    failed = {where: report["failure"] for where, report in made.items() if "failure" in report}
    groups: dict[tuple[Any, ...], dict[str, Any]] = {}
    for where in [*records, *missing, *failed]:
        groups.setdefault(_group(where), {})[where.case] = where
    settings = sorted({where.setting for where in [*records, *missing] if where.setting})

    def order(group: tuple[Any, ...]) -> tuple[Any, ...]:
        size, mesher, setting, stage = group
        return size, list(MESHER_NAMES).index(mesher), settings.index(setting) if setting else -1, _rank(stage)

    rows = []
    for group in sorted(groups, key=order):
        members = groups[group].values()
        reasons = {where.case: missing.get(where) or failed.get(where) for where in members}
        rows.append(
            {
                "source": "this cohort",
                **dict(zip(("cell_size_mm", "mesher", "setting"), group, strict=False)),
                "stages": ABLATED[group[3]][0],
                "configuration": _configuration(group[1], group[3]),
                **_statistics([records[where] for where in members if where in records]),
                **_how_made(members, made),
                "failed": sum(reason is not None for reason in reasons.values()),
                "remarks": _remarks(reasons),
            }
        )
    return rows + [_reference_row(name, record) for name, record in references.items()] + list(_published_rows())


def _group(where: Origin) -> tuple[float, str, str | None, str]:
    return where.cell_size_mm, where.mesher, where.setting, where.stage


def _rank(stage: str) -> int:
    return list(ABLATED).index(stage)


def _configuration(mesher: str, stage: str) -> str:
    return f"{MESHER_NAMES[mesher]} only" if stage == "Generated" else ABLATED[stage][1]


def _how_made(members: Iterable[Origin], made: Mapping[Origin, Mapping[str, Any]]) -> dict[str, int]:
    """How S1 went for the meshes of a row."""
    reports = {
        where: made.get(Origin(where.case, where.cell_size_mm, where.mesher, None, "Generated"), {})
        for where in members
    }
    return {
        "fallback": sum(
            where.mesher == "cgal" and report.get("backend") == "tetgen" for where, report in reports.items()
        ),
        "wrong_topology": sum(report.get("topology_ok") is False for report in reports.values()),
    }


def _statistics(records: Sequence[Mapping[str, Any]]) -> Row:
    means, worst = ([record["q"][key] for record in records] for key in ("mean", "max"))
    above = [record["count_above"]["0.6"] for record in records]
    return {
        "meshes": len(records),
        "tets_total": sum(record["tets"] for record in records),
        "q_mean_mean": statistics.mean(means) if records else None,
        "q_mean_sd": statistics.stdev(means) if len(records) > 1 else None,
        **_spread("q_max", worst),
        **_spread("q_above_0.6", above),
        "q_above_0.6_total": sum(above) if records else None,
    }


def _spread(name: str, values: Sequence[float]) -> Row:
    return {
        f"{name}_median": statistics.median(values) if values else None,
        f"{name}_min": min(values, default=None),
        f"{name}_max": max(values, default=None),
    }


def _remarks(reasons: Mapping[str, str | None]) -> str:
    """Cases that failed, gathered by what was the matter."""
    cases: dict[str, list[str]] = {}
    for case, reason in sorted(reasons.items()):
        if reason:
            cases.setdefault(reason, []).append(case)
    return "; ".join(f"{', '.join(names)}: {reason}" for reason, names in cases.items())


def _reference_row(name: str, record: Mapping[str, Any]) -> Row:
    return {
        **dict.fromkeys(ABLATION_COLUMNS),
        "source": "reference mesh",
        "configuration": name,
        **_statistics([record]),
        "remarks": "reference mesh, as it is",
    }


def _published_rows() -> Iterator[Row]:
    for row in published.ablation():
        numbers = {key: None if value == "n/a" else float(value) for key, value in row.items() if key.startswith("q_")}
        words = {key: None if row[key] == "n/a" else row[key] for key in ("mesher", "stages", "configuration")}
        yield {
            **dict.fromkeys(ABLATION_COLUMNS),
            "source": "arXiv:2607.12157",
            "cell_size_mm": published.CELL_SIZE if words["mesher"] == "cgal" else None,
            "setting": "published" if words["stages"] not in (None, "S1-S2") else None,
            **words,
            "meshes": int(row["meshes"]),
            **numbers,
            "remarks": "arXiv:2607.12157",
        }


def write_ablation(
    records: Iterable[str],
    made: Iterable[str],
    missing: Mapping[str, str],
    references: Iterable[str],
    outputs: Iterable[str],
    *,
    setting: str,
) -> None:
    """Write Table 1 from the files of records, reports of S1 and records of reference meshes (`..._quality.json`)."""
    rows = ablation_rows(
        {origin(path, setting): read_record(path) for path in records},
        {origin(path, setting): read_record(path) for path in made},
        {origin(path, setting): reason for path, reason in missing.items()},
        {
            Path(path).name.removesuffix("_quality.json").removeprefix("reference-"): read_record(path)
            for path in references
        },
    )
    write(ABLATION, rows, *outputs)


# --- pooled quality --------------------------------------------------------------------------------------------------


def pooled(records: Mapping[Origin, Mapping[str, Any]], settings: Iterable[str]) -> list[Pooled]:
    """Summed histograms by setting and stage; the meshes of S1 belong to every setting."""
    result = []
    for setting in settings:
        members: dict[str, list[Mapping[str, Any]]] = {}
        for where in sorted(records, key=lambda where: _rank(where.stage)):
            if where.setting in (None, setting):
                members.setdefault(ABLATED[where.stage][0], []).append(records[where])
        counts = {
            stages: np.sum([record["histogram"] for record in group], axis=0) for stages, group in members.items()
        }
        result.append(Pooled(setting, max(map(len, members.values())), counts))
    return result


def draw_pooled(
    records: Iterable[str], outputs: Iterable[str], *, setting: str, settings: Iterable[str], limit: float
) -> None:
    """Draw the pooled quality from the files of the records of one cell size and mesher.

    Parameters
    ----------
    setting : of the line, whose files do not name it
    settings : in the order of the rows
    limit : of the worst q
    """
    content = {origin(path, setting): read_record(path) for path in records}
    (size,) = {where.cell_size_mm for where in content}
    save(pooled_quality_figure(pooled(content, settings), cell_size=size, limit=limit), *outputs)


def read_record(path: str | Path) -> dict[str, Any]:
    """Content of a record."""
    content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return content
