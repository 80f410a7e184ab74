"""What makes the output folder a BIDS derivative (https://bids-specification.readthedocs.io, derivatives)."""

from __future__ import annotations

from pathlib import Path

import cortet
from cortet.formats.atomic import atomic_path, write_json

BIDS_VERSION = "1.10.0"
PAPER = "https://doi.org/10.48550/arXiv.2607.12157"
#: what the specification has no names for: tetrahedral meshes and what is known of them, tables over all cases
IGNORED = (
    "*_tetmesh.*",
    "*_quality.json",
    "*_certificate.json",
    "*_report.html",
    "*_white.json",
    "*.surf.gii",
    "mesh",
    "cohort",
    "simulation",
    "logs",
    "benchmarks",
    "work",
)


def write_dataset_description(description: Path, ignore: Path) -> None:
    """Write `dataset_description.json` and `.bidsignore`."""
    write_json(
        {
            "Name": "cortet: certified tetrahedral meshes of cortical surfaces",
            "BIDSVersion": BIDS_VERSION,
            "DatasetType": "derivative",
            "GeneratedBy": [{"Name": "cortet", "Version": cortet.__version__}],
            "ReferencesAndLinks": [PAPER],
        },
        description,
    )
    with atomic_path(ignore) as temporary:
        temporary.write_text("".join(f"{pattern}\n" for pattern in IGNORED), encoding="utf-8")
