"""Tables over many meshes, from their certificates; a JSON sidecar explains every column."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from cortet.cohort.sheet import Case
from cortet.formats.atomic import write_json
from cortet.formats.tsv import write_tsv

VERSION: int = 6

Certificate = Mapping[str, Any]


@dataclass(frozen=True)
class CertificateColumn:
    """One column of a table over certificates."""

    name: str
    #: where its value is in a certificate.json: keys, one inside the other, with dots between them
    place: str
    description: str
    units: str = ""
    #: name of the check of the certificate that judges it
    check: str = ""


#: columns of `cohort_quality.tsv` that come from the certificate
QUALITY_COLUMNS = (
    CertificateColumn("cell_size_mm", "parameters.generate.cell_size", "Cell size h", "mm"),
    CertificateColumn("mesher", "parameters.generate.mesher", "Mesher of stage S1"),
    CertificateColumn("backend", "reports.generate.backend", "Package that ran the mesher"),
    CertificateColumn(
        "facet_distance_mm",
        "reports.generate.facet_distance_mm",
        "Facet distance of S1 at which the boundary had the topology of the surface",
        "mm",
    ),
    CertificateColumn("nodes", "quality.nodes", "Number of nodes"),
    CertificateColumn("tets", "quality.tets", "Number of tetrahedra"),
    CertificateColumn(
        "q_mean",
        "quality.q.mean",
        "Mean over all tetrahedra of q = 1 - sqrt(2) 6V / l_rms^3, V the volume and l_rms the root mean square edge: 0 "
        "for a regular tetrahedron, 1 for a degenerate one",
    ),
    CertificateColumn("q_sd", "quality.q.sd", "Standard deviation of q over all tetrahedra"),
    CertificateColumn("q_max", "quality.q.max", "Largest q", check="worst q"),
    CertificateColumn("q_above_0.5", "quality.count_above.0.5", "Number of tetrahedra with q > 0.5"),
    CertificateColumn("q_above_0.6", "quality.count_above.0.6", "Number of tetrahedra with q > 0.6"),
    CertificateColumn(
        "valence_bound",
        "valence_bound.q",
        "Least worst q that the connectivity allows, wherever the interior vertices move",
    ),
    CertificateColumn("one_minus_mean_ratio_max", "quality.one_minus_mean_ratio.max", "Largest 1 - mean ratio"),
    CertificateColumn("one_minus_radius_ratio_max", "quality.one_minus_radius_ratio.max", "Largest 1 - radius ratio"),
    CertificateColumn(
        "one_minus_radius_edge_max",
        "quality.one_minus_radius_edge.max",
        "Largest 1 - sqrt(6)/4 shortest edge / circumradius",
    ),
    CertificateColumn("dihedral_min_deg", "quality.dihedral_min_deg", "Smallest dihedral angle", "degrees"),
    CertificateColumn("dihedral_max_deg", "quality.dihedral_max_deg", "Largest dihedral angle", "degrees"),
    CertificateColumn("shortest_edge_mm", "quality.shortest_edge_mm", "Shortest edge", "mm"),
    CertificateColumn(
        "stable_time_step",
        "quality.stable_time_step",
        "Bound of an explicit solver's time step: shortest edge / speed of pressure waves, shear modulus 1",
    ),
    CertificateColumn("volume_ml", "fidelity.volume_ml", "Volume of the mesh", "mL"),
    CertificateColumn(
        "relative_volume_change",
        "fidelity.relative_volume_change",
        "Volume of the mesh against that of the surface it fills, (mesh - surface) / surface",
        check="relative change of the volume",
    ),
    CertificateColumn("area_mm2", "fidelity.area_mm2", "Area of the mesh boundary", "mm2"),
    CertificateColumn(
        "relative_area_change",
        "fidelity.relative_area_change",
        "Area of the mesh boundary against that of the surface it fills, (mesh - surface) / surface",
        check="relative change of the area",
    ),
    *(
        CertificateColumn(
            f"{name}_{statistic}_mm", f"fidelity.{name}_mm.{statistic}", f"{words}: {meaning}", "mm", check
        )
        for name, words, judged in (
            (
                "nodes_to_surface",
                "Boundary nodes to the nearest point of the surface",
                {"max": "distance of a boundary node to the surface, at most"},
            ),
            (
                "face_centres_to_surface",
                "Centres of boundary faces to the nearest point of the surface",
                {"max": "distance of the centre of a boundary face to the surface, at most"},
            ),
            (
                "surface_to_boundary",
                "Vertices and face centres of the surface to the mesh boundary",
                {
                    "mean": "distance of the surface to the boundary, on average",
                    "max": "distance of the surface to the boundary, at most",
                },
            ),
            ("nodes_to_nearest_vertex", "Boundary nodes to the nearest vertex of the surface, as published", {}),
        )
        for statistic, meaning in (("mean", "mean"), ("p95", "95th percentile"), ("max", "maximum"))
        for check in [judged.get(statistic, "")]
    ),
    CertificateColumn(
        "bank_gap",
        "banks.least_share",
        "Smallest gap between banks of the boundary, through the outside, over that of the surface at this place",
        check="smallest gap between banks of the boundary, over that of the surface",
    ),
    CertificateColumn(
        "native_mean_mm",
        "checks.distance between the boundary and the native surface, on average",
        "Distance between the mesh boundary and the surface as it was read, before it was smoothed: mean, the larger "
        "of both directions",
        "mm",
        check="distance between the boundary and the native surface, on average",
    ),
    CertificateColumn(
        "native_max_mm",
        "checks.distance between the boundary and the native surface, at most",
        "The same: maximum",
        "mm",
        check="distance between the boundary and the native surface, at most",
    ),
    CertificateColumn(
        "native_relative_area_change",
        "native.relative_area_change",
        "Area of the mesh boundary against that of the surface as it was read, (mesh - native) / native",
        check="relative change of the area against the native surface",
    ),
    CertificateColumn(
        "roughness",
        "fidelity.roughness",
        "RMS distance of the boundary nodes to the mean of their neighbours, over the mean boundary edge",
    ),
    CertificateColumn("components", "topology.components", "Components of the boundary", check="boundary components"),
    CertificateColumn(
        "euler_number", "topology.euler_number", "Euler number of the boundary", check="boundary Euler number"
    ),
    CertificateColumn(
        "nonmanifold_edges",
        "topology.nonmanifold_edges",
        "Boundary edges in more than two faces",
        check="boundary edges in more than two faces",
    ),
    CertificateColumn(
        "pinched_vertices",
        "topology.pinched_vertices",
        "Boundary vertices with more than one fan of faces",
        check="pinched boundary vertices",
    ),
    CertificateColumn(
        "crossing_faces",
        "checks.boundary faces that cross others",
        "Boundary faces that cross others",
        check="boundary faces that cross others",
    ),
    *(
        CertificateColumn(
            f"resample_{start}_to_{end}_{short}_mm",
            f"reports.resample.{start}_to_{end}_mm.{short}",
            f"{statistic} distance of the {start} surface, its vertices and centres of faces, to the {end} one, of a "
            "surface that was put onto the common mesh",
            "mm",
        )
        for start, end in (("native", "resampled"), ("resampled", "native"))
        for short, statistic in (("mean", "Mean"), ("max", "Largest"))
    ),
    CertificateColumn("surface_state", "surface_state", "repaired: the input surface was; as given: it was not"),
    CertificateColumn(
        "repair_file_to_surface_max_mm",
        "reports.repair.file_to_surface_mm.max",
        "Largest distance of the input surface, as its file has it, to the repaired one",
        "mm",
    ),
    CertificateColumn(
        "repair_surface_to_file_max_mm",
        "reports.repair.surface_to_file_mm.max",
        "Largest distance of the repaired surface to the input surface, as its file has it",
        "mm",
    ),
    CertificateColumn(
        "repair_relative_area_change",
        "reports.repair.relative_area_change",
        "Area of the repaired surface against that of the file, (repaired - file) / file",
    ),
    CertificateColumn(
        "repair_relative_volume_change",
        "reports.repair.relative_volume_change",
        "Volume of the repaired surface against that of the file, its holes filled, (repaired - file) / file",
    ),
    CertificateColumn("verdict", "verdict", "pass: every check of the certificate is within its limit"),
    CertificateColumn("reasons", "reasons", "Why the verdict is not pass"),
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


def quality_table(certificates: Sequence[Certificate], cases: Iterable[Case]) -> pd.DataFrame:
    """One row per certificate, in their order: what the sheet says of the case, then what was measured.

    Raises
    ------
    KeyError : a certificate of a case that is not among `cases`
    """
    sheet = {case.name: case for case in cases}
    rows = pd.DataFrame([_case_columns(sheet[content["case"]]) for content in certificates])
    values = pd.json_normalize([_with_verdict(content) for content in certificates])
    measured = values.reindex(columns=[column.place for column in QUALITY_COLUMNS])
    measured.columns = [column.name for column in QUALITY_COLUMNS]
    carried = rows.columns.difference(measured.columns, sort=False)
    return pd.concat([rows[carried], measured], axis="columns")


def _with_verdict(content: Certificate) -> dict[str, Any]:
    """A certificate with its checks by their names, the verdict in one word, and the reasons as one text."""
    return {
        **content,
        "checks": {check["name"]: check["value"] for check in content["checks"]},
        "surface_state": "repaired" if content["input_repaired"] else "as given",
        "verdict": "pass" if content["certified"] else "fail",
        "reasons": "; ".join(content["reasons"]),
    }


def quality_sidecar(certificates: Sequence[Certificate], columns: Iterable[str]) -> dict[str, dict[str, Any]]:
    """What each of the `columns` means, its unit, and the limit it is judged by."""
    described = dict(CASE_COLUMNS)
    for column in QUALITY_COLUMNS:
        entry = {"Description": column.description}
        if column.units:
            entry["Units"] = column.units
        if threshold := _threshold(certificates, column.check):
            entry["Threshold"] = threshold
        described[column.name] = entry
    return {name: described.get(name, {"Description": "Carried from the cohort sheet"}) for name in columns}


def _threshold(certificates: Sequence[Certificate], name: str) -> str:
    """The limit of a check in words; two where it differs from mesh to mesh, as limits by the cell size do."""
    judged = [check for content in certificates for check in content["checks"] if check["name"] == name]
    limits = sorted({check["limit"] for check in judged if check["comparison"]})
    if not limits:
        return ""
    sign = next(check["comparison"] for check in judged if check["comparison"])
    return f"{sign} {limits[0]:g}" + (f" to {limits[-1]:g}, by the mesh" if len(limits) > 1 else "")


def summary_table(quality: pd.DataFrame) -> pd.DataFrame:
    """The quality table summarised per cell size and mesher, as the paper's Table 1; columns `SUMMARY_COLUMNS`."""
    groups = quality.groupby(["cell_size_mm", "mesher"])
    summary = groups.agg(
        meshes=("verdict", "size"),
        certified=("verdict", lambda verdicts: (verdicts == "pass").sum()),
        q_mean=("q_mean", _mean_and_sd),
        q_max=("q_max", lambda values: _median_and_range(values, 3)),
        **{
            "q_above_0.6": ("q_above_0.6", lambda values: _median_and_range(values, 0)),
            "q_above_0.6_total": ("q_above_0.6", "sum"),
        },
    )
    return summary.reset_index()[list(SUMMARY_COLUMNS)]


def _mean_and_sd(values: pd.Series[float]) -> str:
    return f"{values.mean():.3f}" + (f" +- {values.std():.3f}" if len(values) > 1 else "")


def _median_and_range(values: pd.Series[float], digits: int) -> str:
    return f"{values.median():.{digits}f} [{values.min():.{digits}f}-{values.max():.{digits}f}]"


def write_quality(certificates: Sequence[Path], cases: Iterable[Case], *, table: Path, sidecar: Path) -> None:
    """Write `cohort_quality.tsv` and the JSON file that explains it, from certificate files."""
    contents = [json.loads(path.read_text(encoding="utf-8")) for path in certificates]
    rows = quality_table(contents, cases)
    write_tsv(rows, list(rows.columns), table)
    write_json(quality_sidecar(contents, rows.columns), sidecar)


def write_summary(certificates: Sequence[Path], cases: Iterable[Case], *, table: Path, sidecar: Path) -> None:
    """Write `cohort_summary.tsv` and the JSON file that explains it, from certificate files."""
    contents = [json.loads(path.read_text(encoding="utf-8")) for path in certificates]
    write_tsv(summary_table(quality_table(contents, cases)), list(SUMMARY_COLUMNS), table)
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
