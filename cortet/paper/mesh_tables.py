"""Tables with one row per mesh: quality and element count against the cell size, and further measures of quality."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from cortet.formats.tables import Column, Row, names, values
from cortet.meshers import MESHERS
from cortet.report import published
from cortet.report.methods import findings
from cortet.report.records import Origin, read_certificate
from cortet.report.table_files import Table, mean_and_sd, number

VERSION: int = 5

PUBLISHED = "arXiv:2607.12157"
#: no mesh is refused
NONE: Mapping[Origin, str] = MappingProxyType({})

#: columns that name the mesh of a row
_MESH = (
    Column("source", "This cohort, or the publication"),
    Column("case", "Name of the case, or of the published subject", heading="Case"),
    Column("scan_age", "Gestational age at scan", "weeks", heading="GA (weeks)", form=".1f"),
    Column("mesher", "Mesher of S1", heading="Mesher", form=lambda row: MESHERS[row["mesher"]].printed),
    Column("setting", "Setting of S3 and later stages; published: as in the paper", heading="Setting"),
    Column("cell_size_mm", "Cell size h", "mm", heading="h (mm)", form="g"),
)
_Q_MAX = Column(
    "q_max", "Largest q; the limit of a solver-ready mesh is 0.6", heading="q_max", form=".3f", place="q.max"
)
_REMARKS = Column(
    "remarks",
    "Why the mesh is missing, or why it is not certified; where the row is from. Only meshes in the setting and at the "
    "cell sizes of the run have a certificate",
    heading="Remarks",
    form=lambda row: row["remarks"] or "",
)


def _thousands(name: str) -> Callable[[Row], str]:
    return lambda row: number(None if row[name] is None else row[name] / 1000, 1)


# --- Table 2 ---------------------------------------------------------------------------------------------------------

RESOLUTION = Table(
    "Element count and quality against the cell size",
    (
        *_MESH,
        Column("nodes", "Number of nodes", place="nodes", heading="nodes (1000)", form=_thousands("nodes")),
        Column("tets", "Number of tetrahedra", place="tets", heading="elements (1000)", form=_thousands("tets")),
        Column(
            "q_mean",
            "Mean q, 0 for a regular tetrahedron, 1 for a flat one",
            place="q.mean",
            heading="mean q",
            form=".3f",
        ),
        _Q_MAX,
        Column(
            "exponent",
            "Of h in the number of tetrahedra: slope of the logarithms, least squares over all h, "
            "in print ± its standard error where there are three h or more",
            heading="exponent",
            form=lambda row: mean_and_sd(row["exponent"], row["exponent_se"], 2),
        ),
        Column("exponent_se", "Standard error of the exponent; n/a for fewer than three h"),
        _REMARKS,
    ),
    first=(*names(_MESH), "nodes", "tets", "exponent"),
    group=("case", "setting"),
)


def resolution_table(
    records: Mapping[Origin, Mapping[str, Any]],
    missing: Mapping[Origin, str],
    ages: Mapping[str, float | None],
    refused: Mapping[Origin, str] = NONE,
) -> pd.DataFrame:
    """Table 2, by age, case, mesher, setting and cell size, then the published rows; columns of `RESOLUTION`.

    Parameters
    ----------
    records : quality records
    missing : reasons why records are missing
    ages : case -> weeks, None where it is not known
    refused : why meshes are not certified
    """
    ours = _by_age(RESOLUTION, records, missing, ages, refused)
    theirs = published.resolution().rename(columns={"scan_age_weeks": "scan_age"})
    theirs = theirs.assign(source=PUBLISHED, mesher="cgal", setting="published", remarks=PUBLISHED)
    table = pd.concat([ours, theirs.reindex(columns=ours.columns)], ignore_index=True)
    table = table.astype({"nodes": "Int64", "tets": "Int64"})
    meshes = table.groupby(["source", "case", "mesher", "setting"], dropna=False)[["cell_size_mm", "tets"]]
    for _, members in meshes:
        table.loc[members.index, ["exponent", "exponent_se"]] = exponent(members.dropna())
    return table


def exponent(meshes: pd.DataFrame) -> tuple[float, float]:
    """Exponent of `cell_size_mm` in `tets`, by least squares of the logarithms, and its standard error.

    Both are NaN for fewer than two sizes, the error for fewer than three.
    """
    x, y = np.log(meshes["cell_size_mm"].to_numpy(float)), np.log(meshes["tets"].to_numpy(float))
    if len(np.unique(x)) < 2:
        return np.nan, np.nan
    slope, start = np.polyfit(x, y, 1)
    if len(x) < 3:
        return float(slope), np.nan
    left = ((y - start - slope * x) ** 2).sum() / (len(x) - 2)
    return float(slope), float(np.sqrt(left / ((x - x.mean()) ** 2).sum()))


# --- other measures --------------------------------------------------------------------------------------------------

_MEASURES = {
    "one_minus_mean_ratio": ("1 - mean ratio", "1 - 12 (3V)^(2/3) / sum of squared edges, V the volume"),
    "one_minus_radius_ratio": ("1 - radius ratio", "1 - 3 inradius / circumradius"),
    "one_minus_radius_edge": ("1 - radius-edge", "1 - sqrt(6)/4 shortest edge / circumradius"),
}


def _largest(name: str) -> Callable[[Row], str]:
    """Form of the largest value of a measure, or of its published range."""
    return lambda row: row.get(f"{name}_range") or number(row[f"{name}_max"])


MEASURES = Table(
    "Worst element by four measures",
    (
        *_MESH,
        _Q_MAX,
        *(
            Column(
                f"{name}_max",
                f"Largest {formula}; 0 for a regular tetrahedron, 1 for a flat one",
                place=f"{name}.max",
                heading=heading,
                form=_largest(name),
            )
            for name, (heading, formula) in _MEASURES.items()
        ),
        _REMARKS,
    ),
    first=(),
    group=("source",),
)


def measures_table(
    records: Mapping[Origin, Mapping[str, Any]],
    missing: Mapping[Origin, str],
    ages: Mapping[str, float | None],
    refused: Mapping[Origin, str] = NONE,
) -> pd.DataFrame:
    """Worst elements by age, case, mesher and setting, then the published range; parameters as in `resolution_table`.

    Besides the columns of `MEASURES`, the published row has a column `..._range` per measure.
    """
    ranges = published.measures()
    theirs = {
        "source": PUBLISHED,
        "case": "three subjects",
        "mesher": "cgal",
        "setting": "published",
        "cell_size_mm": published.CELL_SIZE,
        **{f"{name}_max": row["max"] for name, row in ranges.iterrows()},
        **{f"{name}_range": f"{row['min']:.3f}-{row['max']:.3f}" for name, row in ranges.iterrows()},
        "remarks": f"{PUBLISHED}: range over the subjects",
    }
    return pd.concat([_by_age(MEASURES, records, missing, ages, refused), pd.DataFrame([theirs])], ignore_index=True)


# --- both ------------------------------------------------------------------------------------------------------------


def not_certified(certificates: Mapping[str, Origin]) -> dict[Origin, str]:
    """Why meshes are not certified, from the files of their certificates; certified meshes are left out."""
    read = {origin: read_certificate(path) for path, origin in certificates.items()}
    return {origin: findings(content) for origin, content in read.items() if not content["certified"]}


def _by_age(
    table: Table,
    records: Mapping[Origin, Mapping[str, Any]],
    missing: Mapping[Origin, str],
    ages: Mapping[str, float | None],
    refused: Mapping[Origin, str],
) -> pd.DataFrame:
    """One row per mesh, including missing meshes, by age (unknown ones last), case, mesher, setting and cell size."""
    remarks = {origin: f"not certified: {reason}" for origin, reason in refused.items()} | dict(missing)
    about = [
        {**asdict(origin), "source": "this cohort", "scan_age": ages[origin.case], "remarks": remarks.get(origin)}
        for origin in dict.fromkeys([*records, *missing])
    ]
    measured = values([column for column in table.columns if column.place], list(records.values()))
    rows = pd.concat([pd.DataFrame(about, columns=[*names(_MESH), "remarks"]), measured], axis="columns")
    order = ["scan_age", "case", "mesher", "setting", "cell_size_mm"]
    return rows.sort_values(order, ignore_index=True, na_position="last").reindex(columns=names(table.columns))
