"""Certificates as files. Each holds the hash of its own content, by which its reader knows one that was edited."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cortet.formats.ownership import json_of, record_of

#: of the content of certificate.json; raised where a key changes its name or meaning
SCHEMA = 3
#: in names of files of a workflow: certificates, and files for solvers of a certified mesh; those of one that is not
OF_SOLVERS, OF_UNCERTIFIED = "Solver", "Uncertified"
#: key of the hash
_OWN = "content_sha256"


def sealed(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a certificate with its hash, as files hold it."""
    return {**content, _OWN: _hash(content)}


def certificate_of(path: str | Path) -> dict[str, Any]:
    """Content of a certificate; empty if it is missing, damaged, edited, or of another version of cortet."""
    content = json_of(Path(path))
    is_whole = content.get("schema") == SCHEMA and content.get(_OWN) == _hash(content)
    return content if is_whole else {}


def is_edited(path: Path) -> bool:
    """Whether a certificate is damaged or was edited; one of another version is not known to be."""
    return path.exists() and json_of(path).get("schema", SCHEMA) == SCHEMA and not certificate_of(path)


def _hash(content: Mapping[str, Any]) -> str:
    """Hash of what was measured: without the list of the files that were written with the certificate."""
    beside = {_OWN, *record_of([])}
    plain = json.loads(json.dumps({key: value for key, value in content.items() if key not in beside}))
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
