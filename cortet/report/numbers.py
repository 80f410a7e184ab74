"""Numbers of a certificate in words: those of its elements, and its checks beside their limits.

A module of its own, as reading records does not load what measures.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

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
