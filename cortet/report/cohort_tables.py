"""Tables over many meshes, from their certificates; a JSON sidecar explains every column."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from cortet.cohort.sheet import Case
from cortet.formats.atomic import write_json
from cortet.formats.tsv import write_tsv

VERSION: int = 1

Record = Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """One column of a table over certificates."""

    name: str
    #: its value in the content of a certificate.json
    value: Callable[[Record], Any]
    description: str
    units: str = ""
    #: name of the check of the certificate that judges it
    check: str = ""


def at(*keys: str) -> Callable[[Record], Any]:
    """The value that `keys` lead to, one inside the other; None where there is none."""

    def value(record: Any) -> Any:
        for key in keys:
            record = record.get(key) if isinstance(record, Mapping) else None
        return record

    return value


#: columns of `cohort_quality.tsv` that come from the certificate
QUALITY_COLUMNS = (
    Column("cell_size_mm", at("parameters", "generate", "cell_size"), "Cell size h", "mm"),
    Column("mesher", at("parameters", "generate", "mesher"), "Mesher of stage S1"),
    Column("backend", at("reports", "generate", "backend"), "Package that ran the mesher"),
    Column(
        "facet_distance_mm",
        at("reports", "generate", "facet_distance_mm"),
        "Facet distance of S1 at which the boundary had the topology of the surface",
        "mm",
    ),
    Column("nodes", at("quality", "nodes"), "Number of nodes"),
    Column("tets", at("quality", "tets"), "Number of tetrahedra"),
    Column(
        "q_mean",
        at("quality", "q", "mean"),
        "Mean over all tetrahedra of q = 1 - sqrt(2) 6V / l_rms^3, V the volume and l_rms the root mean square edge: 0 "
        "for a regular tetrahedron, 1 for a degenerate one",
    ),
    Column("q_sd", at("quality", "q", "sd"), "Standard deviation of q over all tetrahedra"),
    Column("q_max", at("quality", "q", "max"), "Largest q", check="worst q"),
    Column("q_above_0.5", at("quality", "count_above", "0.5"), "Number of tetrahedra with q > 0.5"),
    Column("q_above_0.6", at("quality", "count_above", "0.6"), "Number of tetrahedra with q > 0.6"),
    Column(
        "valence_bound",
        at("valence_bound", "q"),
        "Least worst q that the connectivity allows, wherever the interior vertices move",
    ),
    Column("one_minus_mean_ratio_max", at("quality", "one_minus_mean_ratio", "max"), "Largest 1 - mean ratio"),
    Column("one_minus_radius_ratio_max", at("quality", "one_minus_radius_ratio", "max"), "Largest 1 - radius ratio"),
    Column(
        "one_minus_radius_edge_max",
        at("quality", "one_minus_radius_edge", "max"),
        "Largest 1 - sqrt(6)/4 shortest edge / circumradius",
    ),
    Column("dihedral_min_deg", at("quality", "dihedral_min_deg"), "Smallest dihedral angle", "degrees"),
    Column("dihedral_max_deg", at("quality", "dihedral_max_deg"), "Largest dihedral angle", "degrees"),
    Column("shortest_edge_mm", at("quality", "shortest_edge_mm"), "Shortest edge", "mm"),
    Column(
        "stable_time_step",
        at("quality", "stable_time_step"),
        "Bound of an explicit solver's time step: shortest edge / speed of pressure waves, shear modulus 1",
    ),
    Column("volume_ml", at("fidelity", "volume_ml"), "Volume of the mesh", "mL"),
    Column(
        "relative_volume_change",
        at("fidelity", "relative_volume_change"),
        "Volume of the mesh against that of the surface it fills, (mesh - surface) / surface",
    ),
    Column("area_mm2", at("fidelity", "area_mm2"), "Area of the mesh boundary", "mm2"),
    Column(
        "relative_area_change",
        at("fidelity", "relative_area_change"),
        "Area of the mesh boundary against that of the surface it fills, (mesh - surface) / surface",
    ),
    *(
        Column(f"{name}_{statistic}_mm", at("fidelity", f"{name}_mm", statistic), f"{words}: {meaning}", "mm", check)
        for name, words, judged in (
            ("nodes_to_surface", "Boundary nodes to the nearest point of the surface", "max"),
            ("surface_to_boundary", "Vertices of the surface to the nearest point of the mesh boundary", ""),
            ("nodes_to_nearest_vertex", "Boundary nodes to the nearest vertex of the surface, as published", ""),
        )
        for statistic, meaning in (("mean", "mean"), ("p95", "95th percentile"), ("max", "maximum"))
        for check in ["distance of a boundary node to the surface, at most" if statistic == judged else ""]
    ),
    Column(
        "roughness",
        at("fidelity", "roughness"),
        "RMS distance of the boundary nodes to the mean of their neighbours, over the mean boundary edge",
    ),
    Column("components", at("topology", "components"), "Components of the boundary", check="boundary components"),
    Column(
        "euler_number", at("topology", "euler_number"), "Euler number of the boundary", check="boundary Euler number"
    ),
    Column(
        "nonmanifold_edges",
        at("topology", "nonmanifold_edges"),
        "Boundary edges in more than two faces",
        check="boundary edges in more than two faces",
    ),
    Column(
        "pinched_vertices",
        at("topology", "pinched_vertices"),
        "Boundary vertices with more than one fan of faces",
        check="pinched boundary vertices",
    ),
    Column(
        "crossing_faces",
        lambda record: next(
            (c["value"] for c in record["checks"] if c["name"] == "boundary faces that cross others"), None
        ),
        "Boundary faces that cross others",
        check="boundary faces that cross others",
    ),
    Column(
        "verdict",
        lambda record: "pass" if record["certified"] else "fail",
        "pass: every check of the certificate is within its limit",
    ),
    Column("reasons", lambda record: "; ".join(record["reasons"]), "Why the verdict is not pass"),
)

#: columns of `cohort_quality.tsv` that come from the sheet
CASE_COLUMNS: dict[str, dict[str, Any]] = {
    "case": {"Description": "Name of the case; its files begin with it"},
    "participant_id": {"Description": "Participant"},
    "session_id": {"Description": "Session"},
    "hemi": {"Description": "Hemisphere; n/a for a whole brain", "Levels": {"L": "left", "R": "right"}},
    "scan_age": {"Description": "Gestational age at scan", "Units": "weeks"},
}

#: columns of the summary, in the format of Table 1 of the CORTET paper
SUMMARY_COLUMNS: dict[str, dict[str, Any]] = {
    "cell_size_mm": {"Description": "Cell size h", "Units": "mm"},
    "mesher": {"Description": "Mesher of stage S1"},
    "meshes": {"Description": "Number of meshes"},
    "certified": {"Description": "Number of certified meshes"},
    "q_mean": {"Description": "Mean of q per mesh: mean +- sample standard deviation over the meshes"},
    "q_max": {"Description": "Largest q per mesh: median [min-max] over the meshes"},
    "q_above_0.6": {"Description": "Tetrahedra with q > 0.6 per mesh: median [min-max] over the meshes"},
    "q_above_0.6_total": {"Description": "Tetrahedra with q > 0.6 in all meshes"},
}


def quality_rows(certificates: Sequence[Record], cases: Iterable[Case]) -> list[dict[str, Any]]:
    """One row per certificate, in their order: what the sheet says of the case, then what was measured.

    Raises
    ------
    KeyError : a certificate of a case that is not among `cases`
    """
    sheet = {case.name: case for case in cases}
    return [
        {**_case_columns(sheet[record["case"]]), **{column.name: column.value(record) for column in QUALITY_COLUMNS}}
        for record in certificates
    ]


def quality_sidecar(certificates: Sequence[Record], columns: Iterable[str]) -> dict[str, dict[str, Any]]:
    """What each of the `columns` means, its unit, and the limit it is judged by."""
    limits = {check["name"]: check for record in certificates for check in record["checks"]}
    described = dict(CASE_COLUMNS)
    for column in QUALITY_COLUMNS:
        entry = {"Description": column.description}
        if column.units:
            entry["Units"] = column.units
        check = limits.get(column.check, {})
        if check.get("comparison"):
            entry["Threshold"] = f"{check['comparison']} {check['limit']:g}"
        described[column.name] = entry
    return {name: described.get(name, {"Description": "Carried from the cohort sheet"}) for name in columns}


def summary_rows(rows: Sequence[Record]) -> list[dict[str, Any]]:
    """Quality rows summarised per cell size and mesher, as the paper's Table 1."""

    def group(row: Record) -> tuple[float, str]:
        return row["cell_size_mm"], row["mesher"]

    return [
        _summary(cell_size, mesher, list(members))
        for (cell_size, mesher), members in groupby(sorted(rows, key=group), group)
    ]


