"""Quality records and certificates, as read.

A record is the JSON of `quality.QualitySummary`; its key `origin` names the mesh.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cortet.errors import InputError


def read_certificate(path: str | Path) -> dict[str, Any]:
    """Content of a certificate.

    Raises
    ------
    InputError : the file holds no checks or no `schema`
    """
    content = read_record(path)
    if not content.get("checks"):
        raise InputError("is not a certificate", file=path, remedy="delete it, and run the cohort again")
    if "schema" not in content:
        what = "was written by an earlier version of cortet, without a schema"
        raise InputError(what, file=path, remedy="delete it, and run the cohort again")
    return content


def read_record(path: str | Path) -> dict[str, Any]:
    """Content of the file of a record."""
    content: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return content
