"""Quality records and certificates, as read, and by the meshes that they are about.

A record is the JSON of `quality.QualitySummary`; its key `origin` names the mesh.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cortet.errors import InputError
from cortet.formats.certificates import certificate_of


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
    """Content of a certificate; InputError if `certificate_of` rejects it."""
    content = certificate_of(path)
    if not content:
        what = "the certificate is damaged, edited, or from another version of cortet"
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
