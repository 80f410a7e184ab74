"""Tables with one row per mesh: quality and element count against the cell size, and further measures of quality."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from cortet.report import published
from cortet.report.ablation import MESHER_NAMES, Origin, Row, origin, read_record
from cortet.report.table_files import Shown, Table, number, write

VERSION: int = 1

PUBLISHED = "arXiv:2607.12157"

_MESH_COLUMNS: dict[str, dict[str, Any]] = {
    "source": {"Description": "This cohort, or the publication"},
    "case": {"Description": "Name of the case, or of the published subject"},
    "scan_age": {"Description": "Gestational age at scan", "Units": "weeks"},
    "mesher": {"Description": "Mesher of S1"},
    "setting": {"Description": "Setting of S3 and later stages"},
    "cell_size_mm": {"Description": "Cell size h", "Units": "mm"},
}
_REMARKS = {"remarks": {"Description": "Why the mesh is missing, or where the row is from"}}

_SHOWN_MESH = (
    Shown("Case", lambda row: row["case"], "Name of the case"),
    Shown("GA (weeks)", lambda row: number(row["scan_age"], 1), "Gestational age at scan"),
    Shown("Mesher", lambda row: MESHER_NAMES[row["mesher"]], "Mesher of S1"),
    Shown("Setting", lambda row: row["setting"], "Setting of S3 and later stages; published: as in the paper"),
    Shown("h (mm)", lambda row: f"{row['cell_size_mm']:g}", "Cell size"),
)
_SHOWN_REMARKS = Shown("Remarks", lambda row: row["remarks"] or "", "Why the mesh is missing, or where the row is from")


def _thousands(value: float | None) -> str:
    return "n/a" if value is None else f"{value / 1000:.1f}"


# --- Table 2 ---------------------------------------------------------------------------------------------------------

RESOLUTION_COLUMNS: dict[str, dict[str, Any]] = {
    **_MESH_COLUMNS,
    "nodes": {"Description": "Number of nodes"},
    "tets": {"Description": "Number of tetrahedra"},
    "q_mean": {"Description": "Mean q"},
    "q_max": {"Description": "Largest q"},
    "exponent": {"Description": "Of h in the number of tetrahedra: slope of the logarithms, least squares over all h"},
    **_REMARKS,
}

RESOLUTION = Table(
    "Element count and quality against the cell size",
    RESOLUTION_COLUMNS,
    (
        *_SHOWN_MESH,
        Shown("nodes (1000)", lambda row: _thousands(row["nodes"]), "Number of nodes, thousands"),
        Shown("elements (1000)", lambda row: _thousands(row["tets"]), "Number of tetrahedra, thousands"),
        Shown("exponent", lambda row: number(row["exponent"], 2), "Of h in the number of tetrahedra, over all h"),
        Shown("mean q", lambda row: number(row["q_mean"]), "Mean of q, 0 for a regular tetrahedron, 1 for a flat one"),
        Shown("q_max", lambda row: number(row["q_max"]), "Largest q; the limit of a solver-ready mesh is 0.6"),
        _SHOWN_REMARKS,
    ),
    group=lambda row: (row["case"], row["setting"]),
)


def resolution_rows(
    records: Mapping[Origin, Mapping[str, Any]], missing: Mapping[Origin, str], ages: Mapping[str, float]
) -> list[Row]:
    """Rows of Table 2, by age, case, setting and cell size, then the published ones.

    Parameters
    ----------
    records : quality records
    missing : reasons why records are missing
    ages : case -> weeks
    """
    rows = [
        {
            **_described(where, ages),
            **({key: record[key] for key in ("nodes", "tets")} if record else {"nodes": None, "tets": None}),
            "q_mean": record["q"]["mean"] if record else None,
            "q_max": record["q"]["max"] if record else None,
            "remarks": missing.get(where, ""),
        }
        for where, record in _by_age({**dict.fromkeys(missing), **records}, ages)
    ]
    theirs = [
        {
            "source": PUBLISHED,
            "case": row["case"],
            "scan_age": float(row["scan_age_weeks"]),
            "mesher": "cgal",
            "setting": "published",
            **{key: float(row[key]) for key in ("cell_size_mm", "nodes", "tets", "q_mean", "q_max")},
            "remarks": PUBLISHED,
        }
        for row in published.resolution()
    ]
    return _with_exponents(rows) + _with_exponents(theirs)


def exponent(sizes: Iterable[float], counts: Iterable[float]) -> float | None:
    """Of the cell size in the element count, by least squares of the logarithms; None for fewer than two sizes."""
    x, y = np.log(list(sizes)), np.log(list(counts))
    return float(np.polyfit(x, y, 1)[0]) if len(np.unique(x)) > 1 else None


def _with_exponents(rows: Iterable[Row]) -> list[Row]:
    result = []
    for _, group in groupby(rows, key=lambda row: (row["case"], row["mesher"], row["setting"])):
        members = list(group)
        measured = [row for row in members if row["tets"]]
        slope = exponent((row["cell_size_mm"] for row in measured), (row["tets"] for row in measured))
        result += [{**row, "exponent": slope} for row in members]
    return result


# --- other measures --------------------------------------------------------------------------------------------------

_MEASURES = {
    "one_minus_mean_ratio": ("1 - mean ratio", "1 - 12 (3V)^(2/3) / sum of squared edges, V the volume"),
    "one_minus_radius_ratio": ("1 - radius ratio", "1 - 3 inradius / circumradius"),
    "one_minus_radius_edge": ("1 - radius-edge", "1 - sqrt(6)/4 shortest edge / circumradius"),
}

MEASURES_COLUMNS: dict[str, dict[str, Any]] = {
    **_MESH_COLUMNS,
    "q_max": {"Description": "Largest q"},
    **{f"{name}_max": {"Description": f"Largest {formula}"} for name, (_, formula) in _MEASURES.items()},
    **_REMARKS,
}


def _largest(name: str, row: Mapping[str, Any]) -> str:
    """The largest value of a measure, or the range of it that was published."""
    return row.get(f"{name}_range") or number(row[f"{name}_max"])


MEASURES = Table(
    "Worst element by four measures",
    MEASURES_COLUMNS,
    (
        *_SHOWN_MESH,
        Shown("q_max", lambda row: number(row["q_max"]), "Largest q, the certified measure"),
        *(
            Shown(
                heading,
                partial(_largest, name),
                f"Largest {formula}; 0 for a regular tetrahedron, 1 for a flat one",
            )
            for name, (heading, formula) in _MEASURES.items()
        ),
        _SHOWN_REMARKS,
    ),
    group=lambda row: row["source"],
)


def measures_rows(
    records: Mapping[Origin, Mapping[str, Any]], missing: Mapping[Origin, str], ages: Mapping[str, float]
) -> list[Row]:
    """Rows by age, case and setting, then the published range; parameters as of `resolution_rows`."""
    rows = [
        {
            **_described(where, ages),
            "q_max": record["q"]["max"] if record else None,
            **{f"{name}_max": record[name]["max"] if record else None for name in _MEASURES},
            "remarks": missing.get(where, ""),
        }
        for where, record in _by_age({**dict.fromkeys(missing), **records}, ages)
    ]
    ranges = published.measures()
    theirs = {
        "source": PUBLISHED,
        "case": "three subjects",
        "scan_age": None,
        "mesher": "cgal",
        "setting": "published",
        "cell_size_mm": published.CELL_SIZE,
        "q_max": None,
        **{f"{name}_max": high for name, (_, high) in ranges.items()},
        **{f"{name}_range": f"{low:.3f}-{high:.3f}" for name, (low, high) in ranges.items()},
        "remarks": f"{PUBLISHED}: range over the subjects",
    }
    return [*rows, theirs]


# --- both ------------------------------------------------------------------------------------------------------------

TABLES = {"resolution": (RESOLUTION, resolution_rows), "measures": (MEASURES, measures_rows)}


def write_mesh_table(
    table: str,
    records: Iterable[str],
    missing: Mapping[str, str],
    outputs: Iterable[str | Path],
    *,
    setting: str,
    ages: Mapping[str, float],
) -> None:
    """Write one of `TABLES` from the files of quality records.

    Parameters
    ----------
    missing : file of a record -> why it is missing
    outputs : paths, in the forms of `printed.write`
    setting : of the line, whose files do not name it
    ages : case -> weeks
    """
    described, rows_of = TABLES[table]
    rows = rows_of(
        {origin(path, setting): read_record(path) for path in records},
        {origin(path, setting): reason for path, reason in missing.items()},
        ages,
    )
    write(described, rows, *outputs)


def _described(where: Origin, ages: Mapping[str, float]) -> Row:
    return {
        "source": "this cohort",
        "case": where.case,
        "scan_age": ages[where.case],
        "mesher": where.mesher,
        "setting": where.setting,
        "cell_size_mm": where.cell_size_mm,
    }


def _by_age(
    records: Mapping[Origin, Mapping[str, Any] | None], ages: Mapping[str, float]
) -> list[tuple[Origin, Mapping[str, Any] | None]]:
    def order(item: tuple[Origin, Any]) -> tuple[Any, ...]:
        where = item[0]
        return ages[where.case], where.case, where.mesher, where.setting or "", where.cell_size_mm

    return sorted(records.items(), key=order)