def write_quality(certificates: Sequence[Path], cases: Iterable[Case], *, table: Path, sidecar: Path) -> None:
    """Write `cohort_quality.tsv` and the JSON file that explains it, from certificate files."""
    records = [json.loads(path.read_text(encoding="utf-8")) for path in certificates]
    rows = quality_rows(records, cases)
    columns = list(dict.fromkeys(name for row in rows for name in row))
    write_tsv(rows, columns, table)
    write_json(quality_sidecar(records, columns), sidecar)


def write_summary(certificates: Sequence[Path], cases: Iterable[Case], *, table: Path, sidecar: Path) -> None:
    """Write `cohort_summary.tsv` and the JSON file that explains it, from certificate files."""
    records = [json.loads(path.read_text(encoding="utf-8")) for path in certificates]
    write_tsv(summary_rows(quality_rows(records, cases)), list(SUMMARY_COLUMNS), table)
    write_json(SUMMARY_COLUMNS, sidecar)


def _case_columns(case: Case) -> dict[str, Any]:
    return {
        "case": case.name,
        "participant_id": f"sub-{case.participant}",
        "session_id": None if case.session is None else f"ses-{case.session}",
        "hemi": case.hemi,
        "scan_age": case.scan_age,
        **case.extra,
    }


def _summary(cell_size: float, mesher: str, rows: Sequence[Record]) -> dict[str, Any]:
    def column(name: str) -> list[float]:
        return [row[name] for row in rows]

    def spread(name: str, digits: str) -> str:
        values = column(name)
        return f"{statistics.median(values):{digits}} [{min(values):{digits}}-{max(values):{digits}}]"

    means = column("q_mean")
    deviation = f" +- {statistics.stdev(means):.3f}" if len(means) > 1 else ""
    return {
        "cell_size_mm": cell_size,
        "mesher": mesher,
        "meshes": len(rows),
        "certified": sum(row["verdict"] == "pass" for row in rows),
        "q_mean": f"{statistics.mean(means):.3f}{deviation}",
        "q_max": spread("q_max", ".3f"),
        "q_above_0.6": spread("q_above_0.6", ".0f"),
        "q_above_0.6_total": int(sum(column("q_above_0.6"))),
    }
