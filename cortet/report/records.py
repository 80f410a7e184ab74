"""Quality records and certificates, as read.

A record is the JSON of `quality.QualitySummary`; its key `origin` names the mesh.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cortet.cohort.status import certificate_of
from cortet.errors import InputError


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
