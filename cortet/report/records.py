"""Quality records and certificates: as read, by the meshes that they are about, and in words.

A record is the JSON of `quality.QualitySummary`; its key `origin` names the mesh.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.cohort.status import certificate_of
from cortet.errors import InputError
from cortet.measure.checks import beside_limit, in_words
from cortet.measure.counts import COUNTED_LIMITS

#: content of a certificate.json
Certificate = Mapping[str, Any]
_COMPARED = {"<": "below", "<=": "at most", "==": "exactly", ">=": "at least"}
#: name of a number of the elements -> its form, filled from the `quality` of the certificate
ELEMENTS = {
    "Nodes": "{nodes:,}",
    "Tetrahedra": "{tets:,}",
    "Mean q": "{q[mean]:.4f}",
    "Worst q": "{q[max]:.4f}",
    **{f"Elements with q > {limit}": f"{{count_above[{limit}]:,}}" for limit in COUNTED_LIMITS},
    "Worst 1 - mean ratio": "{one_minus_mean_ratio[max]:.3f}",
    "Worst 1 - radius ratio": "{one_minus_radius_ratio[max]:.3f}",
    "Worst 1 - radius-edge ratio": "{one_minus_radius_edge[max]:.3f}",
    "Dihedral angles": "{dihedral_min_deg:.1f}° to {dihedral_max_deg:.1f}°",
    "Edges": "{shortest_edge_mm:.3f} to {longest_edge_mm:.3f} mm",
}


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


def read_certificate(path: str | Path) -> dict[str, Any]:
    """Content of a certificate; InputError if it is damaged, or has no `schema` as those of the first versions."""
    content = certificate_of(path)
    if not content:
        what = "is not a certificate from this version of cortet"
        raise InputError(what, file=path, remedy="delete it, and run the cohort again")
    return content


def read_record(path: str | Path) -> dict[str, Any]:
    """Content of the file of a record."""
    content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return content


def by_origin(paths: Iterable[str | Path]) -> dict[Origin, dict[str, Any]]:
    """Contents of the files of records by their origins, in the order given."""
    records = [read_record(path) for path in paths]
    return {Origin(**record["origin"]): record for record in records}


def of_check(check: Mapping[str, Any]) -> dict[str, Any]:
    """A check of a certificate with its `name`, `value` and `limit` as text with units."""
    unit = f" {check['unit']}" if check["unit"] else ""
    value, limit = in_words(check["value"]), "no limit"
    if check["comparison"]:
        value, most = beside_limit(check["value"], check["limit"])
        limit = f"{_COMPARED[check['comparison']]} {most}{unit}"
    name = re.sub(r"^[a-z](?=[a-z])", lambda letter: letter[0].upper(), check["name"])  # unless it begins with a symbol
    return {**check, "name": name, "value": f"{value}{unit}", "limit": limit}


def limit_of(certificate: Certificate, check_id: str) -> float:
    """Limit of a check, by its identifier."""
    return float(next(check["limit"] for check in certificate["checks"] if check["id"] == check_id))
